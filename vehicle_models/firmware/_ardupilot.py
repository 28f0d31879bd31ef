"""Real ArduPilot: JSON over UDP for the physics, TCP for its clients."""

from __future__ import annotations

import math
import socket
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bench.contracts import VehiclePlan
from bench.documents import Document
from bench.errors import Fault
from bench.simspec import RealAutopilot

from .._battery import FULL_V, BatteryModel
from ..x500 import ROTORS
from ._airframe import BATTERY_NOMINAL_V, ardupilot_parameters, charge_percent, merged
from ._ardupilot_link import PHYSICS_PORT, ArduPilotLink, ArduPilotMetres, encoded_state, rotor_share
from ._body import Body
from ._firmware import FirmwarePlan, RunningFirmware, program_faults, program_identity
from ._instances import claimed_instance
from ._mavlink_ports import TcpPort
from ._pace import core_of
from ._program import FirmwareProgram, open_program

# Of instance N: all + 10 N.
_SERIAL0_PORT, _SERIAL1_PORT, _SERIAL2_PORT = 5760, 5762, 5763
_PORTS_PER_INSTANCE = 10
_DEFAULTS_FILE = "rebar.parm"
# Of a full battery, as ArduCopter 4.6.3 has it: its voltage limits are for three cells, the bench's battery has four.
_FULL_V = 12.6
# MAV_CMD_BATTERY_RESET, with a mask of batteries.
_BATTERY_RESET, _FIRST_BATTERY = 42651, 1.0
# It reads its start by atoi(3), which ends in 2038.
_LAST_START_S = 2**31 - 1
# It waits for nobody: the bench's answers are its clock.
_SPEEDUP = 1000


class ArduPilotKind:
    """How to start ArduCopter."""

    name = "ArduPilot"
    modes = "ardupilot"
    options: type[Document] = RealAutopilot
    # With a main loop of 400 Hz it refuses to arm below 720 Hz.
    samples_hz = 800
    boot_s = 50.0
    estimate_hz: float | None = 50.0
    logs: Sequence[str] = ("logs/*.BIN",)

    def identity(self, options: Document) -> str:
        assert isinstance(options, RealAutopilot)
        return program_identity(Path(options.firmware), options.pace)

    def faults(self, plan: VehiclePlan, options: Document) -> list[Fault]:
        assert isinstance(options, RealAutopilot)
        return program_faults(Path(options.firmware), [])

    @contextmanager
    def open(self, plan: FirmwarePlan) -> Generator[RunningArduPilot]:
        autopilot, body, links = plan.options, plan.body, plan.links
        assert isinstance(autopilot, RealAutopilot)
        with ExitStack() as stack:
            environment = {"PATH": "/usr/bin:/bin"}
            program = stack.enter_context(open_program(self.name, plan.folder, environment, "dsss"))
            physics: list[ArduPilotLink] = []

            def bind(number: int) -> bool:
                """Bind the physics' port of this number; False where it, or the first that ArduPilot needs, is taken."""
                offset = _PORTS_PER_INSTANCE * number
                if program.network_fault and not _is_free(_SERIAL0_PORT + offset):
                    return False
                try:
                    link = ArduPilotLink(
                        PHYSICS_PORT + offset,
                        check_alive=program.check_alive,
                        connect_s=plan.budgets.connect_s,
                        answer_s=plan.budgets.answer_s,
                        unbound=program.new_socket(socket.SOCK_DGRAM),
                    )
                except OSError:
                    return False
                stack.callback(link.close)
                physics.append(link)
                return True

            instance = stack.enter_context(claimed_instance(bind))
            cores = frozenset() if autopilot.pace == "free" else frozenset({core_of(instance)})
            parameters = merged(
                ardupilot_parameters(
                    log=autopilot.log,
                    samples_hz=body.samples_hz,
                    capacity_wh=plan.simspec.vehicle.battery.capacity_wh,
                ),
                plan.simspec.vehicle.parameters,
                autopilot.parameters,
            )
            lines = [f"{name} {text}\n" for name, text in parameters.items()]
            (plan.folder / _DEFAULTS_FILE).write_text("".join(lines), encoding="utf-8")
            latitude_e7, longitude_e7 = body.home_e7
            home = f"{latitude_e7 / 1e7:.7f},{longitude_e7 / 1e7:.7f},{body.ground_m:g},{body.heading_deg:g}"
            command = [str(Path(autopilot.firmware).resolve()), "--model", "JSON", "--speedup", str(_SPEEDUP)]
            command += ["--home", home, "--start-time", str(self._start_s(plan))]
            command += ["--defaults", _DEFAULTS_FILE, f"-I{instance}"]
            program.run(command, cores)

            def port(first_number: int) -> TcpPort:
                number = first_number + _PORTS_PER_INSTANCE * instance
                tcp_port = TcpPort(number, program.new_socket(socket.SOCK_STREAM), program.check_alive)
                stack.callback(tcp_port.close)
                return tcp_port

            # The first of the vehicle's links has SERIAL0 as with the SITL, the others share SERIAL1; the bench reads the
            # estimate on SERIAL2, where its requests change no client's streams. All are taken, also where no link needs
            # one: on a network that they share, an agent must find no free one.
            first, second, third = port(_SERIAL0_PORT), port(_SERIAL1_PORT), port(_SERIAL2_PORT)
            # Nothing of it runs before its first port has a client.
            first.open(plan.budgets.connect_s)
            running = RunningArduPilot(body, plan.battery, program, physics[0], cores)
            running.ports = {link.name: first if number == 0 else second for number, link in enumerate(links)}
            running.estimate_port = third
            running.connections = [first, second, third]
            yield running

    def _start_s(self, plan: FirmwarePlan) -> int:
        """When its receiver's clock begins, in seconds since 1970: without it, at the host's time, and no two flights agree."""
        return min(math.floor(plan.simspec.environment.start_utc.timestamp() - plan.boot_s), _LAST_START_S)


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


