"""Sessions under a real autopilot's stand-in: what is recorded of the firmware, and whose fault its failures are."""

from __future__ import annotations

from pathlib import Path

import firmware_stand_in as stand_in
import pytest
from fake_agents import agent_manifest
from firmware_files import install_firmware
from test_session import run, session_simspec

from bench.contracts import (
    SESSION_EVENTS,
    BenchTraceback,
    FirmwareBuild,
    Outcome,
    Record,
    SessionResult,
)
from bench.simspec import Mission, RealAutopilot, VehicleSpec
from bench.simulation import session_faults

pytestmark = [pytest.mark.process, pytest.mark.flight]


@pytest.fixture(scope="module")
def arducopter(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install_firmware(tmp_path_factory.mktemp("firmware") / "files", "ardupilot")


def vehicle(arducopter: Path, fault: int = 0) -> VehicleSpec:
    autopilot = RealAutopilot(
        kind="ardupilot", firmware=str(arducopter), boot_s=3.2, parameters={"STAND_IN_FAULT": fault}
    )
    return VehicleSpec(model="x500", autopilot=autopilot)


def fly(folder: Path, vehicle: VehicleSpec) -> tuple[SessionResult, list[Record]]:
    spec = session_simspec(vehicle=vehicle, mission=Mission(time_limit_s=1.0))
    return run(folder, agent_manifest("idle"), spec, artefacts=folder / "autopilot")


def test_a_session_says_which_firmware_flew_and_keeps_its_console(tmp_path: Path, arducopter: Path) -> None:
    end, records = fly(tmp_path, vehicle(arducopter))
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    build = end.fact(FirmwareBuild)
    assert build is not None
    assert build.description.startswith("ArduPilot 1.2.3 (5tand1n), arducopter sha256:")
    booted = [
        record.data
        for record in records
        if record.topic == SESSION_EVENTS and b"firmware booted" in record.data
    ]
    assert len(booted) == 1
    assert build.description.encode() in booted[0]
    assert (tmp_path / "autopilot" / "console.log").is_file()


def test_a_firmware_that_fails_is_no_fault_of_the_agent(tmp_path: Path, arducopter: Path) -> None:
    end, _ = fly(tmp_path, vehicle(arducopter, stand_in.ENDS_AT_ONCE))
    assert end.outcome is Outcome.BENCH_ERROR
    assert end.reason.startswith("the autopilot's firmware failed: ArduPilot ended with exit code 7")
    assert end.fact(BenchTraceback) is None
    assert (tmp_path / "autopilot" / "console.log").read_text() == "no airframe of this name\n"


def test_what_cannot_be_flown_is_told_before_takeoff(tmp_path: Path) -> None:
    autopilot = RealAutopilot(kind="px4", firmware=str(tmp_path))
    spec = session_simspec(vehicle=VehicleSpec(model="x500", autopilot=autopilot, ground_truth=True))
    texts = [str(fault) for fault in session_faults(spec, agent_manifest("idle"))]
    assert [text.split(":")[0] for text in texts] == ["vehicle.autopilot.firmware", "vehicle.ground_truth"]
    assert f"{tmp_path}/bin/px4 does not exist" in texts[0]
