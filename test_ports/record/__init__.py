"""Measures of the record: whether what the agent did can be traced."""
