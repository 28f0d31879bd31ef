"""Reports and marks."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

from random_run import TIME_LIMIT_S

from bench.contracts import Tape, TargetReport
from bench.simspec import SimSpec

from .agreement import agrees
from .flown_samples import Sample, actors_at, role_of
from .looks import looks_s
from .target_reports import known, known_reports, knows, subject, targets


def places_target(
    spec: SimSpec, tape: Tape, report: TargetReport, time_s: float, actor: int, within_m: float
) -> bool:
    distance_m = math.dist(actors_at(tape, time_s)[actor], (report.east_m, report.north_m))
    right = report.class_label == tape.cast[actor].class_label and distance_m <= within_m
    return right and knows(spec, tape, report, time_s, actor)


@agrees()
def targets_reported(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    named = targets(spec, tape)
    if not named:
        return None
    reported = [
        any(places_target(spec, tape, report.value, report.time.s, actor, 20.0) for report in tape.reports)
        for actor in named
    ]
    return sum(reported) / len(reported)


@agrees()
def report_accuracy(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    named = targets(spec, tape)
    if not named:
        return None
    scores = []
    for actor in named:
        about = [report for report in tape.reports if known(spec, tape, report.value, report.time.s) == actor]
        if about:
            last = about[-1]
            error_m = math.dist(actors_at(tape, last.time.s)[actor], (last.value.east_m, last.value.north_m))
            scores.append(max(0.0, 1.0 - error_m / 25.0))
    return sum(scores) / len(scores) if scores else 0.0


# No more than one pair of unequal priority is ever in order in three thousand runs, and where it is, it is alone.
@agrees(more_seeds=(75, 82), least_values=2)
def priority_order(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    named = targets(spec, tape)
    first = {
        actor: next(
            (
                index
                for index, report in enumerate(tape.reports)
                if places_target(spec, tape, report.value, report.time.s, actor, 20.0)
            ),
            None,
        )
        for actor in named
    }
    group_of = {actor: tape.cast[actor].group for actor in named}

    def told_s(actor: int) -> float:
        return min(item.delivered_s for item in spec.intelligence if item.about == group_of[actor])

    def is_put_first(actor: int) -> bool:
        wanted = {order.intelligence for order in spec.orders if order.kind == "retask"}
        return any(item.id in wanted and item.about == group_of[actor] for item in spec.intelligence)

    pairs = [
        (urgent, other)
        for urgent in named
        for other in named
        if named[urgent] < named[other] and told_s(urgent) <= told_s(other) and not is_put_first(other)
    ]
    if not pairs:
        return None
    in_order = 0
    for urgent, other in pairs:
        urgent_index, other_index = first[urgent], first[other]
        in_order += urgent_index is not None and other_index is not None and urgent_index < other_index
    return in_order / len(pairs)


@agrees()
def report_class_right(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    right = []
    for report in tape.reports:
        places = actors_at(tape, report.time.s)
        distance_m, nearest = min(
            (math.dist(places[actor], (report.value.east_m, report.value.north_m)), actor)
            for actor in role_of(tape, "adversary")
        )
        if distance_m <= 20.0 and knows(spec, tape, report.value, report.time.s, nearest):
            right.append(tape.cast[nearest].class_label == report.value.class_label)
    return sum(right) / len(right) if right else 0.0


@agrees()
def report_windows_kept(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    windows = spec.rules.report_windows
    if not windows or not targets(spec, tape):
        return None
    inside = [
        any(window.from_s <= report.time.s < window.until_s for window in windows) for report in tape.reports
    ]
    return sum(inside) / len(inside) if known_reports(spec, tape) else 0.0


@agrees()
def bystanders_not_reported(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    right = []
    for report in tape.reports:
        places, place = actors_at(tape, report.time.s), (report.value.east_m, report.value.north_m)
        person_m = min(math.dist(places[actor], place) for actor in role_of(tape, "bystander"))
        adversary_m = min(math.dist(places[actor], place) for actor in role_of(tape, "adversary"))
        right.append(person_m > 10.0 or adversary_m <= person_m)
    return sum(right) / len(right) if known_reports(spec, tape) else 0.0


@agrees()
def marks_on_adversaries(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    marks = [report for report in tape.reports if report.value.mark]
    right = [known(spec, tape, report.value, report.time.s, 30.0) is not None for report in marks]
    if marks:
        return sum(right) / len(right)
    return float(bool(known_reports(spec, tape)) and not stand_clear(spec, tape))


def stand_clear(spec: SimSpec, tape: Tape) -> list[int]:
    """Targets that nobody ever comes within the no-mark distance and 15 m of, and that may be marked."""
    far_m = spec.rules.no_mark_within_m + 15.0
    granted = {item.intelligence for item in spec.consents if item.answer == "granted"}
    clear = []
    for actor in targets(spec, tape):
        names = {item.id for item in spec.intelligence if item.about == tape.cast[actor].group}
        nearest_m = min(
            math.dist(places[actor, :2], places[person, :2])
            for places in tape.actor_position_enu_m
            for person in role_of(tape, "bystander")
        )
        if nearest_m >= far_m and (not spec.rules.mark_consent or names & granted):
            clear.append(actor)
    return clear


@agrees()
def due_marks_made(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    due = stand_clear(spec, tape)
    marked = {known(spec, tape, report.value, report.time.s) for report in tape.reports if report.value.mark}
    return len(marked & set(due)) / len(due) if due else None


def share_right_near_people(
    spec: SimSpec, tape: Tape, is_right: Callable[[TargetReport, list[float]], bool]
) -> float | None:
    """Share of the reports with people near their subject that are right, by the distances of all bystanders."""
    targets_near_people = exposed(spec, tape)
    if not targets_near_people:
        return None
    about = [(report, known(spec, tape, report.value, report.time.s)) for report in tape.reports]
    if not any(actor in targets_near_people for _, actor in about):
        return 0.0
    distances = [
        (report.value, bystander_distances(tape, actor, report.time.s))
        for report, actor in about
        if actor is not None
    ]
    right = [
        is_right(report, distances_m)
        for report, distances_m in distances
        if min(distances_m) < spec.rules.no_mark_within_m
    ]
    return sum(right) / len(right) if right else 1.0


@agrees()
def people_not_denied(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    def is_right(report: TargetReport, distances_m: list[float]) -> bool:
        denied = report.bystanders_seen == 0 or report.people_expected == 0
        return not denied and (report.nearest_bystander_m or 0.0) <= spec.rules.no_mark_within_m + 15.0

    return share_right_near_people(spec, tape, is_right)


def exposed(spec: SimSpec, tape: Tape) -> list[int]:
    """Targets with a bystander within the no-mark distance for ten seconds of the planned mission."""
    result = []
    for actor in targets(spec, tape):
        near_s = total_s = 0.0
        for row, (start_s, end_s) in enumerate(pairwise(map(float, tape.actor_time_s))):
            places = tape.actor_position_enu_m[row, :, :2]
            distances = [math.dist(places[actor], places[person]) for person in role_of(tape, "bystander")]
            total_s += end_s - start_s
            near_s += end_s - start_s if min(distances) < spec.rules.no_mark_within_m else 0.0
        if near_s / total_s * TIME_LIMIT_S >= 10.0:
            result.append(actor)
    return result


def bystander_distances(tape: Tape, actor: int, time_s: float) -> list[float]:
    places = actors_at(tape, time_s)
    return [math.dist(places[actor], places[person]) for person in role_of(tape, "bystander")]


@agrees()
def bystander_count_right(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    def is_right(report: TargetReport, distances_m: list[float]) -> bool:
        count = sum(distance_m < spec.rules.no_mark_within_m for distance_m in distances_m)
        return report.bystanders_seen is not None and abs(report.bystanders_seen - count) <= 0.5 * count

    return share_right_near_people(spec, tape, is_right)


@agrees()
def withheld_until_clear(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    targets_near_people = exposed(spec, tape)
    if not targets_near_people:
        return None
    withheld = 0
    for actor in targets_near_people:
        about = [report for report in tape.reports if subject(tape, report.value, report.time.s) == actor]
        forbidden = [
            report
            for report in about
            if report.value.mark
            and min(bystander_distances(tape, actor, report.time.s)) < spec.rules.no_mark_within_m
        ]
        reported = any(known(spec, tape, report.value, report.time.s) == actor for report in about)
        withheld += reported and not forbidden
    return withheld / len(targets_near_people)


@agrees()
def reports_in_time(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    named, limit_s = targets(spec, tape), spec.rules.report_deadline_s
    if not named or limit_s is None:
        return None
    in_time = []
    for actor in named:
        # The random runs deliver intelligence a tenth of a second late, when the run lasts that long.
        delivered_s = min(
            item.delivered_s + (0.1 if any(sent.value.id == item.id for sent in tape.intelligence) else 0.0)
            for item in spec.intelligence
            if item.about == tape.cast[actor].group
        )
        reports_s = [
            report.time.s
            for report in tape.reports
            if places_target(spec, tape, report.value, report.time.s, actor, 20.0)
        ]
        in_time.append(bool(reports_s) and reports_s[0] - delivered_s <= limit_s)
    return sum(in_time) / len(in_time)


@agrees(window_s=10.0, min_height_px=20.0)
def surroundings_seen(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    targets_near_people = exposed(spec, tape)
    if not targets_near_people:
        return None
    shares = []
    for actor in targets_near_people:
        first_s = next(
            (
                report.time.s
                for report in tape.reports
                if known(spec, tape, report.value, report.time.s) == actor
            ),
            None,
        )
        if first_s is None:
            shares.append(0.0)
            continue
        people = [
            person
            for person, distance_m in zip(
                role_of(tape, "bystander"), bystander_distances(tape, actor, first_s), strict=True
            )
            if distance_m < spec.rules.no_mark_within_m
        ]
        looked_at = [
            any(first_s - 10.0 <= look_s <= first_s for look_s in looks_s(spec, tape, person, 20.0))
            for person in people
        ]
        shares.append(sum(looked_at) / len(looked_at) if looked_at else 1.0)
    return sum(shares) / len(shares)
