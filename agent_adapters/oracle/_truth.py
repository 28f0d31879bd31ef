"""The truth as the bench hands it over: the situation, and where everybody is at any moment."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.arrays import Floats
from bench.contracts import CastMember, TruthDocument, parse_document
from bench.errors import Fault, SetupError
from bench.simspec import PROTECTED_ROLES, SimSpec


class Truth:
    """A TruthDocument with places between its rows."""

    def __init__(self, document: TruthDocument) -> None:
        self.simspec: SimSpec = document.simspec
        self.cast: tuple[CastMember, ...] = document.cast
        self.people = [index for index, member in enumerate(self.cast) if member.role in PROTECTED_ROLES]
        self._every_s = document.every_s
        self._places_m = np.array(document.places_m, dtype=np.float64).reshape(len(document.places_m), -1, 2)

    def places_m(self, time_s: float) -> Floats:
        """(n, 2) east and north of the cast at a moment."""
        row = min(max(time_s / self._every_s, 0.0), len(self._places_m) - 1.0)
        first = min(int(row), len(self._places_m) - 2)
        share = row - first
        before, after = self._places_m[first : first + 2]
        between: Floats = (1.0 - share) * before + share * after
        return between

    def people_m(self, time_s: float) -> Floats:
        """(n, 2) those of `people`, who are not to be hurt."""
        return self.places_m(time_s)[self.people]


def load_truth(path: str) -> Truth:
    """The truth in the file that REBAR_TRUTH names. Raises SetupError where there is none."""
    file = Path(path)
    document = parse_document(TruthDocument, file.read_bytes()) if path and file.is_file() else None
    if document is None:
        remedy = "start this program through the bench, from a manifest with truth: true"
        raise SetupError(Fault("REBAR_TRUTH", "names no truth", remedy))
    return Truth(document)
