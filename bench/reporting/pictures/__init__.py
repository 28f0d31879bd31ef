"""Pictures of the frames in which a detector failed worst."""
