"""Prints the table of docs/agents-confinement.md: what each rung holds."""

from __future__ import annotations

from ._walls import walls_table

print(walls_table())
