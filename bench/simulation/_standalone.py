"""A vehicle by itself in real time, without a session: a drop-in replacement for an autopilot's SITL."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
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
from bench.errors import Fault, SetupError
from bench.simspec import DEFAULT_VEHICLE, BoardAutopilot, SimSpec

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
# A host that is behind by more than this drops the lost time instead of flying it in a burst. Chosen, not
# measured.
_LATE_S = 0.25
# Until a real autopilot tells its version at the earliest; the rest of its start is flown before the eyes of its clients.
_HELLO_S = 4.0


def run_standalone(
    autopilot: str = "px4",
    links: Sequence[LinkSpec] = (),
    home: tuple[float, float, float, float] = DEFAULT_HOME,
    speed: float = 1.0,
    parameters: Mapping[str, float] | None = None,
    duration_s: float | None = None,
    stop: threading.Event | None = None,
    say: Callable[[str], None] | None = None,
    parameter_file: Path | None = None,
    model: str = DEFAULT_VEHICLE,
    camera: bool = False,
    firmware: str = "",
    board: BoardAutopilot | None = None,
) -> None:
    """Fly until `stop` is set, `duration_s` simulated seconds are over, or the user interrupts.

    `home` is latitude and longitude (degrees), ground altitude (metres above sea level), heading (degrees).
    Without links, those of the autopilot's SITL: UDP to 14550 and 14540 for px4, TCP servers on 5760, 5762,
    5763 for ardupilot. `say` gets a line for each link. `parameter_file` saves what differs from the defaults
    from one start to the next. `model` is a vehicle of group rebar.vehicles. Raises SetupError for anything
    that cannot be opened or does not exist. `camera` adds a camera on a gimbal, both on the links. True
    motion is sent on request, and clients may set parameters of the simulation, as with a SITL. With a `firmware` the
    real autopilot flies, which sends no true motion; with a `board` one in hardware-in-the-loop mode, in real time.
    """
    file = ParameterFile(parameter_file) if parameter_file else None
    saved = file.load() if file else {}
    simspec = standalone_simspec(
        autopilot, home, {**saved, **(parameters or {})}, model, camera, firmware, board
    )
    open_vehicle: OpenVehicle = load_plugin("rebar.vehicles", model)
    plan = VehiclePlan(simspec, tuple(links) or DEFAULT_LINKS[autopilot])
    with ExitStack() as stack:
        vehicle = stack.enter_context(open_vehicle(plan))
        if isinstance(vehicle, BootsFirmware):
            description = vehicle.boot()
            if say:
                say(description)
        for name, endpoint in vehicle.endpoints().items():
            if say:
                say(f"{autopilot} on {name}: connect to {endpoint}")

        steps = StepClock(vehicle.step_s / speed)

        def save() -> None:
            if file and isinstance(vehicle, HasParameters):
                file.save(vehicle.changed_parameters())

        try:
            shutter = (
                Shutter(vehicle, simspec.vehicle.camera.rate_hz)
                if camera and isinstance(vehicle, CarriesCamera)
                else None
            )
            fly(
                vehicle,
                speed,
                duration_s,
                stop or threading.Event(),
                each_second=save,
                after_step=shutter,
                steps=steps,
            )
        except KeyboardInterrupt:
            if say:
                say(f"stopped after {vehicle.time.s:.1f} s")
        save()
        timing = steps.summary()
        if say and speed == 1.0 and timing.steps:
            say(f"real time: {timing}")
            if losses := losses_of(vehicle.counters()):
                say("lost: " + ", ".join(f"{count:,} {what}" for what, count in losses.items()))


class Shutter:
    """Triggers the vehicle's camera at its rate where no scene does it. The frames have no content."""

    def __init__(self, camera: CarriesCamera, rate_hz: float) -> None:
        self._camera = camera
        self._period_ns = round(1e9 / rate_hz)
        self._frame = 0
        self._next_ns: int | None = None

    def __call__(self, now: SimTime) -> None:
        if self._next_ns is None or now.ns >= self._next_ns:
            self._camera.record_exposure(self._frame, now)
            self._frame += 1
            self._next_ns = (now.ns if self._next_ns is None else self._next_ns) + self._period_ns


def standalone_simspec(
    autopilot: str,
    home: tuple[float, float, float, float],
    parameters: Mapping[str, float],
    model: str = DEFAULT_VEHICLE,
    camera: bool = False,
    firmware: str = "",
    board: BoardAutopilot | None = None,
) -> SimSpec:
    """A SimSpec from a home place alone: still air, a square kilometre of nothing, the vehicle in its
    middle.
    """
    if autopilot not in DEFAULT_LINKS:
        raise SetupError(
            Fault("autopilot", f"{autopilot!r} is not known", f"there are {', '.join(DEFAULT_LINKS)}")
        )
    latitude, longitude, altitude, heading = home
    corners = [
        {"east_m": east, "north_m": north}
        for east, north in ((-500, -500), (500, -500), (500, 500), (-500, 500))
    ]
    carried: object = autopilot
    if firmware:
        carried = {"kind": autopilot, "firmware": firmware, "boot_s": _HELLO_S, "pace": "one_core"}
    elif board:
        carried = board.model_dump()
    document = {
        "name": "standalone",
        "world": {
            "origin": {"latitude_deg": latitude, "longitude_deg": longitude, "altitude_m": altitude},
            "area": {"corners": corners},
        },
        "vehicle": {
            "model": model,
            "autopilot": carried,
            "parameters": dict(parameters),
            "ground_truth": carried == autopilot,
            "simulation_control": True,
            "camera": {"gimbal": camera, "mavlink": camera},
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
    clock: Callable[[], float] = time.monotonic,
    wait: Callable[[float], object] | None = None,
    each_second: Callable[[], None] | None = None,
    after_step: Callable[[SimTime], None] | None = None,
    steps: StepClock | None = None,
) -> None:
    """Step a vehicle at `speed` times the host's clock, without drift: moments are counted from the start,
    not added up.

    When the host falls behind by a quarter of a second, the lost time is dropped. `clock` and `wait` are the
    host's; `each_second` is called once each simulated second. `steps` keeps how late the steps are, by the host's clock.
    """
    pause = wait or stop.wait
    start, start_sim_s = clock(), vehicle.time.s
    next_s = start_sim_s + 1.0
    due = start
    while not stop.is_set() and (duration_s is None or vehicle.time.s - start_sim_s < duration_s - 1e-9):
        if steps:
            steps.record(clock() - due)
        vehicle.receive()
        vehicle.step()
        if each_second and vehicle.time.s >= next_s:
            next_s += 1.0
            each_second()
        if after_step:
            after_step(vehicle.time)
        due = start + (vehicle.time.s - start_sim_s) / speed
        ahead_s = due - clock()
        if ahead_s > 0.0:
            pause(ahead_s)
        elif ahead_s < -_LATE_S:
            # `due` stays: the step is late, whatever is dropped behind it.
            start -= ahead_s
