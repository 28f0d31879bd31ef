"""The ledger: what the words of a text say, and whether a sentence says the same as the words that it stands for."""
