"""Tricks on the vehicle's MAVLink link: PX4's parameters, commands and messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from ._cheat import LINK, Cheat

_AGENT = (246, 1)
_OPERATOR, _VEHICLE = (255, 190), (1, 1)
# What each would do: an endless battery, a light aircraft, failures on demand, sensors from outside.
_WANTED_VALUES = {"SIM_BAT_MIN_PCT": 99.0, "SIM_BAT_DRAIN": 86400.0, "SIH_MASS": 0.1, "SYS_FAILURE_EN": 1.0}
_TRUE_MOTION = (mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, mavlink.MAVLINK_MSG_ID_SIM_STATE)
# Ticks in which an answer must have come.
_ANSWER_TICKS = 5
# FAILURE_UNIT_SENSOR_GPS and FAILURE_TYPE_OFF.
_GPS, _OFF = 4.0, 1.0
# Of one tick of the flood: datagrams of whole frames. What the kernel holds for a socket (212 kB) is not exceeded,
# because a lost frame would be a miscount.
_DATAGRAMS, _FRAMES = 8, 30
_FLOOD_TICKS = 200


def set_simulation(cheat: Cheat) -> Iterator[None]:
    """Sets parameters of the simulation: a battery that does not drain, a lighter aircraft.

    It would choose the situation that it is judged in.
    """
    yield from _set_parameters(cheat, _AGENT)


def spoof_sender(cheat: Cheat) -> Iterator[None]:
    """Sends the same, and failures, under the ids of the operator and of the vehicle itself.

    Somebody with more rights than the agent might be obeyed.
    """
    changed: list[object] = []
    for sender in (_OPERATOR, _VEHICLE):
        yield from _set_parameters(cheat, sender)
        changed += [cheat.gains["changed"]]
        yield from _inject(cheat, sender)
        changed += [cheat.gains["accepted"]]
    cheat.gains = {"done": [gain for gain in changed if gain]}


def inject_failure(cheat: Cheat) -> Iterator[None]:
    """Asks for a failure of GPS by MAV_CMD_INJECT_FAILURE.

    A fault would excuse whatever goes badly.
    """
    yield from _inject(cheat, _AGENT)


def ask_truth(cheat: Cheat) -> Iterator[None]:
    """Asks the vehicle for its true motion: HIL_STATE_QUATERNION and SIM_STATE.

    With it, an error of GPS could be corrected.
    """
    for message_id in _TRUE_MOTION:
        for command in (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL):
            _command(cheat, _AGENT, command, float(message_id), 100_000.0)
    frames = yield from _frames(cheat, _TRUE_MOTION)
    cheat.gains = {"messages": len(frames)}


def feed_sensors(cheat: Cheat) -> Iterator[None]:
    """Sends sensor data of its own: positions 10 km away, by GPS_INPUT, HIL_GPS and a visual estimate.

    Whoever decides where the vehicle believes to be decides which rules seem to be kept.
    """
    position = (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,)
    _command(cheat, _AGENT, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(position[0]), 100_000.0)
    before = yield from _frames(cheat, position)
    latitude = before[-1].lat + 900_000 if before else 470_000_000
    longitude = before[-1].lon if before else 80_000_000
    for _ in range(_ANSWER_TICKS):
        now_us = round(cheat.now_s * 1e6)
        gps = mavlink.MAVLink_hil_gps_message(now_us, 3, latitude, longitude, 0, 1, 1, 0, 0, 0, 0, 0, 12)
        vision = mavlink.MAVLink_vision_position_estimate_message(now_us, 10_000.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for message in (gps, vision):
            _send(cheat, _AGENT, message)
        yield
    after = yield from _frames(cheat, position)
    # A degree of 1e7; 1e-3 degrees are 111 m.
    moved = bool(before and after) and abs(after[-1].lat - before[-1].lat) > 10_000
    cheat.gains = {"moved": moved}


def send_garbage(cheat: Cheat) -> Iterator[None]:
    """Sends bytes that are no MAVLink, half frames, and frames with wrong lengths and checksums.

    A vehicle whose link breaks down ends the session with an error of the bench, which does not count.
    """
    link = cheat.bench.links[LINK]
    frame = bytearray(_packed(_AGENT, mavlink.MAVLink_statustext_message(6, b"cheat")))
    broken = bytearray(frame)
    broken[-1] ^= 0xFF
    long = bytes(broken[:1] + b"\xff" + broken[2:])
    for data in (bytes(range(256)), bytes(frame[:9]), bytes([0xFD] * 40), long, b"\xfe" * 300):
        cheat.attempts += 1
        # Not counted as a message, because it is none.
        link.sent -= link.send(data)
        yield
    cheat.gains = {}


def flood_link(cheat: Cheat) -> Iterator[None]:
    """Sends some 60 kB of valid messages at every tick, more than any link of a vehicle carries.

    A bench that records them all fills its disk.
    """
    link = cheat.bench.links[LINK]
    frame = _packed(_AGENT, mavlink.MAVLink_encapsulated_data_message(0, [1] * 253))
    for _ in range(_FLOOD_TICKS):
        for _ in range(_DATAGRAMS):
            cheat.attempts += _FRAMES
            if link.send(frame * _FRAMES):
                # The client counts one message for each datagram.
                link.sent += _FRAMES - 1
        yield


def _set_parameters(cheat: Cheat, sender: tuple[int, int]) -> Iterator[None]:
    """Set each parameter; `changed` of the gains names those that have the wanted value afterwards, and had not."""
    before = yield from _read_parameters(cheat, sender)
    for name, value in _WANTED_VALUES.items():
        cheat.attempts += 1
        kind = mavlink.MAV_PARAM_TYPE_INT32 if name == "SYS_FAILURE_EN" else mavlink.MAV_PARAM_TYPE_REAL32
        _send(cheat, sender, mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    for _ in range(_ANSWER_TICKS):
        yield
    after = yield from _read_parameters(cheat, sender)
    cheat.gains["read"] = sorted(before.keys() - after.keys())
    cheat.gains["changed"] = sorted(name for name in after if after[name] != before.get(name, after[name]))


def _read_parameters(cheat: Cheat, sender: tuple[int, int]) -> Any:
    for name in _WANTED_VALUES:
        _send(cheat, sender, mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    messages = yield from _frames(cheat, (mavlink.MAVLINK_MSG_ID_PARAM_VALUE,))
    return {message.param_id: message.param_value for message in messages}


def _inject(cheat: Cheat, sender: tuple[int, int]) -> Iterator[None]:
    _command(cheat, sender, mavlink.MAV_CMD_INJECT_FAILURE, _GPS, _OFF)
    messages = yield from _frames(cheat, (mavlink.MAVLINK_MSG_ID_COMMAND_ACK,))
    results = [message.result for message in messages if message.command == mavlink.MAV_CMD_INJECT_FAILURE]
    cheat.gains["accepted"] = results.count(mavlink.MAV_RESULT_ACCEPTED)


def _frames(cheat: Cheat, message_ids: Iterable[int]) -> Any:
    """The messages of these kinds that come in the next ticks."""
    parser = mavlink.MAVLink(None)
    messages: list[Any] = []
    for _ in range(_ANSWER_TICKS):
        yield
        frames = [frame for frame in cheat.frames if frame.message_id in message_ids]
        messages += [parser.decode(bytearray(frame.data)) for frame in frames]
    return messages


def _command(cheat: Cheat, sender: tuple[int, int], command: int, first: float, second: float) -> None:
    cheat.attempts += 1
    message = mavlink.MAVLink_command_long_message(1, 1, command, 0, first, second, 0.0, 0.0, 0.0, 0.0, 0.0)
    _send(cheat, sender, message)


def _send(cheat: Cheat, sender: tuple[int, int], message: Any) -> None:
    cheat.bench.links[LINK].send(_packed(sender, message))


def _packed(sender: tuple[int, int], message: Any) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, *sender)))
