"""PX4 on a flight controller board in hardware-in-the-loop mode: sensors out, motor outputs back, in real time.

The board runs by its own clock, so there is no lockstep. What PX4 does with the messages, read in its source
(mavlink_receiver.cpp and mavlink_main.cpp of 1.16): HIL_SENSOR and HIL_GPS become sensors; HIL_ACTUATOR_CONTROLS comes
at 200 Hz unasked once SYS_HITL is 1, on links of more than 5000 B/s. HIL_STATE_QUATERNION is not sent: a board takes it
for its own estimate, and would fly by the truth.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager

from bench.contracts import VehiclePlan
from bench.documents import Document
from bench.errors import Fault, FirmwareFault, SetupError
from vehicle_models.firmware import (
    CONSOLE_FILE,
    HIL_ACTUATOR_CONTROLS,
    MAV_CMD,
    MESSAGE_KINDS,
    ROTORS,
    FirmwarePlan,
    MavlinkPort,
    Px4Samples,
    RunningFirmware,
    SerialDevice,
    actuator_controls,
    message_id,
    px4_geometry,
)

from ._agent_parameters import AgentParameters
from ._board_gate import BoardGate
from ._board_line import BoardLine
from ._board_memory import BoardMemory
from ._line_budget import SAMPLE_RATES_HZ, LineBudget, plan_line
from ._options import DEVICE_FIELD, BoardOptions
from ._real_time import Keeper, LineClock

PARAMETERS_FILE = "board-parameters-before.json"
# Host seconds without motor outputs from a line that carries a hundred of them a second: cable, board or firmware.
SILENT_S = 0.5
# After the first sample PX4 starts its outputs within a second or so.
FIRST_ANSWER_S = 10.0
_FORCE = 21196.0
# What agents may have waiting for the line: more is lost, as on a radio.
_AGENT_BACKLOG_BYTES = 16 * 1024
# Bytes that agents may save up while they are silent, in seconds of their share.
_SAVED_S = 0.25


class Px4BoardKind:
    """How to fly a PX4 board, by the host's clock unless a test gives another."""

    name = "PX4 board"
    modes = "px4"
    options: type[Document] = BoardOptions
    # Of the physics: with fewer the legs do not carry the aircraft. Slow lines carry every second one.
    samples_hz = 200
    boot_s = 20.0
    estimate_hz: float | None = None
    logs: Sequence[str] = (PARAMETERS_FILE,)

    def __init__(self, clock: LineClock | None = None) -> None:
        self._clock = clock or LineClock()

    def identity(self, options: Document) -> str:
        assert isinstance(options, BoardOptions)
        samples_hz = plan_line(options.baud, options.streams_hz).samples_hz
        return f"{options.device} at {options.baud} baud, {samples_hz} samples a second, in real time"

    def faults(self, plan: VehiclePlan, options: Document) -> list[Fault]:
        assert isinstance(options, BoardOptions)
        faults = [
            Fault(
                f"vehicle.failures[{index}].kind",
                "battery_drop does not reach a board: PX4 tells itself 16 V and 70 % in this mode",
                "leave it out, or fly the imitated autopilot",
            )
            for index, failure in enumerate(plan.simspec.vehicle.failures)
            if failure.kind == "battery_drop"
        ]
        if plan.simspec.pace.mode != "realtime":
            what = f"a board keeps real time, and the pace is {plan.simspec.pace.mode}"
            faults.append(Fault("pace.mode", what, "fly with --pace realtime"))
        if plan.controller_hz > SAMPLE_RATES_HZ[-1]:
            faults.append(
                Fault("controller_hz", f"{plan.controller_hz} Hz is too fast for a board", "use 50")
            )
        try:
            plan_line(options.baud, options.streams_hz)
            SerialDevice(options.device, options.baud, DEVICE_FIELD).close()
        except SetupError as error:
            faults += error.faults
        return faults

    @contextmanager
    def open(self, plan: FirmwarePlan) -> Generator[RunningBoard]:
        options = plan.options
        assert isinstance(options, BoardOptions)
        device = SerialDevice(options.device, options.baud, DEVICE_FIELD)
        line = BoardLine(device, self._clock, plan.budgets.connect_s)
        with ExitStack() as stack:
            stack.callback(device.close)
            line.connect()
            _check(line)
            line.restart()
            _check(line)
            wanted = _airframe_parameters() | plan.simspec.vehicle.parameters | options.parameters
            memory = BoardMemory(options.device)
            # Of a session that was killed: what it has left is not the board's own.
            if left := line.restore(memory.load()):
                raise FirmwareFault(
                    f"the board on {device.path} does not take {', '.join(left)} back, which a session that was killed has "
                    f"changed: set them as in {memory.path}, and remove that file"
                )
            former = line.differing(wanted)

            def keep() -> None:
                memory.save(former)
                values = {name: held.value for name, held in former.items()}
                (plan.folder / PARAMETERS_FILE).write_text(json.dumps(values, indent=1), encoding="utf-8")

            keep()

            def leave(kind: type[BaseException] | None, *_: object) -> None:
                # A board that stays armed would begin the next session so.
                line.command(MAV_CMD.COMPONENT_ARM_DISARM, 0.0, _FORCE)
                left = line.restore(former)
                text = f"{len(former) - len(left)} parameters put back"
                if left:
                    text += f"; NOT PUT BACK: {', '.join(left)}: set them as in {memory.path} before you fly for real"
                else:
                    memory.clear()
                (plan.folder / CONSOLE_FILE).write_text(f"{text}\n", encoding="utf-8")
                if left and kind is None:
                    values = {name: former[name].value for name in left}
                    raise FirmwareFault(f"the board on {device.path}: {text} ({values})")

            stack.push(leave)
            line.set_parameters(wanted, former)
            budget = plan_line(options.baud, options.streams_hz)
            running = RunningBoard(plan, line, budget, AgentParameters(line, former, keep))
            stack.callback(running.close)
            running.ask_for_streams()
            yield running


