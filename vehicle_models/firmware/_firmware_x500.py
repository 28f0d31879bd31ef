"""A simulated X500 that a real autopilot flies, as a `Vehicle`: physics, links and failures as with the imitated one."""

from __future__ import annotations

import math
import shutil
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bench.contracts import MavlinkTap, SimTime, VehicleCondition, VehiclePlan, VehicleState
from bench.errors import Fault, FirmwareFault, SetupError
from bench.simspec import PluginAutopilot, RealAutopilot
from bench.temporary_folders import temporary_folder

from .._gusts import mean_wind_ned_mps
from .._linked_vehicle import LinkedVehicle
from ..controller import AUTOPILOTS, Link, link_counters, open_links
from ..controller.links._frames import message_id, message_name
from ..controller.links._radio import MESSAGES_PER_STEP
from ..x500 import ROTORS, has_crashed
from ._body import Body
from ._firmware import Budgets, FirmwarePlan, RunningFirmware, kind_of, options_of
from ._gate import Gate
from ._pace import held_on
from ._program import CONSOLE_FILE
from ._simulated_parts import SimulatedParts
from ._telemetry import Telemetry

# Standing: the feet touch, and nothing moves.
_TOUCH_M, _STANDING_MPS = 0.02, 0.2
# When the bench asks for version and estimate, and again until it gets them: the autopilot hears nothing before.
_REQUEST_S, _REQUEST_EVERY_S = 3.0, 5.0
# Until the first heartbeat: PX4's came after 4.5 to 5.1 s.
_HELLO_S = 30.0
# Of a firmware without outputs: when it is asked for its clock, again and again, and how far that may stay behind.
_ASK_CLOCK_S, _ASK_CLOCK_EVERY_S, _CLOCK_LAG_S = 0.1, 1.0, 5.0
# Messages of clients that stand in the reason when the firmware fails.
_LAST_HEARD = 5
_SPEED_MATTERS_BELOW_M = 50.0


@contextmanager
def open_firmware_x500(
    plan: VehiclePlan, tap: MavlinkTap | None = None, budgets: Budgets | None = None
) -> Iterator[FirmwareX500]:
    """Yield an X500 standing at home, whose autopilot starts with `boot` or with the first step; leaving the block ends it.

    Raises SetupError for a link that cannot be opened, a firmware that is not there, or what it cannot do.
    """
    with open_links(plan.links) as links, ExitStack() as stack:
        yield FirmwareX500(plan, links, stack, tap, budgets or Budgets())


