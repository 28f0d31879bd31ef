"""How closely difficulties are compared."""

from __future__ import annotations

# Difficulties that agree to this many decimals are one difficulty (ruling 14): interpolation leaves rounding
# errors.
DIFFICULTY_DECIMALS = 6
