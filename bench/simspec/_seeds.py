"""Random number generators from the seeds of a SimSpec."""

from __future__ import annotations

import zlib
from functools import lru_cache
from typing import Literal

import numpy as np

from ._document import Seeds

# Of a SeedSequence.
_WORD_BITS, _WORD = 32, 0xFFFFFFFF

RandomStream = Literal["placement", "intelligence", "motion", "gusts", "sensors", "perception", "agent"]


def seed_of(seeds: Seeds, stream: RandomStream) -> int:
    """The 63-bit seed of one random stream: the stated one, else one derived from the root seed and the
    name.
    """
    stated: int | None = getattr(seeds, stream)
    if stated is not None:
        return stated
    return _derived_seed(seeds.root, stream)


# The streams of a few scenes: whoever asks for one of a scene's streams asks for all its paths.
@lru_cache(64)
def _derived_seed(root: int, stream: RandomStream) -> int:
    # By name and not by position, so that a new stream leaves the draws of all others as they were.
    sequence = np.random.SeedSequence([root, zlib.crc32(stream.encode())])
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


def generator(seeds: Seeds, stream: RandomStream, *path: int) -> np.random.Generator:
    """A PCG64 generator for one random stream.

    Each `path` gives an independent one, for example one for each actor.
    """
    words = np.array(_words(seed_of(seeds, stream), *path), dtype=np.uint32)
    # PCG64 by name: numpy may change the bit generator of default_rng, and recordings must stay reproducible.
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))


def _words(*values: int) -> list[int]:
    """The 32-bit words that SeedSequence makes of a list of whole numbers, in half its time."""
    words = []
    for value in values:
        words.append(value & _WORD)
        while value := value >> _WORD_BITS:
            words.append(value & _WORD)
    return words
