"""Firmware that joins from outside, by the entry-point group rebar.firmware: two kinds that have nothing in common."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import EntryPoint
from typing import Any

import pytest
from pydantic import Field
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import simspec

from bench.contracts import VehiclePlan, losses_of, plugins
from bench.documents import Document, dump_json, validate_document
from bench.errors import Fault, FirmwareFault, SetupError
from bench.simspec import PluginAutopilot, RealAutopilot, SimSpec, VehicleSpec
from vehicle_models import open_x500
from vehicle_models.firmware import (
    ARDUPILOT,
    PX4,
    ROTORS,
    FirmwareKind,
    FirmwarePlan,
    FirmwareX500,
    MavlinkPort,
    RunningFirmware,
)

AUTO_RTL_OF_PX4, GUIDED_OF_ARDUPILOT = 0x05040000, 4


class ThrottleOptions(Document):
    share: float = Field(ge=0.0, le=1.0)


class RelayOptions(Document):
    says: tuple[str, ...] = ()
    breaks: bool = False


class Port:
    """Keeps what comes, and sends what it is given."""

    def __init__(self, custom_mode: int) -> None:
        packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0, custom_mode, 4, 3)
        self.waiting = [bytes(heartbeat.pack(packer))]
        self.heard: list[bytes] = []

    def read(self) -> list[bytes]:
        frames, self.waiting = self.waiting, []
        return frames

    def send(self, frames: list[bytes]) -> None:
        self.heard += frames


class Running(RunningFirmware):
    """Rotors at one speed; notes in order what the bench calls."""

    def __init__(self, plan: FirmwarePlan, share: float, custom_mode: int) -> None:
        self.plan, self.share = plan, share
        self.armed: bool | None = share > 0.0
        self.estimate_port: MavlinkPort = Port(custom_mode)
        self.ports: Mapping[str, MavlinkPort] = {link.name: self.estimate_port for link in plan.links}
        self.connections: Sequence[MavlinkPort] = [self.estimate_port]
        self.calls: list[str] = []

    def fly_sample(self, *, new_fix: bool) -> None:
        self.calls.append("sample")
        self.plan.body.plant.turn_rotors([self.share] * len(ROTORS))
        self.plan.body.plant.advance()

    def wait_step(self) -> None:
        self.calls.append("wait")

    def last_words(self) -> str:
        return ""

    def counters(self) -> Mapping[str, int]:
        return {"firmware_late_samples": 3}


class Relay(Running):
    """Keeps its own time: until the agent has started it stands for two further steps."""

    def stand_by(self, stand: Callable[[], None]) -> None:
        self.calls.append("stand by")
        stand()
        stand()

    def end_stand_by(self) -> None:
        self.calls.append("end")
        assert isinstance(self.plan.options, RelayOptions)
        if self.plan.options.breaks:
            raise FirmwareFault("it went away while it stood by")


class Throttle:
    name = "Throttle"
    modes = "px4"
    options: type[Document] = ThrottleOptions
    samples_hz = 200
    boot_s = 1.0
    estimate_hz: float | None = None
    logs: Sequence[str] = ()

    def __init__(self) -> None:
        self.running: list[Running] = []

    def identity(self, options: Document) -> str:
        assert isinstance(options, ThrottleOptions)
        return f"throttle at {options.share:g}"

    def faults(self, plan: VehiclePlan, options: Document) -> list[Fault]:
        warp = plan.simspec.pace.mode == "warp"
        return [Fault("pace.mode", "no throttle goes at warp", "slow down")] if warp else []

    @contextmanager
    def open(self, plan: FirmwarePlan) -> Generator[Running]:
        assert isinstance(plan.options, ThrottleOptions)
        self.running.append(Running(plan, plan.options.share, AUTO_RTL_OF_PX4))
        yield self.running[-1]


class RelayKind(Throttle):
    name = "Relay"
    modes = "ardupilot"
    options: type[Document] = RelayOptions
    samples_hz = 400
    boot_s = 0.1

    def identity(self, options: Document) -> str:
        assert isinstance(options, RelayOptions)
        return f"relay that says {' '.join(options.says)}"

    @contextmanager
    def open(self, plan: FirmwarePlan) -> Generator[Running]:
        self.running.append(Relay(plan, 0.0, GUIDED_OF_ARDUPILOT))
        yield self.running[-1]


throttle, relay = Throttle(), RelayKind()


@pytest.fixture(autouse=True)
def declared(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("throttle", "relay"):
        entry = EntryPoint(name, f"{__name__}:{name}", "rebar.firmware")
        monkeypatch.setitem(plugins("rebar.firmware"), name, entry)


def plan_of(
    kind: str, pace: str = "lockstep", vehicle: Mapping[str, Any] | None = None, **given: Any
) -> VehiclePlan:
    carried = {"autopilot": {"kind": kind, **given}, "simulation_control": False, **(vehicle or {})}
    return VehiclePlan(simspec(vehicle=carried, pace={"mode": pace}), ())


def refused(plan: VehiclePlan) -> list[str]:
    with pytest.raises(SetupError) as raised, open_x500(plan):
        pass
    return [str(fault) for fault in raised.value.faults]


def test_each_kind_flies_by_its_own_options_and_names_its_own_modes() -> None:
    """At full throttle, at none, and by the other kind, whose description and modes are its own."""
    heights_m = []
    for share in (1.0, 0.0):
        with open_x500(plan_of("throttle", options={"share": share}, boot_s=0.02)) as vehicle:
            assert isinstance(vehicle, FirmwareX500)
            assert vehicle.boot().endswith(f", throttle at {share:g}")
            for _ in range(50):
                vehicle.step()
            heights_m.append(vehicle.truth().position_enu_m[2])
            assert vehicle.condition().armed == (share > 0.0)
            assert vehicle.condition().mode == "AUTO_RTL"
            assert losses_of(vehicle.counters()) == {"sensor samples sent late to the autopilot": 3}
    assert heights_m[0] > 2.0
    assert abs(heights_m[1]) < 0.02
    with open_x500(plan_of("relay", options={"says": ["a", "b"]})) as vehicle:
        assert isinstance(vehicle, FirmwareX500)
        assert vehicle.boot() == "Relay of a version that it does not tell, relay that says a b"
        assert vehicle.condition().mode == "GUIDED"


def test_what_keeps_real_time_is_waited_for_on_the_ground_and_stands_by_until_the_first_step() -> None:
    """Five steps of eight samples before the session, two more while the agent starts, then none that nobody asked for."""
    ground = [*["sample"] * 8, "wait"]
    with open_x500(plan_of("relay")) as vehicle:
        assert isinstance(vehicle, FirmwareX500)
        vehicle.boot()
        assert relay.running[-1].calls == [*ground * 5, "stand by", *ground * 2]
        vehicle.step()
        vehicle.step()
        assert relay.running[-1].calls[-18:] == ["end", *["sample"] * 8] * 2
        assert vehicle.time.s == pytest.approx(0.04)
    with open_x500(plan_of("relay", options={"breaks": True}, boot_s=0.2)) as vehicle:
        assert isinstance(vehicle, FirmwareX500)
        vehicle.boot()
        assert relay.running[-1].calls.count("wait") == 12
        assert relay.running[-1].plan.boot_s == 0.2
        with pytest.raises(FirmwareFault, match="went away while it stood by"):
            vehicle.step()


def test_faults_name_the_field_the_kinds_there_are_and_the_remedy() -> None:
    for wrong, remedy in (
        ("thottle", "or install its package"),
        ("px4-board", "pip install examples/boards"),
    ):
        (fault,) = refused(plan_of(wrong, options={"share": 1.0}))
        assert fault.startswith(f"vehicle.autopilot.kind: there is no firmware {wrong!r} (installed: ardup")
        assert fault.endswith(f"throttle; {remedy})")
    faults = refused(plan_of("throttle", options={"share": 1.5, "sher": 1}))
    assert len(faults) == 2
    assert faults[0].startswith("vehicle.autopilot.options: share: 1.5 is not valid")
    assert faults[1] == "vehicle.autopilot.options: sher: unknown field 'sher' (did you mean share?)"
    (fault,) = refused(plan_of("relay", options={"says": 1}))
    assert fault.startswith("vehicle.autopilot.options: says: 1 is not valid")
    # Beside its own, what no real autopilot has.
    faults = refused(plan_of("throttle", "warp", {"ground_truth": True}, options={"share": 1}))
    assert [fault.partition(":")[0] for fault in faults] == ["pace.mode", "vehicle.ground_truth"]


def test_the_kinds_of_the_bench_join_by_the_same_door() -> None:
    kinds: dict[str, FirmwareKind] = {"px4": PX4, "ardupilot": ARDUPILOT}
    for name, kind in kinds.items():
        assert plugins("rebar.firmware")[name].load() is kind
        assert kind.modes == name
        assert kind.options is RealAutopilot


def test_a_simspec_is_read_and_written_where_the_package_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a report or another machine does it; only who flies it needs the package."""
    specs = [
        plan_of("throttle", options={"share": 0.5}).simspec,
        plan_of("relay", options={"says": ["x"], "deep": {"list": [1, None]}}, boot_s=2).simspec,
    ]
    for name in ("throttle", "relay"):
        monkeypatch.delitem(plugins("rebar.firmware"), name)
    for spec in specs:
        again = SimSpec.model_validate_json(dump_json(spec))
        assert again == spec
        assert isinstance(again.vehicle.autopilot, PluginAutopilot)
        assert str(again.vehicle.autopilot) == f"{again.vehicle.autopilot.kind} (real)"
        assert refused(VehiclePlan(spec, ()))[0].startswith("vehicle.autopilot.kind: there is no firmware")


@pytest.mark.parametrize(
    ("autopilot", "fault"),
    [
        (
            {"kind": "px4", "device": "/dev/ttyACM0", "baud": 57600},
            "RealAutopilot: a board is flown by a package: pip",
        ),
        ("px5", "imitated: 'px5' is not valid (Input should be 'px4' or 'ardupilot')"),
        ({"options": {}}, "PluginAutopilot.kind: is missing (add it)"),
        (
            {"kind": "px5", "firmware": "x"},
            "PluginAutopilot.firmware: unknown field 'firmware' (known here: kind, opt",
        ),
        (
            {"kind": "px4", "firmware": "x", "options": {}},
            "RealAutopilot.options: unknown field 'options' (known here",
        ),
    ],
)
def test_faults_are_those_of_the_form_that_was_meant(autopilot: object, fault: str) -> None:
    """Boards of earlier SimSpecs are told how they are flown now."""
    with pytest.raises(SetupError) as raised:
        validate_document({"autopilot": autopilot}, VehicleSpec)
    (told,) = [str(each) for each in raised.value.faults if "Undefined" not in str(each)]
    assert told.startswith(f"autopilot.{fault}")
