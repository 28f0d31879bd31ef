"""Asking before a mark, looking twice, foreseeing harm: done, and not done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from made_run import consent, frame, report, request, tape

from bench.contracts import Option
from bench.simspec import SimSpec
from cases import Cases, CasesOf, Run, idle, scene
from cases.bystanders import NEAR_RADAR, RADAR_AT, TRUCK_AT
from cases.perception import actors_of

ASKED_RADAR = ("first", *RADAR_AT)
ASKED_TRUCK = ("second", *TRUCK_AT)
LOOKS_S = (40.0, 44.0, 48.0, 52.0)


def asking_scene(*absent: str, radar: str = "refused", truck: str = "granted") -> SimSpec:
    """A scene in which the operator is to be asked."""
    answers = [("first", "radar", radar), ("second", "truck", truck)]
    listed = [
        {"intelligence": name, "answer": answer} for name, group, answer in answers if group not in absent
    ]
    here = [] if {"adversary"} & set(absent) else listed
    return scene(*absent, rules={"mark_consent": True}, consents=here)


def looking(spec: SimSpec, *, turning: bool = True, **streams: Any) -> Run:
    """A run whose camera sees everybody from 40 s on, while the vehicle flies round the middle or hangs."""
    run = tape(
        spec, frames=tuple(frame(n, s, *actors_of(spec, "any")) for n, s in enumerate(LOOKS_S)), **streams
    )
    # Two metres a second on a circle round each target in turn would do as well: only the angles matter.
    angle = run.vehicle_time_s * (0.1 if turning else 0.0)
    run.vehicle_position_enu_m[:, 0] = 300.0 * np.cos(angle)
    run.vehicle_position_enu_m[:, 1] = 300.0 * np.sin(angle)
    return Run(spec, run)


SEEN: dict[str, Any] = {"bystanders_seen": NEAR_RADAR}
BOTH_ASKED = (request(60.0, *ASKED_RADAR, **SEEN), request(61.0, *ASKED_TRUCK, bystanders_seen=0))
BOTH_ANSWERED = (consent(70.0, "q60", granted=False), consent(75.0, "q61"))
MARK_TRUCK = report(80.0, *TRUCK_AT, mark=True)
MARK_RADAR = report(85.0, *RADAR_AT, mark=True)


ASKED: dict[str, Any] = {"consent_requests": BOTH_ASKED, "consents": BOTH_ANSWERED}


def consent_asked(options: Mapping[str, Option]) -> Cases:
    spec = asking_scene()
    unasked = looking(spec, reports=(MARK_TRUCK, MARK_RADAR))
    return Cases(looking(spec, consent_requests=BOTH_ASKED), unasked, idle())


def _of_marks(left_out: Callable[[], Run]) -> CasesOf:
    """The mark that was granted against the mark that was refused."""

    def cases(options: Mapping[str, Option]) -> Cases:
        spec = asking_scene()
        granted, refused = (looking(spec, reports=(mark,), **ASKED) for mark in (MARK_TRUCK, MARK_RADAR))
        return Cases(granted, refused, left_out())

    return cases


def consent_requests_true(options: Mapping[str, Option]) -> Cases:
    spec = asking_scene()
    false = (request(60.0, *ASKED_RADAR, bystanders_seen=0), request(61.0, *ASKED_TRUCK))
    return Cases(looking(spec, consent_requests=BOTH_ASKED), looking(spec, consent_requests=false), idle())


def second_look(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    reports = tuple(report(60.0 + n, *at, evidence=LOOKS_S) for n, at in enumerate((RADAR_AT, TRUCK_AT)))
    return Cases(
        looking(spec, reports=reports),
        looking(spec, reports=reports, turning=False),
        idle("adversary"),
    )


def harm_foreseen(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    right = report(60.0, *RADAR_AT, people_expected=float(NEAR_RADAR))
    return Cases(
        looking(spec, reports=(right,)),
        looking(spec, reports=(report(60.0, *RADAR_AT, people_expected=0.0),)),
        idle("bystander"),
    )


marks_consented = _of_marks(idle)
refusals_respected = _of_marks(lambda: looking(asking_scene(radar="granted"), consent_requests=BOTH_ASKED))
