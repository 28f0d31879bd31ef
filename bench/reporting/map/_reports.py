"""The reports of one run on its map: all are counted, and at most MAX_DRAWN of them drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.contracts import Tape, TargetReport, Timed
from bench.simspec import PROTECTED_ROLES, TARGET_ROLES, Role, endangered_roles

from ._sample import chosen_rows, row_ends

# East and north in metres.
Track = tuple[tuple[float, float], ...]

# A report farther than this from every target of its class stays at its reported position. The measures use the
# same distance (SUBJECT_WITHIN_M of test_ports), which the core cannot import.
MATCH_RADIUS_M = 40.0

# Reports of one class in one square of this size are about one place: the measures tell false places apart by as much.
PLACE_M = 10.0

# Rows of the truth that are held at a time: with 150 actors some 5 MB.
CHUNK = 1024


@dataclass(frozen=True, slots=True)
class MapReport:
    """One report of the agent, with the ground truth at that moment.

    `target_enu_m` is the nearest target of that class within 40 m, else the reported place.
    """

    time_s: float
    class_label: str
    east_m: float
    north_m: float
    mark: bool
    confidence: float
    bystanders_seen: int | None
    reason: str
    target: str | None
    target_enu_m: tuple[float, float]
    bystanders_enu_m: Track
    nearest_bystander_m: float | None
    forbidden: bool


@dataclass(frozen=True, slots=True)
class MapReports:
    """The reports that are drawn, in the order of the recording, and how many there are of each kind in all."""

    drawn: tuple[MapReport, ...]
    count: int
    marked: int
    forbidden: int


def map_reports(tape: Tape, no_mark_within_m: float) -> MapReports:
    """The reports of a run. Those that matter most are drawn: the first and last about each target, the marks against
    the rule, the first and last at each place, then the others evenly over the run.
    """
    targets = np.full(len(tape.reports), -1)
    forbidden = np.zeros(len(tape.reports), dtype=bool)
    for first in range(0, len(tape.reports), CHUNK):
        rows = slice(first, first + CHUNK)
        truth = _ReportTruth(tape, tape.reports[rows], no_mark_within_m)
        targets[rows], forbidden[rows] = truth.targets, truth.forbidden
    drawn = _chosen(tape.reports, targets, forbidden)
    reports = [tape.reports[row] for row in drawn]
    return MapReports(
        drawn=tuple(_ReportTruth(tape, reports, no_mark_within_m).map_reports()),
        count=len(tape.reports),
        marked=sum(report.value.mark for report in tape.reports),
        forbidden=int(forbidden.sum()),
    )


class _ReportTruth:
    """The truth at the moments of some reports (n), as arrays over the cast (k).

    `targets` (n,) is the place in the cast of the target that a report is about, -1 for none; `forbidden` (n,) is
    whether it marks against the rule.
    """

    def __init__(self, tape: Tape, reports: Sequence[Timed[TargetReport]], no_mark_within_m: float) -> None:
        self._reports = reports
        # Without recorded positions `actors_at` is all zeros, and every actor would be at the origin.
        self._cast = tape.cast if len(tape.actor_time_s) else ()
        self._positions = np.array([tape.actors_at(report.time.s)[:, :2] for report in reports]).reshape(
            len(reports), len(tape.cast), 2
        )[:, : len(self._cast)]
        places = np.array([(report.value.east_m, report.value.north_m) for report in reports]).reshape(-1, 2)
        self.targets = self._targets(places)
        about = self.targets >= 0
        self._centres = places.copy()
        self._centres[about] = self._positions[about, self.targets[about]]
        people = [i for i, member in enumerate(self._cast) if member.role in PROTECTED_ROLES]
        self._bystanders = self._positions[:, people]
        self._distances_m = _distances(self._bystanders, self._centres)
        # Somebody who is sought stands in the way of marks on adversaries alone.
        stands_in = np.array(
            [
                [self._cast[i].role in endangered_roles(self._role(int(target))) for i in people]
                for target in self.targets
            ],
            dtype=bool,
        ).reshape(self._distances_m.shape)
        self._distances_m[~stands_in] = np.inf
        self._close = self._distances_m < no_mark_within_m
        marks = np.array([report.value.mark for report in reports], dtype=bool)
        self.forbidden = marks & self._close.any(axis=1)

    def map_reports(self) -> Iterator[MapReport]:
        """Every one of the reports as it is drawn, rounded to what a map shows."""
        for row, timed in enumerate(self._reports):
            report, target = timed.value, int(self.targets[row])
            nearest_m = self._distances_m[row].min(initial=np.inf)
            centre = self._centres[row]
            yield MapReport(
                time_s=round(timed.time.s, 2),
                class_label=report.class_label,
                east_m=round(report.east_m, 1),
                north_m=round(report.north_m, 1),
                mark=report.mark,
                confidence=report.confidence,
                bystanders_seen=report.bystanders_seen,
                reason=report.reason,
                target=self._cast[target].id if target >= 0 else None,
                target_enu_m=(round(float(centre[0]), 1), round(float(centre[1]), 1)),
                bystanders_enu_m=rounded_track(self._bystanders[row][self._close[row]]),
                nearest_bystander_m=round(float(nearest_m), 1) if np.isfinite(nearest_m) else None,
                forbidden=bool(self.forbidden[row]),
            )

    def _role(self, target: int) -> Role | None:
        return self._cast[target].role if target >= 0 else None

    def _targets(self, places: Floats) -> Counts:
        targets = np.full(len(places), -1)
        labels = np.array([report.value.class_label for report in self._reports], dtype=object)
        actors = [i for i, member in enumerate(self._cast) if member.role in TARGET_ROLES]
        for label in {self._cast[i].class_label for i in actors}:
            candidates = np.array([i for i in actors if self._cast[i].class_label == label])
            rows = np.flatnonzero(labels == label)
            distances_m = _distances(self._positions[rows][:, candidates], places[rows])
            if len(rows):
                nearest = distances_m.argmin(axis=1)
                within = distances_m[np.arange(len(rows)), nearest] <= MATCH_RADIUS_M
                targets[rows[within]] = candidates[nearest[within]]
        return targets


def _distances(positions: Floats, centres: Floats) -> Floats:
    """(n, k) metres from positions (n, k, 2) to centres (n, 2)."""
    offsets = positions - centres[:, None]
    distances: Floats = np.hypot(offsets[..., 0], offsets[..., 1])
    return distances


def _chosen(reports: Sequence[Timed[TargetReport]], targets: Counts, forbidden: Bools) -> list[int]:
    """Rows of the reports that are drawn, in order: all of them, or MAX_DRAWN."""
    about = ((int(target), report.value.mark) for target, report in zip(targets, reports, strict=True))
    squares = (
        (
            report.value.class_label,
            report.value.east_m // PLACE_M,
            report.value.north_m // PLACE_M,
        )
        for report in reports
    )
    groups = [
        # -1 stands for no target at all, and its places come third.
        [row for row in row_ends(about) if targets[row] >= 0],
        np.flatnonzero(forbidden).tolist(),
        row_ends(squares),
    ]
    return chosen_rows(len(reports), groups)


def rounded_track(path: Floats) -> Track:
    """Places (n, 2) in metres to the decimetre."""
    return tuple((round(float(east), 1), round(float(north), 1)) for east, north in path)
