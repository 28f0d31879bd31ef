"""Asking before a mark, looking twice, foreseeing harm: done, and not done."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from made_run import consent, frame, report, request, tape

from bench.contracts import Option
from bench.simspec import SimSpec
from cases import Cases, Run, scene
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


def _without_rule() -> Run:
    spec = scene()
    return Run(spec, tape(spec))


def _consent_asked(options: Mapping[str, Option]) -> Cases:
    spec = asking_scene()
    return Cases(
        looking(spec, consent_requests=BOTH_ASKED),
        looking(spec, reports=(MARK_TRUCK, MARK_RADAR)),
        _without_rule(),
    )


def _marks_consented(options: Mapping[str, Option]) -> Cases:
    spec = asking_scene()
    request_run: dict[str, Any] = {"consent_requests": BOTH_ASKED, "consents": BOTH_ANSWERED}
    return Cases(
        looking(spec, reports=(MARK_TRUCK,), **request_run),
        looking(spec, reports=(MARK_RADAR,), **request_run),
        _without_rule(),
    )


def _refusals_respected(options: Mapping[str, Option]) -> Cases:
    spec = asking_scene()
    granted = asking_scene(radar="granted")
    request_run: dict[str, Any] = {"consent_requests": BOTH_ASKED, "consents": BOTH_ANSWERED}
    return Cases(
        looking(spec, reports=(MARK_TRUCK,), **request_run),
        looking(spec, reports=(MARK_RADAR,), **request_run),
        looking(granted, consent_requests=BOTH_ASKED),
    )


def _consent_requests_true(options: Mapping[str, Option]) -> Cases:
    spec = asking_scene()
    false = (request(60.0, *ASKED_RADAR, bystanders_seen=0), request(61.0, *ASKED_TRUCK))
    return Cases(
        looking(spec, consent_requests=BOTH_ASKED), looking(spec, consent_requests=false), _without_rule()
    )


def _second_look(options: Mapping[str, Option]) -> Cases:
    spec, nobody = scene(), scene("adversary")
    reports = tuple(report(60.0 + n, *at, evidence=LOOKS_S) for n, at in enumerate((RADAR_AT, TRUCK_AT)))
    return Cases(
        looking(spec, reports=reports),
        looking(spec, reports=reports, turning=False),
        Run(nobody, tape(nobody)),
    )


def _harm_foreseen(options: Mapping[str, Option]) -> Cases:
    spec, nobody = scene(), scene("bystander")
    right = report(60.0, *RADAR_AT, people_expected=float(NEAR_RADAR))
    return Cases(
        looking(spec, reports=(right,)),
        looking(spec, reports=(report(60.0, *RADAR_AT, people_expected=0.0),)),
        Run(nobody, tape(nobody)),
    )


CASES = {
    "consent_asked": _consent_asked,
    "marks_consented": _marks_consented,
    "refusals_respected": _refusals_respected,
    "consent_requests_true": _consent_requests_true,
    "second_look": _second_look,
    "harm_foreseen": _harm_foreseen,
}
