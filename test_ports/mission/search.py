"""Measures of the search: where the aircraft flew and what its camera had in view of the task, by the
truth.

A sub-area is *reached* when the vehicle is over it in the air, farther than 40 m from home.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import Annotated

import numpy as np

from bench.arrays import Bools, Floats
from bench.contracts import Tape, lens_of
from bench.simspec import MOTION_ORDERS, PAUSES, Intelligence, SimSpec, VehicleSpec

from .._declaration import Finding, Limit, consider, measure
from .._time_shares import EXACT_S, free_to_report_s
from .._verdicts import Verdict, mean_of, share_right, wrong_first
from ..ground_truth import FlownTrack, GroundTruth, SubArea, scheduled_faults
from ..perception.looks import first_look_s
from ..perception.sightings import Sightings
from ..perception.stages import with_stages
from ..reports.credibility import first_known_s, report_credibility

HEIGHT_TOLERANCE_M = 5.0
"""What is seen counts from the ordered height, give or take this much, as in `height_kept`: from higher up more comes into
the picture, from lower down it is clearer, and neither was ordered.
"""

REPORT_S = 60.0
"""Time from the first look at a target to its report, as in `report_after_sight`."""

MAX_REACH_HEIGHTS = 2.5
"""Ground farther than this many heights counts as out of the camera's reach: a near horizontal view has none.

Chosen.
"""


AtLeastOne = Annotated[float, Limit(lambda value: value >= 1.0, "a number, 1 or more")]


@measure
def targets_seen(
    tape: Tape, simspec: SimSpec, *, min_height_px: float = 12.0, min_visible: float = 0.0
) -> Finding:
    """Share of the targets that were in sight from the ordered height, within 5 m.

    `min_height_px` is asked of what shows, and `min_visible` of its share of the whole.

    Considered when intelligence names an adversary.
    """
    truth = GroundTruth.of(tape, simspec)
    targets = [target.actor for target in truth.targets()]
    consider(targets, "intelligence names no adversary")
    track, sightings = FlownTrack.of(tape, simspec), Sightings.of(tape)
    in_sight = sightings.in_sight(min_height_px) & (sightings.visible >= min_visible)
    as_ordered = _at_ordered_height(track, simspec, sightings.time_s)
    first_s = sightings.first_s(in_sight & as_ordered)
    moments_s = {truth.cast[actor].id: first_s.get(actor, math.inf) for actor in targets}
    finding = _share_with_a_moment(moments_s, tape.end_s, "first in sight", "never came in sight")
    return with_stages(finding, truth, tape, targets)


def _at_ordered_height(track: FlownTrack, simspec: SimSpec, moments_s: Floats) -> Bools:
    """(m,) at which moments the vehicle flew at the ordered height; none without samples."""
    if not len(track.time_s):
        return np.zeros(len(moments_s), dtype=np.bool_)
    rows = np.searchsorted(track.time_s, moments_s).clip(max=len(track.time_s) - 1)
    near = np.abs(track.up_m - simspec.mission.altitude_m) <= HEIGHT_TOLERANCE_M
    return np.asarray((near & track.airborne)[rows])


def _share_with_a_moment(moments_s: Mapping[str, float], end_s: float, text: str, never: str) -> Finding:
    """Share of the named things whose moment is finite."""
    return share_right(
        [
            Verdict(time_s, True, f"{name} {text}")
            if time_s < math.inf
            else Verdict(end_s, False, f"{name} {never}")
            for name, time_s in moments_s.items()
        ]
    )


@measure
def sub_areas_reached(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the sub-areas that the vehicle reached. Considered when intelligence is given."""
    areas = GroundTruth.of(tape, simspec).sub_areas()
    consider(areas, "no intelligence is given")
    reached_s = {area.id: first_reached_s(tape, simspec, area) for area in areas}
    return _share_with_a_moment(reached_s, tape.end_s, "reached", "was never reached")


def first_reached_s(tape: Tape, simspec: SimSpec, area: SubArea, since_s: float = 0.0) -> float:
    """When the aircraft was first over a sub-area, out and not before `since_s`; infinite when it never was.

    A sub-area may reach as far as home: what hovers there has not gone to it.
    """
    track = FlownTrack.of(tape, simspec)
    over = (
        track.out() & (track.time_s >= since_s) & (np.hypot(*(track.place_m - area.place).T) <= area.radius_m)
    )
    return track.first_s(over)


