"""Measures of what the operator is told: orders carried out, phases announced."""