class FirmwareX500(LinkedVehicle):
    """The quadrotor under a real autopilot."""

    def __init__(
        self, plan: VehiclePlan, links: list[Link], stack: ExitStack, tap: MavlinkTap | None, budgets: Budgets
    ) -> None:
        simspec = plan.simspec
        autopilot = simspec.vehicle.autopilot
        assert isinstance(autopilot, RealAutopilot | PluginAutopilot)
        self._plan, self._budgets = plan, budgets
        self._kind = kind_of(autopilot)
        self._boot_s = self._kind.boot_s if autopilot.boot_s is None else autopilot.boot_s
        self._options = options_of(autopilot, self._kind)
        self._check()
        super().__init__(plan, links, tap)
        self._stack = stack
        self._samples_per_step = self._kind.samples_hz // plan.controller_hz
        self._body = Body(simspec, self._kind.samples_hz, plan.controller_hz)
        self._body.plant.set_wind_ned_mps(mean_wind_ned_mps(self._wind))
        body = self._body
        self._failures = self._failures_of(plan, body.navigation, len(ROTORS), body.plant.set_works)
        self._telemetry = Telemetry()
        self._gate = Gate(simspec.vehicle.simulation_control)
        self._modes = AUTOPILOTS[self._kind.modes].modes
        self._running: RunningFirmware | None = None
        self._parts: SimulatedParts | None = None
        self._crashed = False
        self._fixes = 0
        self._ask_clock_s = _ASK_CLOCK_S
        self._last_heard: deque[tuple[SimTime, int]] = deque(maxlen=_LAST_HEARD)
        self._flown_steps = 0
        self._next_request_s = _REQUEST_S

    def boot(self) -> str:
        """Start the autopilot and let it run on the ground. What it sends meanwhile is discarded: nobody is there yet."""
        running = self._start()
        boot_s = self._boot_s
        for _ in range(round(boot_s / self.step_s)):
            self._stand(running)
        telemetry = self._telemetry
        while boot_s > _REQUEST_S and not (telemetry.heartbeats and telemetry.version):
            if self._flown_steps * self.step_s >= max(boot_s, _HELLO_S):
                break
            self._stand(running)
        if boot_s > _REQUEST_S and not telemetry.heartbeats:
            raise FirmwareFault(
                f"{self._kind.name} has sent no MAVLink heartbeat in {max(boot_s, _HELLO_S):g} s{running.last_words()}"
            )
        running.stand_by(lambda: self._stand(running))
        return self._description()

    def step(self) -> None:
        running = self._running or self._start()
        running.end_stand_by()
        self._failures.apply(self.time.ns)
        if self._parts:
            gps_off, charge = self._body.navigation.off, self._battery.fraction
            if left := self._parts.tell(self.time.ns, gps_off=gps_off, charge=charge):
                raise FirmwareFault(
                    f"{self._kind.name} has not confirmed {', '.join(left)}, by which the bench's receiver and battery "
                    "reach it: ArduCopter 4.6.3 has these names, others may not, and a charge needs BATT_MONITOR 4"
                )
        self._take_from_clients(running)
        motion = self._body.plant.motion
        # What hits the ground within this step is near it now.
        speed_mps = math.hypot(*self._body.velocity_ned_mps())
        falling_mps = speed_mps if motion.up_m < _SPEED_MATTERS_BELOW_M else 0.0
        try:
            self._advance(running)
            self._watch_silence(running)
        except FirmwareFault as error:
            raise FirmwareFault(f"{error}{self._last_messages()}") from error
        self.time = SimTime(self.time.ns + self._step_ns)
        if has_crashed(self._body.plant.motion, falling_mps) and not self._crashed:
            self._crashed = True
            self._stop_rotors()
        self._give_to_clients(running)

    def truth(self) -> VehicleState:
        body, motion = self._body, self._body.plant.motion
        north_mps, east_mps, down_mps = body.velocity_ned_mps()
        return VehicleState(
            self.time,
            (motion.east_m, motion.north_m, motion.up_m),
            (east_mps, north_mps, -down_mps),
            motion.roll_rad,
            motion.pitch_rad,
            math.remainder(motion.yaw_rad, 2.0 * math.pi),
            body.rates_radps(),
        )

    def estimate(self) -> VehicleState:
        """What the autopilot last said of itself; the truth until it has said something."""
        telemetry, truth = self._telemetry, self.truth()
        if telemetry.latitude_e7 is None or telemetry.attitude_rad is None:
            return truth
        east_m, north_m = self._body.plane.east_north_m(
            math.radians(telemetry.latitude_e7 * 1e-7), math.radians(telemetry.longitude_e7 * 1e-7)
        )
        north_mps, east_mps, down_mps = telemetry.velocity_ned_mps
        return VehicleState(
            self.time,
            (east_m, north_m, telemetry.altitude_m - self._body.ground_m),
            (east_mps, north_mps, -down_mps),
            *telemetry.attitude_rad,
            telemetry.rates_radps,
        )

    def condition(self) -> VehicleCondition:
        motion, running = self._body.plant.motion, self._running
        armed = running.armed if running and running.armed is not None else self._telemetry.armed
        mode = self._modes.numbered(self._telemetry.custom_mode)
        moving = math.hypot(*self._body.velocity_ned_mps()) > _STANDING_MPS
        return VehicleCondition(
            armed,
            motion.up_m < _TOUCH_M and not moving,
            self._crashed,
            mode.name if mode else str(self._telemetry.custom_mode),
            self._battery.fraction,
            failsafe=self._telemetry.failsafe,
            failures=self._failures.active,
        )

    def counters(self) -> Mapping[str, int]:
        return {
            **link_counters(self._links),
            "simulation_refused": self._gate.refused,
            **(self._running.counters() if self._running else {}),
        }

    def _start(self) -> RunningFirmware:
        # Outermost, so that it is removed last: the program writes here until it is killed.
        folder = self._stack.enter_context(temporary_folder("autopilot")).resolve()
        self._stack.callback(self._keep_artefacts, folder)
        parts, links = (self._body, self._battery), [link.spec for link in self._links]
        budgets, controller_hz = self._budgets, self._plan.controller_hz
        plan = FirmwarePlan(
            self._plan.simspec, self._options, *parts, links, folder, budgets, controller_hz, self._boot_s
        )
        self._running = running = self._stack.enter_context(self._kind.open(plan))
        vehicle = self._plan.simspec.vehicle
        self._parts = SimulatedParts(running, self._telemetry, vehicle, self._battery.fraction)
        return running

    def _stand(self, running: RunningFirmware) -> None:
        """One step on the ground, of which clients hear nothing."""
        self._advance(running)
        for port in running.connections:
            frames = port.read()
            if port is running.estimate_port:
                self._telemetry.take(frames)
        running.wait_step()

    def _advance(self, running: RunningFirmware) -> None:
        """One step of physics and autopilot, without what clients and failures do."""
        navigation, plant = self._body.navigation, self._body.plant
        if not self._gusts.calm:
            plant.set_gust_ned_mps(self._gusts.step(plant.motion.up_m, plant.motion.airspeed_mps))
        new_fix = navigation.fixes != self._fixes and not navigation.off
        self._fixes = navigation.fixes
        self._request(running)
        with held_on(running.cores):
            for number in range(self._samples_per_step):
                running.fly_sample(new_fix=new_fix and number == 0)
            # What is read of the autopilot next, and sent to it, then finds it after the last sample, never amid it.
            running.settle()
        self._flown_steps += 1
        self._battery.drain(plant.thrust_n(), self.step_s)
        if self._battery.fraction <= 0.0:
            self._stop_rotors()
        navigation.step()

    def _watch_silence(self, running: RunningFirmware) -> None:
        """Let the rotors of a firmware without outputs stop where it has ended the flight. Raises FirmwareFault when its
        clock stands still: while that runs, it has stopped its outputs because of what clients wanted.
        """
        telemetry, silent_s = self._telemetry, running.silent_s
        if not silent_s:
            self._ask_clock_s = _ASK_CLOCK_S
            return
        if silent_s >= self._ask_clock_s:
            self._ask_clock_s = silent_s + _ASK_CLOCK_EVERY_S
            running.estimate_port.send(telemetry.clock_requests())
        if telemetry.terminated:
            self._body.plant.turn_rotors([0.0] * len(ROTORS))
        lag_s = min(silent_s, self._flown_steps * self.step_s - telemetry.clock_s)
        if lag_s > _CLOCK_LAG_S:
            raise FirmwareFault(
                f"the clock of {self._kind.name} stands still: for {lag_s:.1f} simulated s it has sent neither outputs nor a "
                f"later time{running.last_words()}"
            )

    def _request(self, running: RunningFirmware) -> None:
        now_s = self._flown_steps * self.step_s
        if now_s < self._next_request_s:
            return
        self._next_request_s = now_s + _REQUEST_EVERY_S
        if not self._telemetry.version or self._telemetry.latitude_e7 is None:
            running.estimate_port.send(self._telemetry.requests(self._kind.estimate_hz))

    def _take_from_clients(self, running: RunningFirmware) -> None:
        for link in self._links:
            if link.silenced:
                # Lost, not delayed.
                link.inbox.clear()
                continue
            frames = link.inbox.take(MESSAGES_PER_STEP)
            if not frames:
                continue
            if self._tap:
                self._tap(link.spec.name, "from_agent", b"".join(frames))
            admitted = [frame for frame in frames if self._gate.admits(frame)]
            self._last_heard.extend((self.time, message_id(frame)) for frame in admitted)
            running.ports[link.spec.name].send(admitted)
            if answers := self._gate.take_answers():
                self._give(link, answers)

    def _give_to_clients(self, running: RunningFirmware) -> None:
        for port in running.connections:
            frames = port.read()
            if port is running.estimate_port:
                self._telemetry.take(frames)
            frames = [frame for frame in frames if not self._gate.states_truth(frame)]
            if not frames:
                continue
            for link in self._links:
                if running.ports[link.spec.name] is port and not link.silenced and link.connected():
                    self._give(link, frames)

    def _give(self, link: Link, frames: list[bytes]) -> None:
        link.sent += len(frames)
        if self._tap:
            self._tap(link.spec.name, "to_agent", b"".join(frames))
        link.send(frames)

    def _last_messages(self) -> str:
        """What clients sent last, for whoever has to tell a firmware that failed from one that was made to fail."""
        messages = [
            f"{message_name(number)} {self.time.s - sent.s:.2f} s before" for sent, number in self._last_heard
        ]
        last = f"the last messages of clients: {', '.join(messages)}"
        return f"; {last if messages else 'no client had sent a message'}"

    def _stop_rotors(self) -> None:
        for rotor in range(len(ROTORS)):
            self._body.plant.set_works(rotor, False)

    def _check(self) -> None:
        """Raise SetupError with everything that this autopilot cannot do."""
        vehicle = self._plan.simspec.vehicle
        faults = self._kind.faults(self._plan, self._options)
        imitated = "fly the imitated autopilot, or leave it out"
        wishes = {
            "vehicle.camera.gimbal": vehicle.camera.gimbal,
            "vehicle.camera.mavlink": vehicle.camera.mavlink,
            "vehicle.ground_truth": vehicle.ground_truth,
        }
        faults += [
            Fault(field, "a real autopilot does not have it", imitated)
            for field, wish in wishes.items()
            if wish
        ]
        faults += [
            Fault(f"link {link.name}", "messages of a real autopilot are not signed", imitated)
            for link in self._plan.links
            if link.signing_key
        ]
        if self._kind.samples_hz % self._plan.controller_hz:
            rates = "use 25, 50, 100 or 200"
            faults.append(Fault("controller_hz", f"{self._plan.controller_hz} Hz does not divide", rates))
        if faults:
            raise SetupError(faults)

    def _description(self) -> str:
        version = self._telemetry.version or "of a version that it does not tell"
        return f"{self._kind.name} {version}, {self._kind.identity(self._options)}"

    def _keep_artefacts(self, folder: Path) -> None:
        """Keep console and logs with the run."""
        target = self._plan.artefacts
        if target is not None:
            target.mkdir(parents=True, exist_ok=True)
            for pattern in (CONSOLE_FILE, *self._kind.logs):
                for path in sorted(folder.glob(pattern)):
                    if path.is_file() and not path.is_symlink():
                        shutil.copyfile(path, target / path.name)
