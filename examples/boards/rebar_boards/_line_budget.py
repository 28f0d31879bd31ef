"""Which messages fit on a serial line with a board: HIL first, then what agents want to hear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bench.errors import Fault, SetupError
from vehicle_models.firmware import MESSAGE_KINDS, MESSAGE_NAMES, capacity_bps

from ._options import BAUD_FIELD, STREAMS_FIELD

# Around a payload in MAVLink 2, unsigned.
_ENVELOPE_BYTES = 12
# Rates of HIL_SENSOR and HIL_ACTUATOR_CONTROLS at which real PX4 has flown (docs/real-autopilots.md), best first.
SAMPLE_RATES_HZ = (200, 100)
GPS_HZ = 8.0
# Of each direction at most: a line that is full makes everything late.
USABLE_SHARE = 0.95
# For what PX4 sends unasked (heartbeat, acknowledgements, texts), and what an agent must be able to send: commands and a
# setpoint of 65 bytes ten times a second.
RESERVE_FROM_BOARD_BPS, RESERVE_TO_BOARD_BPS = 200.0, 700.0
# Of ATTITUDE and GLOBAL_POSITION_INT, which the bench needs for the estimate; the best that fits.
_ESTIMATE_RATES_HZ = (50.0, 25.0, 10.0, 5.0)
ESTIMATE_MESSAGES = ("ATTITUDE", "GLOBAL_POSITION_INT")
_HIL_UP, _HIL_DOWN = ("HIL_SENSOR", "HIL_GPS"), "HIL_ACTUATOR_CONTROLS"


def frame_bytes(name: str) -> int:
    """Bytes of a message at its longest. Raises KeyError for one that MAVLink does not have."""
    size: int = MESSAGE_KINDS[name].unpacker.size
    return size + _ENVELOPE_BYTES


@dataclass(slots=True)
class LineBudget:
    """What is planned on one line. Rates of messages from the board are by name, in Hz."""

    baud: int
    samples_hz: int
    streams_hz: dict[str, float]

    @property
    def free_to_board_bps(self) -> float:
        """Bytes a second that agents may send."""
        return _usable_bps(self.baud) - _to_board_bps(self.samples_hz)

    @property
    def free_from_board_bps(self) -> float:
        """Bytes a second that further streams may take."""
        streams = sum(rate * frame_bytes(name) for name, rate in self.streams_hz.items())
        return _usable_bps(self.baud) - RESERVE_FROM_BOARD_BPS - streams

    def refusal(self, number: int, rate_hz: float) -> str | None:
        """Why the board cannot send this message at this rate too; None, and it is planned, where it can.

        Rates of the messages that the bench needs cannot be lowered: a session without them has no estimate.
        """
        name = MESSAGE_NAMES.get(number)
        if name is None:
            return None
        planned_hz = self.streams_hz.get(name, 0.0)
        if name in (_HIL_DOWN, *ESTIMATE_MESSAGES) and rate_hz < planned_hz:
            return f"{name} stays at {planned_hz:g} Hz: the bench needs it"
        more_bps = (rate_hz - planned_hz) * frame_bytes(name)
        if more_bps > self.free_from_board_bps:
            return f"{name} at {rate_hz:g} Hz takes {more_bps:.0f} B/s more; {max(self.free_from_board_bps, 0):.0f} are free"
        self.streams_hz[name] = rate_hz
        return None


def plan_line(baud: int, wanted_hz: Mapping[str, float]) -> LineBudget:
    """The best rates that fit. Raises SetupError with everything that does not, and why."""
    usable = _usable_bps(baud)
    for samples_hz in SAMPLE_RATES_HZ:
        streams = {_HIL_DOWN: float(samples_hz)}
        budget = LineBudget(baud, samples_hz, streams)
        estimate_bps = _ESTIMATE_RATES_HZ[-1] * sum(frame_bytes(name) for name in ESTIMATE_MESSAGES)
        if budget.free_to_board_bps >= RESERVE_TO_BOARD_BPS and budget.free_from_board_bps >= estimate_bps:
            break
    else:
        needed = _to_board_bps(samples_hz) + RESERVE_TO_BOARD_BPS
        what = (
            f"HIL_SENSOR at {samples_hz} Hz, HIL_GPS and an agent's commands take {needed:.0f} B/s; at {baud} baud "
            f"{usable:.0f} B/s are usable"
        )
        raise SetupError(BAUD_FIELD, what, "use 115200 or more, or USB")
    return _with_streams(budget, wanted_hz)


def _with_streams(budget: LineBudget, wanted_hz: Mapping[str, float]) -> LineBudget:
    # What the user wants comes before the best estimate, but after the least that the bench can do with.
    least_hz = _ESTIMATE_RATES_HZ[-1]
    budget.streams_hz |= {name: min(wanted_hz.get(name, least_hz), least_hz) for name in ESTIMATE_MESSAGES}
    faults = []
    for name, rate_hz in wanted_hz.items():
        if name not in MESSAGE_KINDS:
            faults.append(
                Fault(f"{STREAMS_FIELD}.{name}", "is no MAVLink message", "write it as in common.xml")
            )
        elif reason := budget.refusal(MESSAGE_KINDS[name].id, rate_hz):
            faults.append(Fault(f"{STREAMS_FIELD}.{name}", reason, "lower a rate, or use a faster line"))
    if faults:
        raise SetupError(faults)
    unstated = [name for name in ESTIMATE_MESSAGES if name not in wanted_hz]
    for rate_hz in _ESTIMATE_RATES_HZ:
        step_hz = rate_hz - least_hz
        if sum(step_hz * frame_bytes(name) for name in unstated) <= budget.free_from_board_bps:
            budget.streams_hz |= dict.fromkeys(unstated, rate_hz)
            break
    return budget


def _usable_bps(baud: int) -> float:
    return USABLE_SHARE * capacity_bps(baud)


def _to_board_bps(samples_hz: int) -> float:
    sensor, gps = (frame_bytes(name) for name in _HIL_UP)
    return samples_hz * sensor + GPS_HZ * gps + frame_bytes("HEARTBEAT")