def _airframe_parameters() -> dict[str, float]:
    """Simulated outputs 1 to 4 are motors 1 to 4 (HIL_ACT_FUNC)."""
    return px4_geometry() | {f"HIL_ACT_FUNC{number}": 100 + number for number in range(1, 5)}


def _check(line: BoardLine) -> None:
    """Raise SetupError unless the board simulates: else the agent would arm real motors."""
    device = line.device.path
    if line.state.armed:
        what = f"the board on {device} is armed"
        raise SetupError(DEVICE_FIELD, what, "disarm it; take the propellers off")
    mode = line.parameter("SYS_HITL")
    if mode is None or mode.value != 1.0 or not line.state.in_simulation:
        said = "does not have SYS_HITL" if mode is None else f"has SYS_HITL {mode.value:g}"
        state = "in" if line.state.in_simulation else "not in"
        what = f"the board on {device} {said} and is {state} hardware-in-the-loop mode"
        remedy = "take the propellers off, set SYS_AUTOSTART to 1001 and SYS_HITL to 1, and restart the board"
        raise SetupError(DEVICE_FIELD, what, f"{remedy} (docs/hardware.md)")


class BoardPort:
    """The board's MAVLink as all of the vehicle's links share it."""

    def __init__(self, gate: BoardGate, parameters: AgentParameters) -> None:
        self.gate = gate
        self._parameters = parameters
        self._received: list[bytes] = []
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self.dropped_bytes = 0

    def read(self) -> list[bytes]:
        frames, self._received = self._received + self.gate.take_answers(), []
        return frames

    def send(self, frames: list[bytes]) -> None:
        for frame in frames:
            if not self.gate.admits(frame):
                continue
            if reason := self._parameters.refusal(frame):
                self.gate.refuse(reason)
            elif not self._parameters.hold(frame):
                self._queue([frame])

    def _queue(self, frames: list[bytes]) -> None:
        for frame in frames:
            if self._waiting_bytes + len(frame) > _AGENT_BACKLOG_BYTES:
                self.dropped_bytes += len(frame)
                continue
            self._waiting.append(frame)
            self._waiting_bytes += len(frame)

    def deliver(self, frames: list[bytes]) -> None:
        """What the board has sent."""
        self._received += [frame for frame in frames if not self._parameters.expects(frame)]
        # Requests too take from the share of the agents that caused them.
        self._queue(self._parameters.take_released())

    def take(self, most_bytes: float) -> list[bytes]:
        """The next frames for the board, of so many bytes at most."""
        frames = []
        while self._waiting and len(self._waiting[0]) <= most_bytes:
            frame = self._waiting.popleft()
            self._waiting_bytes -= len(frame)
            most_bytes -= len(frame)
            frames.append(frame)
        return frames


