"""The words of the report: formats, sentences, terms."""
