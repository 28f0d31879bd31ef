"""Which messages of an agent count as moving the vehicle."""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from bench.contracts import OPERATOR_LINK, is_mavlink_from_agent, mavlink_topic
from bench.recording._control_messages import moving_messages

SETPOINT = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 2496, *[0.0] * 11)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)


def command(number: int, target: int = 1) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_long_message(target, target, number, 0, *[0.0] * 7)


def packed(*messages: mavlink.MAVLink_message, version_1: bool = False) -> bytes:
    link = mavlink.MAVLink(None, srcSystem=245)
    return b"".join(message.pack(link, force_mavlink1=version_1) for message in messages)


def test_setpoints_modes_and_unknown_commands_move_and_requests_do_not() -> None:
    """In both framings, with a payload cut short, and among garbage."""
    mode, interval = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    messages = [HEARTBEAT, command(interval), SETPOINT, command(mode), command(mode, 0), command(59999)]
    moving = ["message 84", f"command {mode}", f"command {mode}", "command 59999"]
    assert list(moving_messages(packed(*messages))) == moving
    assert list(moving_messages(packed(*messages, version_1=True))) == moving
    assert list(moving_messages(b"noise" + packed(SETPOINT) + packed(SETPOINT)[:9])) == ["message 84"]
    assert list(moving_messages(b"")) == []


def test_signed_frames_are_read_too() -> None:
    """A signature makes a frame thirteen bytes longer."""
    link = mavlink.MAVLink(None, srcSystem=245)
    link.signing.secret_key, link.signing.sign_outgoing, link.signing.timestamp = bytes(32), True, 1
    data = SETPOINT.pack(link) + HEARTBEAT.pack(link) + SETPOINT.pack(link)
    assert list(moving_messages(data)) == ["message 84", "message 84"]


def test_what_the_operator_sends_is_not_the_agent_s() -> None:
    """Only the agent's own links, and only what it sent."""
    assert is_mavlink_from_agent(mavlink_topic("onboard", "from_agent"))
    assert not is_mavlink_from_agent(mavlink_topic("onboard", "to_agent"))
    assert not is_mavlink_from_agent(mavlink_topic(OPERATOR_LINK, "from_agent"))
    assert not is_mavlink_from_agent("/vehicle_1/agent/reports")
