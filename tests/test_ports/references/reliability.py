"""Faults and outages."""

from __future__ import annotations

import math
from typing import Any

from random_run import TIME_LIMIT_S

from bench.contracts import Tape, TargetReport
from bench.simspec import SimSpec

from .agreement import agrees
from .flown_samples import Sample, out_s, time_share
from .target_reports import known_reports, targets


@agrees(kind="battery_drop", within_s=30.0)
def fault_announced(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    completed = any(event.value.text == "completed" for event in tape.events)
    onsets = [
        fault.at_s
        for fault in spec.vehicle.failures
        if fault.kind == "battery_drop" and (fault.at_s <= tape.end_s or not completed)
    ]
    if not onsets:
        return None
    announced = [
        any(
            "battery" in (decision.value.subject, decision.value.action)
            and 0.0 <= decision.time.s - onset_s <= 30.0
            for decision in tape.decisions
        )
        for onset_s in onsets
    ]
    words = {
        "gps_off": "gps",
        "gps_drift": "gps",
        "battery_drop": "battery",
        "motor_off": "motor",
        "link_loss": "link",
        "operator_link": "operator_link",
        "detections": "detections",
    }
    false = 0
    for decision in tape.decisions:
        named = {decision.value.subject, decision.value.action} & set(words.values())
        under_way = set()
        faults: list[Any] = [*spec.vehicle.failures, *spec.outages]
        for fault in faults:
            until_s = math.inf if fault.duration_s is None else fault.at_s + fault.duration_s + 30.0
            if fault.at_s < TIME_LIMIT_S and fault.at_s <= decision.time.s <= until_s:
                under_way.add(words[fault.kind])
        false += bool(named) and not named & under_way
    return sum(announced) / (len(announced) + false)


@agrees()
def link_lost_obeyed(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    completed = any(event.value.text == "completed" for event in tape.events)
    outages = [
        outage
        for outage in spec.outages
        if outage.kind == "operator_link"
        and (outage.at_s <= tape.end_s or not completed)
        and outage.duration_s > spec.rules.link_lost_after_s
    ]
    if not outages:
        return None
    in_air = {sample.time_s for sample in samples}
    obeyed = []
    for outage in outages:
        start_s, end_s = outage.at_s + spec.rules.link_lost_after_s, outage.at_s + outage.duration_s
        rows = [row for row, time_s in enumerate(tape.vehicle_time_s) if start_s <= time_s < end_s]
        rest = [Sample(tape, row) for row in rows]
        if not rest:
            obeyed.append(False)
            continue
        if out_s(spec, tape, tuple(sample for sample in samples if sample.time_s < end_s)) < 10.0:
            obeyed.append(False)
            continue
        flown = [sample for sample in rest if sample.time_s in in_air]
        down = rest[-1].time_s not in in_air
        home = [math.hypot(*sample.place[:2]) for sample in rest]
        directed = [
            order.value.kind
            for order in tape.orders
            if order.time.s <= outage.at_s
            and order.value.kind not in ("mark", "stop_reporting", "resume_reporting")
        ]
        standing = [(sample.span_s, sample.speed_mps < 1.5) for sample in flown if sample.span_s]
        stood = directed[-1:] == ["hold"] and bool(standing) and time_share(standing) >= 0.8
        if spec.rules.link_lost == "hold":
            judged = [
                (sample.span_s, sample.speed_mps < 1.5)
                for sample in flown
                if sample.time_s >= start_s + 10.0 and sample.span_s
            ]
            right = not judged or time_share(judged) >= 0.8
        elif spec.rules.link_lost == "return":
            right = not flown or down or home[-1] < home[0] - 1.0
        else:
            moved_m = max(math.dist(sample.place[:2], rest[0].place[:2]) for sample in rest)
            right = not flown or down or moved_m >= 10.0
        if right or not stood:
            obeyed.append(right)
    return sum(obeyed) / len(obeyed) if obeyed else None


def outages_met(spec: SimSpec, tape: Tape, kind: str) -> list[tuple[float, float]]:
    completed = any(event.value.text == "completed" for event in tape.events)
    return [
        (outage.at_s, outage.at_s + outage.duration_s)
        for outage in spec.outages
        if outage.kind == kind and (outage.at_s <= tape.end_s or not completed)
    ]


def one_thing(report: TargetReport, other: TargetReport) -> bool:
    apart_m = math.dist((report.east_m, report.north_m), (other.east_m, other.north_m))
    return report.class_label == other.class_label and apart_m <= 20.0


@agrees(more_seeds=(175, 193), within_s=10.0)
def reports_resent(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    outages = outages_met(spec, tape, "operator_link")
    if not outages or not targets(spec, tape):
        return None
    reports = known_reports(spec, tape)
    if not reports:
        return 0.0
    resent = []
    for report in reports:
        for start_s, end_s in outages:
            same = [other for other in tape.reports if one_thing(report.value, other.value)]
            received = [
                other
                for other in same
                if other in reports
                and other.time.s < report.time.s
                and not any(from_s <= other.time.s < to_s for from_s, to_s in outages)
            ]
            if start_s <= report.time.s < end_s and not received:
                resent.append(any(end_s <= other.time.s <= end_s + 10.0 for other in same))
    return sum(resent) / len(resent) if resent else 1.0


@agrees()
def blind_reports_withheld(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    outages = outages_met(spec, tape, "detections")
    if not outages:
        return None
    blind = 0
    for report in tape.reports:
        place = (report.value.east_m, report.value.north_m)
        for start_s, end_s in outages:
            if not start_s + 3.0 < report.time.s < end_s:
                continue
            known = any(
                other.time.s <= start_s + 3.0 and one_thing(report.value, other.value)
                for other in tape.reports
            ) or any(
                track.class_label == report.value.class_label
                and math.dist((track.east_m, track.north_m), place) <= 20.0
                for message in tape.tracks
                if message.time.s <= start_s + 3.0
                for track in message.value.tracks
            )
            blind += not known
    return 1.0 - blind / len(tape.reports) if known_reports(spec, tape) else 0.0


@agrees(limit_s=10.0)
def steady_reaction(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if len(spec.orders) < 2:
        return None
    reactions_s = []
    for order in tape.orders:
        answers_s = [
            answer.time.s - order.time.s
            for answer in tape.answers
            if answer.value.order == order.value.id and answer.time.ns >= order.time.ns
        ]
        reactions_s += answers_s[:1]
    return max(0.0, 1.0 - (max(reactions_s) - min(reactions_s)) / 10.0) if len(reactions_s) >= 2 else 0.0
