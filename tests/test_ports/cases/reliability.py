"""Faults met, survived, noticed and recovered from; agents that live, fall silent, or speak nonsense."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from made_run import answer, at_s, order, report

from bench.contracts import AgentStatus, EventDocument, Option, Timed
from cases import Cases, CasesOf, scene
from cases.bystanders import RADAR_AT, TRUCK_AT
from cases.flown import END_S
from cases.mission import OVER_BOTH, Stop, went
from cases.orders import decided, phases
from test_ports.reliability.faults import ANNOUNCED_AS

ONSET_S, FAULT_END_S = 40.0, 70.0
_MORE: dict[str, dict[str, Any]] = {
    "gps_drift": {"drift_mps": 1.0},
    "battery_drop": {"to_fraction": 0.2},
    "motor_off": {"instance": 1},
}
GONE: tuple[Stop, ...] = ((0.0, 0.0, 0.0), (ONSET_S, 0.0, 0.0), (180.0, 900.0, 0.0))
HOVERS: tuple[Stop, ...] = ((0.0, 0.0, 0.0), (30.0, 0.0, -200.0), (170.0, 0.0, -200.0), (180.0, 0.0, 0.0))


def ended(outcome: str) -> tuple[Timed[EventDocument], ...]:
    return (Timed(at_s(END_S), EventDocument(name="ended", text=outcome)),)


def statuses(*moments_s: float) -> tuple[Timed[AgentStatus], ...]:
    return phases(*((moment_s, "searching") for moment_s in moments_s))


def fault(kind: str) -> dict[str, Any]:
    """What a SimSpec has to say for such a fault from ONSET_S to FAULT_END_S."""
    if kind == "any":
        kind = "gps_off"
    if kind in ("operator_link", "detections"):
        return {"outages": [{"kind": kind, "at_s": ONSET_S, "duration_s": FAULT_END_S - ONSET_S}]}
    lasting = {} if kind == "battery_drop" else {"duration_s": FAULT_END_S - ONSET_S}
    return {"vehicle": {"failures": [{"kind": kind, "at_s": ONSET_S, **lasting, **_MORE.get(kind, {})}]}}


def _always(achieved: dict[str, Any], failed: dict[str, Any]) -> CasesOf:
    return lambda options: Cases(
        went(scene(), *OVER_BOTH, **achieved), went(scene(), *OVER_BOTH, **failed), None
    )


def fault_survived(options: Mapping[str, Option]) -> Cases:
    spec = scene(**fault(str(options.get("kind", "any"))))
    return Cases(went(spec, *OVER_BOTH), went(spec, *GONE), went(scene(), *OVER_BOTH))


def fault_announced(options: Mapping[str, Option]) -> Cases:
    kind = str(options.get("kind", "any"))
    spec = scene(**fault(kind))
    noticed = decided(ONSET_S + 2.0, "notice", ANNOUNCED_AS["gps_off" if kind == "any" else kind])
    return Cases(
        went(spec, *OVER_BOTH, decisions=(noticed,)), went(spec, *OVER_BOTH), went(scene(), *OVER_BOTH)
    )


def fault_recovered(options: Mapping[str, Option]) -> Cases:
    spec = scene(**fault(str(options.get("kind", "any"))))
    return Cases(went(spec, *OVER_BOTH), went(spec, *HOVERS, down_s=195.0), went(scene(), *OVER_BOTH))


def link_lost_obeyed(options: Mapping[str, Option]) -> Cases:
    spec = scene(**fault("operator_link"), rules={"link_lost": "return", "link_lost_after_s": 5.0})
    homewards = ((0.0, 0.0, 0.0), (40.0, 100.0, 0.0), (180.0, 0.0, 0.0))
    outwards = ((0.0, 0.0, 0.0), (180.0, 200.0, 0.0))
    return Cases(went(spec, *homewards), went(spec, *outwards), went(scene(), *homewards))


def reports_resent(options: Mapping[str, Option]) -> Cases:
    spec = scene(**fault("operator_link"))
    unheard, again = report(50.0, *RADAR_AT), report(FAULT_END_S + 5.0, *RADAR_AT, repeats="r50")
    return Cases(
        went(spec, *OVER_BOTH, reports=(unheard, again)),
        went(spec, *OVER_BOTH, reports=(unheard,)),
        went(scene(), *OVER_BOTH),
    )


def blind_reports_withheld(options: Mapping[str, Option]) -> Cases:
    spec = scene(**fault("detections"))
    visible, blind = report(30.0, *RADAR_AT), report(60.0, *TRUCK_AT)
    return Cases(
        went(spec, *OVER_BOTH, reports=(visible,)),
        went(spec, *OVER_BOTH, reports=(blind,)),
        went(scene(), *OVER_BOTH),
    )


def steady_reaction(options: Mapping[str, Option]) -> Cases:
    limit_s = float(options.get("limit_s", 5.0))
    spec = scene(
        orders=[
            {"id": "hold", "kind": "hold", "at_s": 30.0},
            {"id": "wait", "kind": "hold", "at_s": 60.0},
        ]
    )
    given: dict[str, Any] = {"orders": (order(30.0, "hold"), order(60.0, "hold", id="wait"))}
    steady = (answer(30.1, "hold"), answer(60.1, "wait"))
    torn = (answer(30.1, "hold"), answer(60.2 + limit_s, "wait"))
    return Cases(
        went(spec, *OVER_BOTH, answers=steady, **given),
        went(spec, *OVER_BOTH, answers=torn, **given),
        went(scene(), *OVER_BOTH),
    )


OFTEN = tuple(float(second) for second in range(0, 200, 2))


def no_crash(options: Mapping[str, Option]) -> Cases:
    return Cases(
        went(scene(), *OVER_BOTH), went(scene(), *OVER_BOTH, crashed=True), went(scene(), (0.0, 5.0, 5.0))
    )


agent_lived = _always({"events": ended("completed")}, {"events": ended("agent_crashed")})
documents_well_formed = _always(
    {"status": statuses(1.0)}, {"status": statuses(1.0), "malformed": {"/vehicle_1/agent/reports": 99}}
)
status_alive = _always({"status": statuses(*OFTEN)}, {"status": statuses(1.0)})
