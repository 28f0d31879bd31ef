"""What happened on the ground in one run, thinned for drawing."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import shapely

from bench.arrays import Floats
from bench.contracts import Tape
from bench.simspec import Polygon, Role, SimSpec

from .._campaign_data import Run
from ._consents import MapConsents, map_consents
from ._events import RunEvent, run_events
from ._reports import MapReports, Track, map_reports, rounded_track

# A dot every 6 m at the default speed of a mission, 12 m/s.
TRAJECTORY_HZ = 2.0

# The size of a person in the asset catalogue.
PATH_TOLERANCE_M = 0.5

# The entry of Tape.malformed for a recording that is cut off; all other entries are topics.
CUT_RECORDING = "recording"

# Chosen, not measured: agents decide, report and ask as often as they like, and a page holds several runs.
MESSAGE_ROWS = 200

# Actions that stand for a long decision log beside its first lines. Agents choose their names, so there may be many.
FREQUENT_ACTIONS = 5


@dataclass(frozen=True, slots=True)
class MapActor:
    """One actor: where it started, and the corners of its path (one corner when it did not move)."""

    id: str
    role: Role
    class_label: str
    path_enu_m: Track


@dataclass(frozen=True, slots=True)
class MapNoFly:
    """Ground that must not be flown over from `from_s` on, to the end where `until_s` is None."""

    id: str
    corners_enu_m: Track
    from_s: float
    until_s: float | None

    @property
    def always(self) -> bool:
        """Whether it holds throughout."""
        return self.from_s <= 0.0 and self.until_s is None

    @property
    def span(self) -> str:
        """From when to when."""
        return f"from {self.from_s:g} s" + ("" if self.until_s is None else f" to {self.until_s:g} s")


@dataclass(frozen=True, slots=True)
class RunMap:
    """One run as the map shows it; east and north metres in the world's frame, seconds of simulated time."""

    run: Run
    area_enu_m: Track
    home_enu_m: tuple[float, float]
    no_mark_within_m: float
    circles: tuple[tuple[str, float, float, float, int], ...]  # id, east_m, north_m, radius_m, priority
    actors: tuple[MapActor, ...]
    flight: tuple[tuple[float, float, float, float], ...]  # time_s, east_m, north_m, height_m
    reports: MapReports
    decisions: tuple[
        tuple[float, str, str, str], ...
    ]  # time_s, action, subject, reason of the first MESSAGE_ROWS
    decision_count: int
    frequent_actions: tuple[tuple[str, int], ...]  # the most frequent actions of decisions, and how often
    malformed: tuple[tuple[str, int], ...] = ()  # topic and number of messages that could not be understood
    cut: bool = False  # the recording ends before its session did
    geofence_enu_m: Track = ()
    no_fly: tuple[MapNoFly, ...] = ()
    roads: tuple[tuple[str, Track, float], ...] = ()  # id, middle, width_m
    areas: tuple[tuple[str, Track], ...] = ()
    events: tuple[RunEvent, ...] = ()
    consents: MapConsents = field(default_factory=MapConsents)
    mark_consent: bool = False  # the rules ask for the operator's consent before a mark


def build_run_map(run: Run, simspec: SimSpec, tape: Tape) -> RunMap:
    """The map of a run from its ground truth and its agent's messages; `simspec` is that of its recording."""
    reported = {report.id: (report.uncertainty_m, report.priority) for report in simspec.intelligence}
    placed = simspec.realized.reports if simspec.realized else ()
    return RunMap(
        run=run,
        area_enu_m=_closed_ring(simspec.world.area),
        home_enu_m=(simspec.vehicle.home.east_m, simspec.vehicle.home.north_m),
        no_mark_within_m=simspec.rules.no_mark_within_m,
        circles=tuple(
            (place.id, place.east_m, place.north_m, *reported.get(place.id, (0.0, 0))) for place in placed
        ),
        actors=_actors(tape),
        flight=_flight(tape),
        reports=map_reports(tape, simspec.rules.no_mark_within_m),
        decisions=tuple(
            (round(decision.time.s, 2), decision.value.action, decision.value.subject, decision.value.reason)
            for decision in tape.decisions[:MESSAGE_ROWS]
        ),
        decision_count=len(tape.decisions),
        frequent_actions=tuple(
            Counter(decision.value.action for decision in tape.decisions).most_common(FREQUENT_ACTIONS)
        ),
        malformed=tuple(
            (topic, count) for topic, count in sorted(tape.malformed.items()) if topic != CUT_RECORDING
        ),
        cut=CUT_RECORDING in tape.malformed,
        geofence_enu_m=_closed_ring(simspec.rules.geofence) if simspec.rules.geofence else (),
        no_fly=tuple(
            MapNoFly(no_fly.id, _closed_ring(no_fly.area), no_fly.from_s, no_fly.until_s)
            for no_fly in simspec.rules.no_fly
        ),
        roads=tuple(
            (road.id, tuple((point.east_m, point.north_m) for point in road.points), road.width_m)
            for road in simspec.world.roads
        ),
        areas=tuple((area.id, _closed_ring(area)) for area in simspec.world.areas),
        events=run_events(simspec, tape),
        consents=map_consents(tape),
        mark_consent=simspec.rules.mark_consent,
    )


def _closed_ring(area: Polygon) -> Track:
    corners = tuple((corner.east_m, corner.north_m) for corner in area.corners)
    return (*corners, corners[0])


def _flight(tape: Tape) -> tuple[tuple[float, float, float, float], ...]:
    times = tape.vehicle_time_s
    if len(times) == 0:
        return ()
    # The last sample counts, in spite of rounding in the steps.
    sample_times = np.arange(times[0], times[-1] + 1e-9, 1.0 / TRAJECTORY_HZ)
    # Where the tape has a gap, several of these times lead to one sample.
    samples = np.unique(np.clip(np.searchsorted(times, sample_times), 0, len(times) - 1))
    return tuple(
        (round(float(times[i]), 2), *(round(float(v), 1) for v in tape.vehicle_position_enu_m[i]))  # type: ignore[misc]
        for i in samples
    )


def _actors(tape: Tape) -> tuple[MapActor, ...]:
    if len(tape.actor_time_s) == 0:
        return ()
    # About one sample a second is enough at the speed of actors, and the simplification is a loop in Python.
    interval_s = float(np.median(np.diff(tape.actor_time_s))) if len(tape.actor_time_s) > 1 else 1.0
    step = max(1, round(1.0 / max(1e-9, interval_s)))
    paths = tape.actor_position_enu_m[::step, :, :2]
    return tuple(
        MapActor(member.id, member.role, member.class_label, rounded_track(_simplified(paths[:, index])))
        for index, member in enumerate(tape.cast)
    )


def _simplified(path: Floats) -> Floats:
    """The corners that Ramer-Douglas-Peucker keeps: the path stays within PATH_TOLERANCE_M of the lines between them."""
    # An actor that did not move keeps only its first corner.
    if np.linalg.norm(path - path[0], axis=1).max() <= PATH_TOLERANCE_M:
        return path[:1]
    line = shapely.simplify(shapely.LineString(path), PATH_TOLERANCE_M, preserve_topology=False)
    return np.asarray(shapely.get_coordinates(line), dtype=np.float64)
