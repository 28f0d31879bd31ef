"""What the cameras had in sight, by the truth: every sighting of a run, as columns."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Self

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.contracts import Tape

SIGHT_PX = 12.0
"""An actor is in sight when as much of it shows as of a whole one of this apparent height: the default error model
detects 38 % of such views. Chosen, not measured.
"""


@dataclass(frozen=True, slots=True)
class Sightings:
    """The sightings of all frames of all cameras (s of them), one after another in the order of the tape.

    `frame` (s,) is the row of the frame on the tape, `box` (s, 4) left, top, right, bottom in pixels. The other columns
    (s,) are those of `bench.contracts.Sighting`, with the moment of exposure.
    """

    frame: Counts
    time_s: Floats
    actor: Counts
    range_m: Floats
    height_px: Floats
    visible: Floats
    box: Floats

    @classmethod
    def of(cls, tape: Tape) -> Self:
        """The sightings of a tape, gathered once."""
        return tape.cached((cls,), lambda: cls._gathered(tape))

    @classmethod
    def _gathered(cls, tape: Tape) -> Self:
        counts = [len(frame.sightings) for frame in tape.frames]
        exposed_s = np.array([frame.exposed.s for frame in tape.frames])
        sightings = [sighting for frame in tape.frames for sighting in frame.sightings]
        numbers = np.array(
            [
                (sighting.range_m, sighting.height_px, sighting.visible, *sighting.box)
                for sighting in sightings
            ],
            dtype=np.float64,
        ).reshape(-1, 7)  # also without sightings
        return cls(
            np.repeat(np.arange(len(counts)), counts),
            np.repeat(exposed_s, counts),
            np.array([sighting.actor for sighting in sightings], dtype=np.int64),
            range_m=numbers[:, 0],
            height_px=numbers[:, 1],
            visible=numbers[:, 2],
            box=numbers[:, 3:],
        )

    def in_sight(self, min_px: float = SIGHT_PX) -> Bools:
        """(s,) whether enough of the actor shows, whatever hides the rest: something before it, or the picture's border.

        A part of share v of an object of h pixels has the area of a whole one of like shape and h sqrt(v) pixels.
        """
        return np.asarray(self.height_px * np.sqrt(self.visible) >= min_px)

    def are_of(self, actors: Collection[int]) -> Bools:
        """(s,) which sightings are of these actors."""
        return np.asarray(np.isin(self.actor, list(actors)))

    def first_s(self, within: Bools | None = None) -> dict[int, float]:
        """First moment of each actor that was in the sightings `within` (s,), or in any."""
        rows = np.arange(len(self.actor)) if within is None else np.flatnonzero(within)
        _, first = np.unique(self.actor[rows], return_index=True)
        firsts = rows[np.sort(first)]
        return dict(zip(self.actor[firsts].tolist(), self.time_s[firsts].tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class ViewCriteria:
    """Which views are clear; sizes in pixels, ranges in metres."""

    min_height_px: float = 12.0
    min_visible: float = 0.5
    max_visible: float = 1.0
    min_range_m: float = 0.0
    max_range_m: float = 100_000.0

    def are_clear(self, sightings: Sightings) -> Bools:
        """(s,) whether truth has the actor of a sighting well enough in sight."""
        return np.asarray(
            (sightings.height_px >= self.min_height_px)
            & (sightings.visible >= self.min_visible)
            & (sightings.visible <= self.max_visible)
            & (sightings.range_m >= self.min_range_m)
            & (sightings.range_m <= self.max_range_m)
        )
