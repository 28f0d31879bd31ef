"""The agreement of measures with references, on random runs with two or more of everything."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import pytest

from bench.contracts import Option, load_plugin

from .flown_samples import SEEDS, Reference, airborne, random_run


@dataclass(frozen=True)
class Agreement:
    """A measure has the values of its reference. `more_seeds` are runs in which it takes values that none of the others
    has; `least_values` different ones are asked for.
    """

    reference: Reference
    options: Mapping[str, Option]
    more_seeds: Sequence[int]
    least_values: int

    def check(self, name: str) -> None:
        """On every random run the same value, and the same verdict on whether the run is considered."""
        values = set()
        for seed in (*SEEDS, *self.more_seeds):
            spec, tape = random_run(seed)
            x = load_plugin("rebar.measures", name)("OBS-1", tape, spec, self.options).x
            expected = self.reference(spec, tape, airborne(seed))
            assert (x is None) == (expected is None), f"seed {seed}: {x}, reference {expected}"
            if x is not None:
                assert x == pytest.approx(expected, abs=1e-9), f"seed {seed}"
                values.add(x)
        assert len(values) >= self.least_values, "the random runs do not exercise this measure"


AGREEMENTS: dict[str, Agreement] = {}


def agrees(
    *, more_seeds: Sequence[int] = (), least_values: int = 3, **options: Option
) -> Callable[[Reference], Reference]:
    """The decorated function is the reference of the measure of its name with these options."""

    def add(reference: Reference) -> Reference:
        AGREEMENTS[reference.__name__] = Agreement(reference, options, more_seeds, least_values)
        return reference

    return add
