"""A vehicle by itself in real time, without a session: a drop-in replacement for an autopilot's SITL."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from bench.contracts import (
    BootsFirmware,
    CarriesCamera,
    LinkSpec,
    OpenVehicle,
    SimTime,
    Vehicle,
    VehiclePlan,
    load_plugin,
    losses_of,
)
from bench.documents import validate_document
from bench.errors import SetupError
from bench.simspec import DEFAULT_VEHICLE, PluginAutopilot, SimSpec

from ._host_clock import HostClock
from ._interface import interface_address
from ._parameter_file import HasParameters, ParameterFile
from ._step_timing import StepClock

DEFAULT_LINKS: Mapping[str, tuple[LinkSpec, ...]] = {
    "px4": (
        LinkSpec("gcs", "udp_out", port=14550, streams="gcs"),
        LinkSpec("onboard", "udp_out", port=14540, streams="onboard"),
    ),
    "ardupilot": tuple(
        LinkSpec(f"serial{number}", "tcp_in", port=port) for number, port in enumerate((5760, 5762, 5763))
    ),
}
DEFAULT_HOME = (47.3977, 8.5456, 488.0, 0.0)
# A host that is further behind drops the lost time, and flies no burst. Chosen, not measured.
_LATE_S = 0.25
# Until a real autopilot tells its version at the earliest; the rest of its start is flown before the eyes of its clients.
_HELLO_S = 4.0


@dataclass(frozen=True, slots=True)
class StandalonePlan:
    """A vehicle to fly by itself.

    `home` is latitude and longitude (degrees), ground altitude (metres above sea level), heading (degrees).
    Without links, those of the autopilot's SITL: UDP to 14550 and 14540 for px4, TCP servers on 5760, 5762,
    5763 for ardupilot. Without `duration_s` (simulated seconds) it flies until it is stopped. `parameter_file` saves what
    differs from the defaults from one start to the next. `model` is a vehicle of group rebar.vehicles. `camera` adds a
    camera on a gimbal, both on the links. True motion is sent on request, and clients may set parameters of the
    simulation, as with a SITL. With a `firmware`, a path or a plug-in's, the real autopilot flies, which sends no true motion.
    """

    autopilot: str = "px4"
    links: Sequence[LinkSpec] = ()
    home: tuple[float, float, float, float] = DEFAULT_HOME
    speed: float = 1.0
    duration_s: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    parameter_file: Path | None = None
    model: str = DEFAULT_VEHICLE
    camera: bool = False
    firmware: str | PluginAutopilot = ""


def interface_links(autopilot: str, name: str) -> list[LinkSpec]:
    """Links for other computers: they listen on an interface, at the ports of the autopilot's own in simulation."""
    address = interface_address(name, "--interface")
    return [
        replace(link, kind="tcp_in" if link.kind == "tcp_in" else "udp_in", host=address)
        for link in DEFAULT_LINKS[autopilot]
    ]


def run_standalone(
    plan: StandalonePlan,
    say: Callable[[str], object] = lambda line: None,
    stop: threading.Event | None = None,
) -> None:
    """Fly until `stop` is set, the plan's duration is over, or the user interrupts.

    `say` gets a line for each link, and one about the punctuality in real time. Raises SetupError for anything that cannot
    be opened or does not exist.
    """
    file = ParameterFile(plan.parameter_file) if plan.parameter_file else None
    saved = file.load() if file else {}
    simspec = standalone_simspec(replace(plan, parameters={**saved, **plan.parameters}))
    open_vehicle: OpenVehicle = load_plugin("rebar.vehicles", plan.model)
    links = tuple(plan.links) or DEFAULT_LINKS[plan.autopilot]
    with open_vehicle(VehiclePlan(simspec, links)) as vehicle:
        if isinstance(vehicle, BootsFirmware):
            say(vehicle.boot())
        for name, endpoint in vehicle.endpoints().items():
            say(f"{plan.autopilot} on {name}: connect to {endpoint}")
        save = partial(_save, file, vehicle)
        after_step = [Periodic(save, 1.0)]
        if plan.camera and isinstance(vehicle, CarriesCamera):
            # The frames have no content: there is no scene.
            after_step.append(Periodic(vehicle.record_exposure, simspec.vehicle.camera.rate_hz))
        steps = StepClock(vehicle.step_s / plan.speed)
        try:
            fly(vehicle, plan.speed, plan.duration_s, stop or threading.Event(), after_step, steps)
        except KeyboardInterrupt:
            say(f"stopped after {vehicle.time.s:.1f} s")
        save()
        timing = steps.summary()
        if plan.speed == 1.0 and timing.steps:
            say(f"real time: {timing}")
            if losses := losses_of(vehicle.counters()):
                say("lost: " + ", ".join(f"{count:,} {what}" for what, count in losses.items()))


