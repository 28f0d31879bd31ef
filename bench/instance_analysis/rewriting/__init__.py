"""Free text as sentences of the controlled language: by a phrase book, or by a language model."""
