"""Random numbers that depend on a mission's seed and on what they are for, never on who flies beside it."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from bench.arrays import Floats, Seeds

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)


def uniform(seeds: Seeds, stream: int, count: int) -> Floats:
    """(n, count) numbers in (0, 1), those of row i made from seed i alone, by splitmix64 as a function of a
    counter.

    Steele, G. L., Lea, D. and Flood, C. H. (2014), "Fast splittable pseudorandom number generators", OOPSLA.
    A longer row begins with the shorter one.
    """
    counter = np.uint64(stream << 32) + np.arange(1, count + 1, dtype=np.uint64)
    mixed = _mixed(seeds[:, None] ^ _mixed(counter * _GOLDEN)[None, :])
    return ((mixed >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53


def normal(seeds: Seeds, stream: int, count: int) -> Floats:
    """(n, count) standard normal numbers, likewise."""
    return np.asarray(ndtri(uniform(seeds, stream, count)))


def _mixed(value: Seeds) -> Seeds:
    value = (value ^ (value >> np.uint64(30))) * _FIRST
    value = (value ^ (value >> np.uint64(27))) * _SECOND
    mixed: Seeds = value ^ (value >> np.uint64(31))
    return mixed