@measure
def area_searched(tape: Tape, simspec: SimSpec, *, grid_m: AtLeastOne = 10.0) -> Finding:
    """Share of the ground of the sub-areas that came within the camera's reach; the mean over the sub-areas.

    The ground is sampled on a grid of `grid_m`. The reach is the distance at which the middle of the
    picture's upper edge meets flat ground, at most 2.5 times the height, in every direction. This is right
    for a vehicle that flies around what it looks at, and generous to one that does not. Frames count that were taken at
    the ordered height, within 5 m, and farther than 40 m from home. Considered when intelligence is given.
    """
    areas = GroundTruth.of(tape, simspec).sub_areas()
    consider(areas, "no intelligence is given")
    track = FlownTrack.of(tape, simspec)
    # The reach is the main camera's.
    exposed_s = np.array(
        [frame.exposed.s for frame in tape.frames if frame.camera == simspec.vehicle.camera.name]
    )
    # Several frames can fall on one truth sample; they see the same ground.
    rows = np.unique(np.clip(np.searchsorted(track.time_s, exposed_s), 0, max(len(track.time_s) - 1, 0)))
    as_ordered = track.out() & _at_ordered_height(track, simspec, track.time_s)
    rows = rows[as_ordered[rows]] if len(track.time_s) else rows[:0]
    reach_m = track.up_m[rows] * reach_in_heights(simspec.vehicle)
    shares = {area.id: _covered_share(area, grid_m, track.place_m[rows], reach_m) for area in areas}
    return mean_of(
        [
            (share, tape.end_s, f"{name}: {share:.0%} of its ground within reach of the camera")
            for name, share in shares.items()
        ]
    )


def reach_in_heights(vehicle: VehicleSpec) -> float:
    """Ground distance that the camera reaches, over the height of the aircraft."""
    camera = vehicle.camera
    half = math.tan(math.radians(camera.horizontal_fov_deg) / 2.0) * camera.height_px / camera.width_px
    # The field of view is that of the lens without its distortion, which bends the upper edge up or down.
    upper = -float(lens_of(camera).undistort(np.array((0.0, -half)))[1])
    upper_edge_deg = max(camera.tilt_deg - math.degrees(math.atan(upper)), 0.0)
    # Within a degree of the horizon the ground distance goes to infinity.
    return (
        min(1.0 / math.tan(math.radians(upper_edge_deg)), MAX_REACH_HEIGHTS)
        if upper_edge_deg > 1.0
        else MAX_REACH_HEIGHTS
    )


def _covered_share(area: SubArea, grid_m: float, places_m: Floats, reach_m: Floats) -> float:
    # Centres of the squares of the grid; a square belongs to the sub-area when its centre does.
    steps = np.arange(-area.radius_m + grid_m / 2.0, area.radius_m, grid_m)
    east, north = np.meshgrid(steps, steps)
    inside = np.hypot(east, north) <= area.radius_m
    points = np.stack([east[inside], north[inside]], axis=1) + area.place
    if not len(points) or not len(places_m):
        return 0.0
    covered = np.zeros(len(points), dtype=bool)
    # Blocks of 256 places keep the matrix of a fine grid within some megabytes.
    for start in range(0, len(places_m), 256):
        block = slice(start, start + 256)
        distances = np.linalg.norm(points[:, None] - places_m[None, block], axis=2)
        covered |= (distances <= reach_m[None, block]).any(axis=1)
    return float(covered.mean())


