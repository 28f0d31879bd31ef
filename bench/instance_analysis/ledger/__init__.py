"""The ledger: every number, negation, condition and quantifier of a text, and who has read it."""
