"""Real PX4: MAVLink over TCP for the physics, UDP for its clients."""

from __future__ import annotations

import math
import os
import socket
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from bench.contracts import LinkSpec, VehiclePlan
from bench.documents import Document
from bench.errors import Fault, SetupError
from bench.process_threads import unseen_reason
from bench.simspec import Failure, RealAutopilot, SimSpec, VehicleSpec

from ..x500 import ROTORS
from ._airframe import PX4_CHARGE, charge_percent, merged, px4_parameters
from ._body import Body
from ._firmware import Budgets, FirmwarePlan, RunningFirmware, program_faults, program_identity
from ._instances import claimed_instance
from ._mavlink_ports import MavlinkPort, UdpPort
from ._pace import ThreadWatch, core_of, quiet_fault
from ._program import FirmwareProgram, open_program
from ._px4_link import PHYSICS_PORT, Px4Link
from ._px4_samples import Px4Samples

_ONBOARD_PORT, _ONBOARD_PEER = 14540, 14580
_GCS_PORT, _GCS_PEER = 14550, 18570
# The airframe with four motors on outputs 1 to 4 whose start script begins without a simulator of its own.
_AIRFRAME = "none_iris"
_START_SCRIPT = "etc/init.d-posix/rcS"
# The start script has ended by then.
_STARTING_US = 5_000_000


class Px4Kind:
    """How to start PX4."""

    name = "PX4"
    modes = "px4"
    options: type[Document] = RealAutopilot
    samples_hz = 200
    boot_s = 15.0
    estimate_hz: float | None = None
    logs: Sequence[str] = ("log/**/*.ulg",)

    def program(self, firmware: Path) -> Path:
        """`firmware` is PX4's folder, or the program in it."""
        return firmware if firmware.name == "px4" and firmware.is_file() else firmware / "bin" / "px4"

    def identity(self, options: Document) -> str:
        assert isinstance(options, RealAutopilot)
        return program_identity(self.program(Path(options.firmware)), options.pace)

    def faults(self, plan: VehiclePlan, options: Document) -> list[Fault]:
        assert isinstance(options, RealAutopilot)
        vehicle, program = plan.simspec.vehicle, self.program(Path(options.firmware))
        faults = program_faults(program, [program.parents[1] / _START_SCRIPT])
        if options.pace == "quiet" and (fault := quiet_fault()):
            faults.append(fault)
        if not _follows(vehicle):
            faults += _failure_faults(vehicle.failures)
        return faults

    @contextmanager
    def open(self, plan: FirmwarePlan) -> Generator[RunningPx4]:
        autopilot, body, links = plan.options, plan.body, plan.links
        assert isinstance(autopilot, RealAutopilot)
        program_path = self.program(Path(autopilot.firmware).resolve())
        firmware = program_path.parents[1]
        parameters = merged(
            px4_parameters(log=autopilot.log, charge=plan.battery.fraction),
            plan.simspec.vehicle.parameters,
            autopilot.parameters,
        )
        environment = {
            "PATH": f"{firmware}/bin:/usr/bin:/bin",
            "PX4_SIM_MODEL": _AIRFRAME,
            **{f"PX4_PARAM_{name}": text for name, text in parameters.items()},
        }
        with ExitStack() as stack:
            program = stack.enter_context(open_program(self.name, plan.folder, environment, "sdd"))
            sockets = _Sockets(program, plan.budgets)
            stack.callback(sockets.close)
            instance = stack.enter_context(claimed_instance(sockets.open))
            stack.callback(_remove_traces, instance)
            ports = sockets.ports(links)
            cores = frozenset() if autopilot.pace == "free" else frozenset({core_of(instance)})
            (plan.folder / "etc").symlink_to(firmware / "etc")
            command = [str(program_path), "-d", "-i", str(instance), "-s", _START_SCRIPT]
            program.run(command, cores)
            threads = None if unseen_reason() else ThreadWatch(program.pid, program.check_alive)
            if threads:
                stack.callback(threads.close)
            sockets.link.connect(threads.asleep if threads else None)
            watch = threads if autopilot.pace == "quiet" else None
            yield RunningPx4(plan.simspec, body, program, sockets, ports, cores, watch)


