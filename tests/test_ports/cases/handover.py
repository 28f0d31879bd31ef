"""The vehicle handed over and taken back, and perception that becomes worse; told and acted upon, or not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from made_run import report

from bench.contracts import Option
from cases import Cases, Run, scene
from cases.bystanders import RADAR_AT, TRUCK_AT
from cases.orders import (
    GOES_ON,
    IGNORED,
    OBEYED,
    STANDS_BEFORE,
    STANDS_LONG,
    TAKEN_BACK,
    Stop,
    carried_out,
    decided,
    flew,
    ordered,
)

ONSET_S, END_S = 60.0, 100.0
NOWHERE: tuple[Stop, ...] = (*STANDS_BEFORE[:4], (100.0, 0.0, -250.0, 60.0), (180.0, 0.0, -250.0, 60.0))
TOLD = (decided(64.0, "degraded", "detections"), decided(104.0, "restored", "detections"))


def worse(kind: str = "detections_degraded", **changes: Any) -> Any:
    """A scene whose detections are worse from ONSET_S to END_S."""
    share = {"lost_share": 0.5} if kind == "detections_degraded" else {}
    outage = {"kind": kind, "at_s": ONSET_S, "duration_s": END_S - ONSET_S, **share}
    return scene(outages=[outage], **changes)


def stating(*decisions: Any, **streams: Any) -> Run:
    return flew(worse(), *STANDS_LONG, decisions=decisions, **streams)


def hands_off_kept(options: Mapping[str, Option]) -> Cases:
    return Cases(carried_out("hand_over", OBEYED), carried_out("hand_over", IGNORED), flew(scene(), *GOES_ON))


def mission_resumed(options: Mapping[str, Option]) -> Cases:
    spec, delivered = ordered("take_back")
    return Cases(
        carried_out("take_back", OBEYED),
        flew(spec, *NOWHERE, **delivered, **TAKEN_BACK),
        flew(scene(), *GOES_ON),
    )


def _stated(options: Mapping[str, Option]) -> Cases:
    return Cases(stating(*TOLD), stating(), flew(scene(), *GOES_ON))


def degraded_reports_modest(options: Mapping[str, Option]) -> Cases:
    first, sure = report(40.0, *RADAR_AT), report(80.0, *TRUCK_AT)
    modest = report(80.0, *TRUCK_AT, confidence=0.7)
    return Cases(
        stating(*TOLD, reports=(first, modest)),
        stating(*TOLD, reports=(first, sure)),
        flew(scene(), *GOES_ON, reports=(first, sure)),
    )


degradation_announced = _stated
perception_state_true = _stated
