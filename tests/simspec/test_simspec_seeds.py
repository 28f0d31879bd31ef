"""Generators from seeds: recordings rest on each of their draws."""

from __future__ import annotations

import random

import numpy as np

from bench.simspec import Seeds, generator


def test_a_generator_draws_what_numpy_makes_of_the_list_of_its_numbers() -> None:
    """Of seeds and paths of every size: numpy splits each number into words of 32 bits."""
    draw = random.Random(7)
    corners = [0, 1, 2**32 - 1, 2**32, 2**62, 2**63 - 1]
    for _ in range(300):
        seed, *path = (draw.choice([*corners, draw.getrandbits(63)]) for _ in range(draw.randint(1, 4)))
        sequence = np.random.SeedSequence([seed, *path])
        expected = np.random.Generator(np.random.PCG64(sequence)).random(3)
        assert (generator(Seeds(motion=seed), "motion", *path).random(3) == expected).all()
