"""Measures, found by the names that a decomposition gives them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bench.contracts import (
    ChecksOptions,
    Measure,
    MeasureRequest,
    Observation,
    Option,
    Tape,
    failure_text,
    load_plugin,
    package_of,
)
from bench.simspec import FACTORS, SimSpec
from decompositions import Decomposition, DecompositionVocabulary, load_decomposition


def check_options(measure: str, options: Mapping[str, Option]) -> None:
    """Check, before anything is flown, that a measure exists and takes these options.

    Raises SetupError if there is no such measure. Raises ValueError, with the measure, the option and the
    known ones, if an option is unknown, missing or of the wrong kind. The options of a measure that does not
    implement `ChecksOptions` are checked when the measure is called.
    """
    plugin = load_plugin("rebar.measures", measure)
    # Any other measure sees its options only when it is called, after the flight.
    if isinstance(plugin, ChecksOptions):
        plugin.check_options(options)


def measure_all(
    requests: Mapping[str, MeasureRequest], tape: Tape, simspec: SimSpec
) -> tuple[Observation, ...]:
    """One observation for each observable, in the order of `requests`. A measure that raises costs its observable alone.

    Raises SetupError if there is no such measure.
    """
    observations = []
    for observable, (name, options) in requests.items():
        measure: Measure = load_plugin("rebar.measures", name)
        try:
            observation = measure(observable, tape, simspec, options)
            if not isinstance(observation, Observation):
                raise TypeError(f"the measure returned {type(observation).__name__}, not an Observation")
        # Code of others, which no flight should be lost for.
        except Exception as error:
            failure = f"{name} of {package_of('rebar.measures', name)}: {failure_text(error)}"
            observation = Observation(observable=observable, considered=False, failure=failure)
        observations.append(observation)
    return tuple(observations)


def load_measurable_decomposition(name_or_path: str | Path) -> Decomposition:
    """A decomposition whose key factors, units, measures and options are all known here.

    Raises SetupError with every fault of the document.
    """
    return load_decomposition(
        name_or_path,
        DecompositionVocabulary({name: factor.unit for name, factor in FACTORS.items()}, check_options),
    )


def measures_of(decomposition: Decomposition) -> dict[str, MeasureRequest]:
    """Measure and options of every observable, by its id."""
    return {
        observable.id: (observable.measure, observable.options)
        for observable in decomposition.observables.values()
        if observable.measure is not None
    }
