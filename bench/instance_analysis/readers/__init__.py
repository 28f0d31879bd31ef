"""From statements to fields: one reader for each subject that a text speaks of, and the reader of the whole text."""