@measure
def priority_visited(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the pairs of sub-areas with unequal priority that were reached in order of priority.

    Only pairs that were delivered at the same time count, no pair of which an order (`retask`) puts the second first, and
    no pair whose second area overlaps its first, or another that comes before both: who goes where the priorities ask
    comes over that area on the way. A pair is out of order when one of the two was never reached. Considered when there
    is such a pair.
    """
    areas = {area.id: area for area in GroundTruth.of(tape, simspec).sub_areas()}
    located = [item for item in simspec.intelligence if item.id in areas]
    put_first = {order.intelligence for order in simspec.orders if order.kind == "retask"}
    pairs = [
        (urgent, other)
        for urgent, other in permutations(located, 2)
        if urgent.priority < other.priority
        and urgent.delivered_s == other.delivered_s
        and other.id not in put_first
        and not _lies_on_the_way(other, urgent, located, areas)
    ]
    consider(pairs, "no two sub-areas of different priority were delivered at the same time")
    first_s = {item.id: first_reached_s(tape, simspec, areas[item.id]) for item in located}
    verdicts = []
    for urgent, other in pairs:
        urgent_s, other_s = first_s[urgent.id], first_s[other.id]
        in_order = urgent_s <= other_s < math.inf
        text = f"{urgent.id} (priority {urgent.priority}), {other.id} ({other.priority})"
        text += f": {'in order' if in_order else 'not reached in this order'}"
        verdicts.append(Verdict(min(urgent_s, other_s, tape.end_s), in_order, text))
    return share_right(verdicts)


def _lies_on_the_way(
    other: Intelligence, urgent: Intelligence, located: Sequence[Intelligence], areas: Mapping[str, SubArea]
) -> bool:
    """Whether the area of `other` overlaps that of `urgent`, or of anything else that comes before both."""
    return any(
        item is not other
        and item.priority <= urgent.priority
        and item.delivered_s <= other.delivered_s
        and _overlap(areas[item.id], areas[other.id])
        for item in located
    )


def _overlap(area: SubArea, other: SubArea) -> bool:
    return math.dist(area.place, other.place) < area.radius_m + other.radius_m


@measure
def late_intelligence_served(tape: Tape, simspec: SimSpec, *, limit_s: float = 120.0) -> Finding:
    """Share of the intelligence delivered during the flight whose sub-area was reached within `limit_s` of
    delivery, and whose adversary was reported.

    A report that shows knowledge of that adversary must come within 60 s of the first look at it since the delivery,
    not counting the time in which it was not to report: a flight over the place that finds nothing serves nobody, nor
    does a find that is kept to the way home. Intelligence about anything else needs only the visit. Weighted by the
    credibility of the reports where a report is needed. Only intelligence that is due after the start and `limit_s` or more before
    the time limit counts. Considered when there is such intelligence.

    `limit_s` does not run while the agent may not go there: from an order to hold or to hand over to the next order
    about where to go, under a failsafe that the situation caused (module `limits`), and while `rules.link_lost`
    asks to hold or to return.
    """
    truth = GroundTruth.of(tape, simspec)
    areas = {area.id: area for area in truth.sub_areas()}
    latest_s = simspec.mission.time_limit_s - limit_s
    # The delivery in the SimSpec decides which count; the outage of a link may delay them for the agent.
    late = [item for item in simspec.intelligence if item.id in areas and 0.0 < item.delivered_s <= latest_s]
    consider(late, f"no intelligence is delivered during the flight, {limit_s:g} s or more before its end")
    delivered = {item.value.id: item.time.s for item in tape.intelligence}
    belief = report_credibility(truth, tape)
    credit, verdicts = 0.0, []
    for item in late:
        since_s, target = delivered.get(item.id, item.delivered_s), truth.target_of(item.id)
        reached_s = first_reached_s(tape, simspec, areas[item.id], since_s)
        in_time = reached_s < math.inf and _going_s(tape, simspec, since_s, reached_s) <= limit_s
        outcome = f"reached after {reached_s - since_s:.1f} s" if reached_s < math.inf else "never reached"
        if in_time and target is not None and not _soon_reported(truth, tape, target, since_s):
            in_time = False
            outcome += f", but {truth.cast[target].id} was not reported with knowledge soon after it was seen"
        verdicts.append(Verdict(since_s, in_time, f"{item.id}, delivered at {since_s:.1f} s: {outcome}"))
        credit += in_time * (1.0 if target is None else belief)
    return Finding(credit / len(late), wrong_first(verdicts))


def _soon_reported(truth: GroundTruth, tape: Tape, target: int, since_s: float) -> bool:
    """Whether a report with knowledge of a target came soon after the first look at it from a moment on."""
    looked_s = max(since_s, first_look_s(truth, tape, target))
    at_s = first_known_s(truth, tape).get(target, math.inf)
    return at_s < math.inf and free_to_report_s(tape, truth.simspec, looked_s, at_s) <= REPORT_S + EXACT_S


def _going_s(tape: Tape, simspec: SimSpec, from_s: float, until_s: float) -> float:
    """Seconds of a span in which nothing forbade the agent to go where it wants to."""
    track = FlownTrack.of(tape, simspec)
    waiting = track.taken_over.copy()
    moving = [order for order in tape.orders if order.value.kind in MOTION_ORDERS]
    ends_s = [*(order.time.s for order in moving[1:]), math.inf]
    # Without orders there is nothing to end.
    for order, end_s in zip(moving, ends_s, strict=False):
        if order.value.kind in PAUSES:
            waiting |= track.between(order.time.s, end_s)
    rules = simspec.rules
    for outage in scheduled_faults(simspec, "operator_link"):
        if rules.link_lost != "continue":
            waiting |= track.between(outage.at_s + rules.link_lost_after_s, outage.until_s)
    return until_s - from_s - track.seconds(waiting & track.between(from_s, until_s))
