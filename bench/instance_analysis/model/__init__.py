"""A language model that proposes fields, and the checks that every proposal must pass."""
