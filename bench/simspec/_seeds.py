"""Seeded generators, named by the SimSpec."""

from __future__ import annotations

import zlib
from typing import Literal

import numpy as np

from ._document import Seeds

RandomStream = Literal["placement", "intelligence", "motion", "gusts", "sensors", "perception", "agent"]


def seed_of(seeds: Seeds, stream: RandomStream) -> int:
    """The 63-bit seed of one named stream: its own when given, else derived from the root and the name."""
    own: int | None = getattr(seeds, stream)
    if own is not None:
        return own
    sequence = np.random.SeedSequence([seeds.root, zlib.crc32(stream.encode())])
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


def generator(seeds: Seeds, stream: RandomStream, *path: int) -> np.random.Generator:
    """A PCG64 generator for one named stream; `path` makes independent ones of it (one for each actor, say)."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed_of(seeds, stream), *path])))
