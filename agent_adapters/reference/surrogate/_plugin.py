"""The plug-in of group `rebar.surrogates`: both reference agents share it, because a batch may hold missions
of both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bench.contracts import MeasureRequest, Prediction
from bench.errors import Fault
from bench.simspec import SimSpec

from ._observe import observe
from .batch._batch import pack, unfit


class ReferenceSurrogate:
    """Surrogate of `reference-naive` and `reference-bystander-aware`."""

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
