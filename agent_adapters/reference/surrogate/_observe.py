"""Observations of a batch: one value a mission for each observable, as its measure would define it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Floats
from bench.contracts import Evidence, MeasureRequest, Observation, Option, Prediction
from bench.errors import Fault
from bench.simspec import SimSpec

from .batch._batch import Batch, pack
from .batch._unfit import unfit
from .flight._mission import FlownMissions
from .measures import _flight_path, _orders, _perception, _reports
from .measures._columns import Column, Flights

Measures = Mapping[str, tuple[str, Mapping[str, Option]]]
"""Measure and options of every observable."""

# More at once takes more memory. Chosen, not measured.
CHUNK = 384
"""Missions flown at once, which bounds the memory."""

# Sums in another order differ in the last digits; what is written must not.
_DIGITS = 9


@dataclass(frozen=True, slots=True)
class Observed:
    """`x` and `considered` are (n, observables), in the order asked; `missing` are those that the overhead
    simulation cannot compute.
    """

    observables: tuple[str, ...]
    missing: tuple[str, ...]
    x: Floats
    considered: Bools
    end_s: Floats

    def of(self, row: int) -> tuple[Observation, ...]:
        """The observations of one mission, as the scorer takes them."""
        return tuple(self._observation(row, index, name) for index, name in enumerate(self.observables))

    def _observation(self, row: int, index: int, name: str) -> Observation:
        if self.considered[row, index]:
            return Observation(observable=name, considered=True, x=float(self.x[row, index]))
        lacks = name in self.missing
        text = (
            "the overhead simulation cannot compute it" if lacks else "nothing in the situation exercises it"
        )
        return Observation(
            observable=name, considered=False, x=None, evidence=(Evidence(time_s=0.0, text=text),)
        )


def computed(measures: Measures) -> tuple[str, ...]:
    """The observables that the overhead simulation computes."""
    return tuple(name for name, (measure, options) in measures.items() if _fits(measure, options))


def observe(batch: Batch, measures: Measures) -> Observed:
    """Fly a batch and measure it. A mission's row is the same whichever others are flown with it."""
    names = tuple(measures)
    computable = set(computed(measures))
    x, considered = np.zeros((len(batch), len(names))), np.zeros((len(batch), len(names)), dtype=np.bool_)
    end_s = np.zeros(len(batch))
    for begin in range(0, len(batch), CHUNK):
        part = batch.select(begin, begin + CHUNK)
        flights = Flights(FlownMissions(part))
        end_s[begin : begin + CHUNK] = flights.flown.end_s
        for index, name in enumerate(names):
            if name in computable:
                measure, options = measures[name]
                values, exercised = _COMPUTED[measure](flights, **_told(measure, options))
                x[begin : begin + CHUNK, index] = np.where(exercised, np.clip(values, 0.0, 1.0), 0.0)
                considered[begin : begin + CHUNK, index] = exercised
    missing = tuple(name for name in names if name not in computable)
    return Observed(names, missing, x.round(_DIGITS), considered, end_s.round(_DIGITS))


# What only the detections and tracks of a flight show, or what a surrogate does at once: these options change nothing.
_WITHOUT_EFFECT = frozenset({"min_confidence", "min_visible", "min_iou", "within_m", "within_s", "grace_s"})

_COMPUTED: Mapping[str, Callable[..., Column]] = {
    name: function
    for module in (_perception, _reports, _flight_path, _orders)
    for name, function in vars(module).items()
    if inspect.isfunction(function) and function.__module__ == module.__name__ and not name.startswith("_")
}
"""How each measure is computed: by the public function of its name, whose keywords are options."""


def _told(measure: str, options: Mapping[str, Option]) -> dict[str, Option]:
    """The options that change what is computed; one that its function does not know makes it unfit."""
    known = inspect.signature(_COMPUTED[measure]).parameters
    return {name: value for name, value in options.items() if name in known or name not in _WITHOUT_EFFECT}


def _fits(measure: str, options: Mapping[str, Option]) -> bool:
    if measure not in _COMPUTED:
        return False
    return set(_told(measure, options)) <= set(inspect.signature(_COMPUTED[measure]).parameters)


class ReferenceSurrogate:
    """The plug-in of group `rebar.surrogates`: both reference agents share it, because a batch may hold missions of both."""

    def unfit(self, simspec: SimSpec) -> Sequence[Fault]:
        return unfit(simspec)

    def predict(
        self, simspecs: Sequence[SimSpec], measures: Mapping[str, MeasureRequest]
    ) -> Sequence[Prediction]:
        if not simspecs:
            return []
        observed = observe(pack(simspecs), measures)
        return [
            Prediction(float(end_s), observed.of(row), observed.missing)
            for row, end_s in enumerate(observed.end_s)
        ]


reference_surrogate = ReferenceSurrogate()
