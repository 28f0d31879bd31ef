"""Agents fly by the topics and services of an ArduPilot: in lockstep twice alike, and what of them is wrong is told."""

from __future__ import annotations

from pathlib import Path

from test_session import session_simspec
from test_session_px4_topics import fly

from bench.contracts import AgentManifest, Outcome
from bench.simspec import AgentSpec, Home, Mission, Pace, SimSpec, VehicleSpec

COMPANION = Path(__file__).with_name("ap_companion.py")


def manifest(*arguments: str) -> AgentManifest:
    return AgentManifest(
        name="companion",
        command=("{python}", str(COMPANION), *arguments),
        pace=("lockstep", "warp", "realtime"),
        mavlink=(),
        ap_dds="2025-12",
        isolation="none",
    )


def spec(time_limit_s: float = 90.0, **pace: object) -> SimSpec:
    return session_simspec(
        vehicle=VehicleSpec(model="x500", autopilot="ardupilot", home=Home(east_m=5, north_m=5)),
        mission=Mission(time_limit_s=time_limit_s),
        agent=AgentSpec(manifest="companion"),
        pace=Pace.model_validate({"mode": "lockstep", "tick_s": 0.1, **pace}),
    )


def test_it(tmp_path: Path) -> None:
    flights = [fly(tmp_path / name, manifest("early"), spec()) for name in ("a", "b")]
    end, records, said = flights[0]
    print(said, end.reason)
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert records == flights[1][1]
    assert said == flights[1][2]
    assert 0