class RunningBoard(RunningFirmware):
    """A board on its line, with the sensors that the bench simulates for it."""

    def __init__(
        self, plan: FirmwarePlan, line: BoardLine, budget: LineBudget, parameters: AgentParameters
    ) -> None:
        body = plan.body
        self.armed: bool | None = False
        self._line, self._budget, self._clock = line, budget, line.clock
        self._samples = Px4Samples(plan.simspec, body)
        self._plant = body.plant
        self._port = BoardPort(BoardGate(budget, lambda: line.state.system), parameters)
        self.estimate_port: MavlinkPort = self._port
        self.ports: Mapping[str, MavlinkPort] = {link.name: self._port for link in plan.links}
        self.connections: Sequence[MavlinkPort] = [self._port]
        self._period_s = 1.0 / budget.samples_hz
        self._physics_per_sample = body.samples_hz // budget.samples_hz
        self._samples_per_step = budget.samples_hz // plan.controller_hz
        self._new_fix = False
        # Since the board restarted for this session: what was lost until then nobody needed.
        self._resets, self._lost_bytes = line.device.resets, line.device.lost_bytes
        self._lost_messages, self._garbage_bytes = line.reader.lost_messages, line.reader.garbage_bytes
        self._count = self._physics = 0
        self._anchor_s = self._sent_s = self._answered_s = self._clock.now()
        self._answered = False
        self._agent_bytes = 0.0
        self._late = 0
        self._keeper: Keeper | None = None

    def ask_for_streams(self) -> None:
        """Ask for every planned message at its rate, and for the version."""
        self._line.command(MAV_CMD.REQUEST_MESSAGE, float(MESSAGE_KINDS["AUTOPILOT_VERSION"].id))
        for name, rate_hz in self._budget.streams_hz.items():
            interval_us = 1e6 / rate_hz if rate_hz else -1.0
            self._line.command(MAV_CMD.SET_MESSAGE_INTERVAL, float(MESSAGE_KINDS[name].id), interval_us)

    def fly_sample(self, *, new_fix: bool) -> None:
        """One sample, sent at its moment: the first of a step at once, the others a period apart."""
        self._new_fix |= new_fix
        time_us = self._samples.advance()
        self._physics += 1
        if self._physics % self._physics_per_sample:
            return
        self._await_moment()
        self._line.beat()
        for frame in self._samples.messages(time_us, new_fix=self._new_fix):
            self._line.device.send(frame)
        self._new_fix = False
        self._send_of_agents()
        self._receive()

    def wait_step(self) -> None:
        ahead_s = self._anchor_s + self._samples_per_step * self._period_s - self._clock.now()
        if ahead_s > 0.0:
            self._clock.sleep(ahead_s)

    def stand_by(self, stand: Callable[[], None]) -> None:
        # A board that gets no sensors meanwhile has no estimate any more.
        self._keeper = Keeper(stand)

    def end_stand_by(self) -> None:
        if self._keeper:
            self._keeper.stop()
            self._keeper = None

    def close(self) -> None:
        if self._keeper:
            self._keeper.close()

    def last_words(self) -> str:
        return f"; {self._line.reader.garbage_bytes} bytes that are no MAVLink came"

    def counters(self) -> Mapping[str, int]:
        device, reader = self._line.device, self._line.reader
        return {
            "firmware_late_samples": self._late,
            "firmware_lost_bytes": device.lost_bytes - self._lost_bytes + self._port.dropped_bytes,
            "firmware_lost_messages": reader.lost_messages - self._lost_messages,
            "firmware_garbage_bytes": reader.garbage_bytes - self._garbage_bytes,
            "firmware_refused": self._port.gate.refused,
        }

    def _await_moment(self) -> None:
        number = self._count % self._samples_per_step
        self._count += 1
        now_s = self._clock.now()
        # A late bench catches up, but not with two samples within half a period: PX4 integrates by its clock.
        due_s = (
            self._sent_s + 0.5 * self._period_s if number == 0 else self._anchor_s + number * self._period_s
        )
        if due_s > now_s:
            self._clock.sleep(due_s - now_s)
        self._sent_s = now_s = self._clock.now()
        self._late += number > 0 and now_s - due_s > self._period_s
        if number == 0:
            self._anchor_s = now_s

    def _send_of_agents(self) -> None:
        share_bps = self._budget.free_to_board_bps
        self._agent_bytes = min(self._agent_bytes + share_bps * self._period_s, share_bps * _SAVED_S)
        for frame in self._port.take(self._agent_bytes):
            self._agent_bytes -= len(frame)
            self._line.device.send(frame)

    def _receive(self) -> None:
        line = self._line
        controls, others = None, []
        for frame in line.read():
            if message_id(frame) == HIL_ACTUATOR_CONTROLS:
                controls = actuator_controls(frame)
            else:
                others.append(frame)
        self._port.deliver(others)
        now_s = self._clock.now()
        if controls is not None:
            self._answered, self._answered_s = True, now_s
            self.armed = controls.armed
            # NaN stands for an output that is stopped.
            speeds = [0.0 if math.isnan(share) else share for share in controls.outputs[: len(ROTORS)]]
            self._plant.turn_rotors(speeds)
        self._check(now_s)

    def _check(self, now_s: float) -> None:
        line, path = self._line, self._line.device.path
        if line.device.resets > self._resets:
            raise FirmwareFault(
                f"the board on {path} went away and came back: it restarted, or its cable is loose"
            )
        if not line.state.in_simulation:
            raise FirmwareFault(f"the board on {path} left hardware-in-the-loop mode")
        patience_s = SILENT_S if self._answered else FIRST_ANSWER_S
        if now_s - self._answered_s > patience_s:
            at_all, hint = "", ""
            if not self._answered:
                at_all = " at all"
                hint = ": its MAVLink link needs a rate above 5000 B/s (MAV_x_RATE), and its firmware the module pwm_out_sim"
            raise FirmwareFault(
                f"no HIL_ACTUATOR_CONTROLS{at_all} came from the board on {path} for {patience_s:g} s{hint}"
            )