def _save(file: ParameterFile | None, vehicle: Vehicle, *_: object) -> None:
    if file and isinstance(vehicle, HasParameters):
        file.save(vehicle.changed_parameters())


class Periodic:
    """Acts after a step, at a rate in simulated time. The action gets the number of times before, and the moment."""

    def __init__(self, act: Callable[[int, SimTime], object], rate_hz: float) -> None:
        self._act = act
        self._period_ns = round(1e9 / rate_hz)
        self._number = 0
        self._next_ns: int | None = None

    def __call__(self, now: SimTime) -> None:
        if self._next_ns is None or now.ns >= self._next_ns:
            self._act(self._number, now)
            self._number += 1
            self._next_ns = (now.ns if self._next_ns is None else self._next_ns) + self._period_ns


def standalone_simspec(plan: StandalonePlan) -> SimSpec:
    """A SimSpec from a home place alone: still air, an empty square kilometre, the vehicle amid it."""
    autopilot = plan.autopilot
    if autopilot not in DEFAULT_LINKS:
        raise SetupError("autopilot", f"{autopilot!r} is not known", f"there are {', '.join(DEFAULT_LINKS)}")
    latitude, longitude, altitude, heading = plan.home
    corners = [
        {"east_m": east, "north_m": north}
        for east, north in ((-500, -500), (500, -500), (500, 500), (-500, 500))
    ]
    carried: object = autopilot
    if isinstance(plan.firmware, PluginAutopilot):
        carried = plan.firmware
    elif plan.firmware:
        carried = {"kind": autopilot, "firmware": plan.firmware, "boot_s": _HELLO_S, "pace": "one_core"}
    document = {
        "name": "standalone",
        "world": {
            "origin": {"latitude_deg": latitude, "longitude_deg": longitude, "altitude_m": altitude},
            "area": {"corners": corners},
        },
        "vehicle": {
            "model": plan.model,
            "autopilot": carried,
            "parameters": dict(plan.parameters),
            "ground_truth": carried == autopilot,
            "simulation_control": True,
            "camera": {"gimbal": plan.camera, "mavlink": plan.camera},
            "home": {"east_m": 0.0, "north_m": 0.0, "heading_deg": math.fmod(heading, 360.0) % 360.0},
        },
        "pace": {"mode": "realtime"},
    }
    return validate_document(document, SimSpec, source="home")


def fly(
    vehicle: Vehicle,
    speed: float,
    duration_s: float | None,
    stop: threading.Event,
    after_step: Sequence[Callable[[SimTime], None]] = (),
    steps: StepClock | None = None,
    clock: HostClock | None = None,
) -> None:
    """Step a vehicle at `speed` times the host's clock, without drift: moments count from the start.

    When the host falls behind by a quarter of a second, the lost time is dropped. `steps` keeps how late the steps are.
    Without a `clock` it is the host's, and a `stop` ends its pauses.
    """
    clock = clock or HostClock(sleep=stop.wait)
    start, start_sim_s = clock.now(), vehicle.time.s
    due = start
    while not stop.is_set() and (duration_s is None or vehicle.time.s - start_sim_s < duration_s - 1e-9):
        if steps:
            steps.record(clock.now() - due)
        vehicle.receive()
        vehicle.step()
        for act in after_step:
            act(vehicle.time)
        due = start + (vehicle.time.s - start_sim_s) / speed
        ahead_s = due - clock.now()
        if ahead_s > 0.0:
            clock.sleep(ahead_s)
        elif ahead_s < -_LATE_S:
            # `due` stays: the step is late, whatever is dropped behind it.
            start -= ahead_s
