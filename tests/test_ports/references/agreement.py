"""The agreement of measures with references, on random runs with two or more of everything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from bench.contracts import Option, load_plugin

from .flown_samples import SEEDS, Reference, airborne, random_run


def assert_agreement(
    name: str,
    reference: Reference,
    options: Mapping[str, Option],
    more_seeds: Sequence[int] = (),
    least_values: int = 3,
) -> None:
    """On every random run the same value, and the same verdict on whether the run is considered.

    `more_seeds` are runs in which the measure takes values that none of the others has; `least_values` different
    ones are asked for.
    """
    values = set()
    for seed in (*SEEDS, *more_seeds):
        spec, tape = random_run(seed)
        x = load_plugin("rebar.measures", name)("OBS-1", tape, spec, options).x
        expected = reference(spec, tape, airborne(seed))
        assert (x is None) == (expected is None), f"seed {seed}: {x}, reference {expected}"
        if x is not None:
            assert x == pytest.approx(expected, abs=1e-9), f"seed {seed}"
            values.add(x)
    assert len(values) >= least_values, "the random runs do not exercise this measure"