class RunningArduPilot(RunningFirmware):
    """ArduPilot on its links. It makes its sensors from the truth, which carries the error of the receiver's position."""

    def __init__(
        self,
        body: Body,
        battery: BatteryModel,
        program: FirmwareProgram,
        link: ArduPilotLink,
        cores: frozenset[int],
    ) -> None:
        self.program = program
        self.cores = cores
        self.armed: bool | None = None
        self._body, self._battery, self._link = body, battery, link
        self._measure_battery()
        self._metres = ArduPilotMetres(*body.home_e7)
        self._samples = 0
        # The pulses of the next step. Received before the present step ends, so that all that ArduPilot has sent in it
        # on its MAVLink ports lies there when they are read.
        self._pulses = link.receive()

    def fly_sample(self, *, new_fix: bool) -> None:
        body, plant = self._body, self._body.plant
        plant.turn_rotors([rotor_share(pulse_us) for pulse_us in self._pulses[: len(ROTORS)]])
        plant.advance()
        self._samples += 1
        # Horizontal places go to its receiver alone, so the receiver's error is put there. The barometer is made from
        # the height, which stays the truth.
        north_m, east_m = self._metres.north_east_m(*body.seen_latitude_longitude_deg())
        self._link.answer(
            encoded_state(
                self._samples / body.samples_hz,
                body.rates_radps(),
                plant.specific_force_mps2(),
                (north_m, east_m, -plant.motion.up_m),
                body.attitude(),
                body.velocity_ned_mps(),
                self._volts_amperes,
            )
        )
        self._pulses = self._link.receive()

    def simulated_parameters(self, *, gps_off: bool, charge: float) -> dict[str, float]:
        """It simulates its receiver itself, so what breaks it is a parameter of its simulation."""
        return {"SIM_GPS_DISABLE": float(gps_off)}

    def drop_command(self, charge: float) -> tuple[int, float, float]:
        """It counts the charge from the current, so it has to be told what was lost at once."""
        return _BATTERY_RESET, _FIRST_BATTERY, charge_percent(charge)

    def settle(self) -> None:
        """It does nothing between two packets. The battery changes once a step."""
        self._measure_battery()

    def _measure_battery(self) -> None:
        volts, _ = self._battery.terminals()
        # At the voltage by which BATT_CAPACITY was made of the battery's energy: coulombs then tell the true share of it.
        self._volts_amperes = (volts * _FULL_V / FULL_V, self._battery.power_w / BATTERY_NOMINAL_V)

    def last_words(self) -> str:
        return self.program.last_words()

    def counters(self) -> Mapping[str, int]:
        link = self._link
        return {
            "firmware_repeated": link.repeated,
            "firmware_restarts": link.restarts,
            "firmware_strangers": link.strangers,
        }
