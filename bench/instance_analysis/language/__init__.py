"""The words of prose: tokens with meanings, the vocabulary, the grammar of phrases, and sentences."""
