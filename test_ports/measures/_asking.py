"""Measures by name, as a decomposition asks for them."""

from __future__ import annotations

from collections.abc import Mapping

from bench.contracts import Measure, Observation, Option, Tape, load_plugin
from bench.simspec import SimSpec

from ._measured import Measured

Asked = tuple[str, Mapping[str, Option]]
"""Name of a measure in the entry-point group `rebar.measures`, and its options."""


def check_options(measure: str, options: Mapping[str, Option]) -> None:
    """Make sure, before anything flies, that a measure exists and takes these options.

    Raises SetupError when there is no such measure and ValueError, naming measure, option and what is known, when an
    option is unknown, missing or of the wrong kind. A measure of an outside package that is not a `Measured` is
    believed: what it takes shows when it is called.
    """
    found = load_plugin("rebar.measures", measure)
    if isinstance(found, Measured):
        found.read_options(options)


def measure_all(asked: Mapping[str, Asked], tape: Tape, simspec: SimSpec) -> tuple[Observation, ...]:
    """One observation for each observable, in the order asked. Raises as `check_options` does."""
    observations = []
    for observable, (name, options) in asked.items():
        measure: Measure = load_plugin("rebar.measures", name)
        observations.append(measure(observable, tape, simspec, options))
    return tuple(observations)
