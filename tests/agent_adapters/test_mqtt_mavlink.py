"""MAVLink as JSON, against pymavlink's own classes."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import MavlinkFrame
from agent_adapters.mqtt._mavlink import MavlinkTranslator

MESSAGES = [
    mavlink.MAVLink_heartbeat_message(2, 12, 81, 65536, 3, 3),
    mavlink.MAVLink_command_long_message(1, 1, 22, 0, 0.0, 0.5, 1.0, math.nan, 47.5, 8.25, 30.0),
    mavlink.MAVLink_statustext_message(6, b"Takeoff detected"),
    mavlink.MAVLink_set_actuator_control_target_message(
        7, 0, 1, 1, [0.5, -0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.25]
    ),
]


def frame_of(message: Any, system: int = 7, component: int = 3) -> MavlinkFrame:
    data = bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component)))
    return MavlinkFrame(message.get_msgId(), system, component, data)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: str(message.msgname))
def test_both_ways_give_the_same_frame(message: Any) -> None:
    """Numbers, NaN, text and arrays; sender included."""
    document = MavlinkTranslator().to_json(frame_of(message))
    assert document is not None
    text = json.dumps(document, allow_nan=False)
    assert (document["system"], document["component"], document["name"]) == (7, 3, message.msgname)
    assert MavlinkTranslator().frame_of(text) == frame_of(message).data


def test_fields_that_are_left_out_are_zero_and_null_is_nan() -> None:
    text = '{"name": "COMMAND_LONG", "fields": {"command": 22, "param4": null}}'
    frame = MavlinkTranslator().frame_of(text)
    assert isinstance(frame, bytes)
    message = mavlink.MAVLink(None).decode(bytearray(frame))
    assert (message.command, message.param1, message.target_system) == (22, 0.0, 0)
    assert math.isnan(message.param4)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (246, 191)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("no JSON", "no mavlink-message"),
        ('{"name": "HEARTBEAT", "more": 1}', "no mavlink-message"),
        ('{"name": "HEART"}', "no message 'HEART'"),
        ('{"name": "HEARTBEAT", "fields": {"kind": 1}}', "no field 'kind'"),
        ('{"name": "HEARTBEAT", "fields": {"type": 256}}', "HEARTBEAT: "),
        ('{"name": "HEARTBEAT", "fields": {"type": "two"}}', "HEARTBEAT: "),
        ('{"name": "SET_ACTUATOR_CONTROL_TARGET", "fields": {"controls": [1.0]}}', "TARGET: "),
    ],
)
def test_what_is_no_message_says_why(text: str, words: str) -> None:
    """And the next message goes out all the same."""
    translator = MavlinkTranslator()
    answer = translator.frame_of(text)
    assert isinstance(answer, str)
    assert words in answer
    assert isinstance(translator.frame_of('{"name": "HEARTBEAT"}'), bytes)


def test_frames_of_other_dialects_and_damaged_ones_are_counted() -> None:
    translator = MavlinkTranslator()
    good = frame_of(MESSAGES[0])
    damaged = MavlinkFrame(0, 7, 3, good.data[:-1] + bytes([good.data[-1] ^ 1]))
    assert translator.to_json(damaged) is None
    assert translator.to_json(MavlinkFrame(150_000, 7, 3, good.data)) is None
    assert translator.unknown == 2
    assert translator.to_json(good) is not None