class _Sockets:
    """Everything that the bench binds for one PX4, before it starts: what it finds free is its alone."""

    link: Px4Link
    onboard: UdpPort

    def __init__(self, program: FirmwareProgram, budgets: Budgets) -> None:
        self._program, self._budgets = program, budgets
        self._stack = ExitStack()
        self._gcs: UdpPort | None = None

    def open(self, instance: int) -> bool:
        """Bind the ports of this number; False, and nothing bound, where one of them is taken."""
        program = self._program
        with ExitStack() as stack:
            try:
                self.link = Px4Link(
                    PHYSICS_PORT + instance,
                    check_alive=program.check_alive,
                    connect_s=self._budgets.connect_s,
                    answer_s=self._budgets.answer_s,
                    server=program.new_socket(socket.SOCK_STREAM),
                )
                stack.callback(self.link.close)
                self.onboard = UdpPort(
                    _ONBOARD_PORT + instance, _ONBOARD_PEER + instance, program.new_socket(socket.SOCK_DGRAM)
                )
                stack.callback(self.onboard.close)
            except OSError:
                return False
            # One port for all instances: on a network that autopilots share, the first has it.
            with suppress(OSError):
                self._gcs = UdpPort(_GCS_PORT, _GCS_PEER + instance, program.new_socket(socket.SOCK_DGRAM))
                stack.callback(self._gcs.close)
            self._stack = stack.pop_all()
            return True

    def ports(self, links: Sequence[LinkSpec]) -> dict[str, UdpPort]:
        """The connection of each link: links for a ground station have PX4's, all others the onboard computer's."""
        fault = self._program.network_fault
        if self._gcs is None and any(link.streams == "gcs" for link in links):
            raise SetupError(
                f"UDP port {_GCS_PORT}",
                f"another program has it, and PX4 sends there whatever its number: it has no network of its own ({fault})",
                "end the other program",
            )
        px4_ports = [_GCS_PORT, *range(_ONBOARD_PORT, _GCS_PORT)]
        if fault and (
            taken := [link.port for link in links if link.kind == "udp_out" and link.port in px4_ports]
        ):
            raise SetupError(
                "--mavlink",
                f"PX4 itself sends to UDP port {taken[0]}: it has no network of its own here ({fault})",
                "give links to other ports, for example --mavlink udpout:127.0.0.1:14600",
            )
        gcs = self._gcs or self.onboard
        return {link.name: gcs if link.streams == "gcs" else self.onboard for link in links}

    def connections(self) -> list[UdpPort]:
        return [self.onboard, *([self._gcs] if self._gcs else [])]

    def close(self) -> None:
        self._stack.close()


class RunningPx4(RunningFirmware):
    """PX4 on its links, with the sensors that the bench simulates for it."""

    def __init__(
        self,
        simspec: SimSpec,
        body: Body,
        program: FirmwareProgram,
        sockets: _Sockets,
        ports: Mapping[str, UdpPort],
        cores: frozenset[int],
        watch: ThreadWatch | None,
    ) -> None:
        self.program = program
        self.estimate_port: MavlinkPort = sockets.onboard
        self.ports: Mapping[str, MavlinkPort] = ports
        self.connections: Sequence[MavlinkPort] = sockets.connections()
        self.cores = cores
        self.armed: bool | None = False
        self.silent_s = 0.0
        self._follows = _follows(simspec.vehicle)
        self._sample_s = 1.0 / body.samples_hz
        self._plant, self._link, self._watch = body.plant, sockets.link, watch
        self._samples = Px4Samples(simspec, body)
        self._is_starting = True

    def fly_sample(self, *, new_fix: bool) -> None:
        time_us = self._samples.advance()
        self._is_starting = time_us < _STARTING_US
        messages = self._samples.messages(
            time_us, new_fix=new_fix, truth_interval_us=self._link.truth_interval_us
        )
        if self._watch:
            self._watch.wait(starting=self._is_starting)
        controls = self._link.exchange(time_us, b"".join(messages))
        self.silent_s = self._link.silent * self._sample_s
        if controls is None:
            if self.silent_s:
                # What it said last need not hold any more.
                self.armed = None
            return
        self.armed = controls.armed
        # NaN stands for an output that is stopped.
        self._plant.turn_rotors(
            [0.0 if math.isnan(share) else share for share in controls.outputs[: len(ROTORS)]]
        )

    def simulated_parameters(self, *, gps_off: bool, charge: float) -> dict[str, float]:
        """Its battery falls to the bench's charge by whole percents. That fixes cease it sees on the physics link."""
        return {PX4_CHARGE: charge_percent(charge)} if self._follows else {}

    def settle(self) -> None:
        if self._watch:
            self._watch.wait(starting=self._is_starting)

    def last_words(self) -> str:
        return self.program.last_words()

    def counters(self) -> Mapping[str, int]:
        return {"firmware_unanswered": self._link.unanswered}


def _follows(vehicle: VehicleSpec) -> bool:
    """Whether PX4's simulated battery has the charge of the bench's: not where its user has set one."""
    assert isinstance(vehicle.autopilot, RealAutopilot)
    given = (*vehicle.parameters, *vehicle.autopilot.parameters)
    return not any(name.startswith("SIM_BAT_") for name in given)


def _failure_faults(failures: Sequence[Failure]) -> list[Fault]:
    return [
        Fault(
            f"vehicle.failures[{index}].kind",
            f"{failure.kind} does not reach a real PX4 whose parameters SIM_BAT_* are given: its battery is its own then",
            "leave these parameters out",
        )
        for index, failure in enumerate(failures)
        if failure.kind == "battery_drop"
    ]


def _remove_traces(instance: int) -> None:
    """What a PX4 that was killed leaves in /tmp."""
    for name in (f"px4_lock-{instance}", f"px4-sock-{instance}"):
        with suppress(OSError):
            os.unlink(f"/tmp/{name}")
