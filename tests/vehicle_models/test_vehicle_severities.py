"""Texts of returns, failsafes and refusals with their severities, beside what the real autopilots sent."""

from __future__ import annotations

from test_vehicle_failsafes import beat, copter, px4
from vehicle_client import NAN, Client, Make, simspec

from vehicle_models.controller.links._dialect import dialect as mavlink

EMERGENCY, CRITICAL, WARNING, NOTICE, INFO = 0, 2, 4, 5, 6
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM


def sent(client: Client, begun: int) -> list[tuple[int, str]]:
    """Severity and text of each STATUSTEXT since, in order; chunks of one text joined."""
    texts: list[tuple[int, str]] = []
    for message in client.received[begun:]:
        if message.get_type() == "STATUSTEXT":
            if message.chunk_seq:
                texts[-1] = (texts[-1][0], texts[-1][1] + message.text)
            else:
                texts.append((message.severity, message.text))
    return [(severity, text.removesuffix("\t")) for severity, text in texts]


def test_px4_returns_lands_and_refuses_in_these_words(make: Make) -> None:
    client = px4(make)
    begun = len(client.received)
    client.command(ARM, 1)
    client.fly(5.0)
    client.command(ARM, 1)
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, NAN, 0, 0, NAN, NAN, NAN, NAN)
    client.fly(7.0)
    client.command(ARM, 0)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 4)
    client.command(mavlink.MAV_CMD_MISSION_START)
    client.command_int(mavlink.MAV_CMD_DO_ORBIT, 5, 1e6, 1, 0, NAN, 0, 0, NAN)
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    client.fly(20.0)
    assert sent(client, begun) == [
        (CRITICAL, "Arming denied: Resolve system health failures first"),
        (INFO, "Armed by external command"),
        (INFO, "Using default takeoff altitude: 2.5 m"),
        (INFO, "Takeoff detected"),
        (CRITICAL, "Disarming denied: not landed"),
        (CRITICAL, "Switching to Mission is currently not available"),
        (CRITICAL, "Mission start denied! No valid mission"),
        (CRITICAL, "Orbit radius limit exceeded"),
        (INFO, "Returning to launch"),
        (INFO, "RTL: start return at 491 m (3 m above destination)"),
        (INFO, "RTL: land at destination"),
        (INFO, "Landing detected"),
        (INFO, "Disarmed by landing"),
    ]


def test_px4_reports_a_lost_joystick_and_a_flat_battery_in_these_words(make: Make) -> None:
    """COM_LOW_BAT_ACT 3: a warning, Hold, an emergency, the landing."""
    client = px4(make)
    client.airborne(3.0)

    def sticks() -> None:
        client.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))

    client.fly(0.5, sticks)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3)
    client.fly(1.0, sticks)
    begun = len(client.received)
    client.fly(30.0)
    hold = (CRITICAL, "Failsafe activated: entering Hold for 5 seconds")
    acts = (CRITICAL, "Failsafe activated")
    assert sent(client, begun) == [
        hold,
        acts,
        (INFO, "RTL: start return at 491 m (3 m above destination)"),
        (INFO, "RTL: land at destination"),
        (INFO, "Landing detected"),
        (INFO, "Disarmed by landing"),
    ]
    # The mode that was asked for is shown again; it cannot be armed without a joystick.
    heartbeat = client.last("HEARTBEAT")
    assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status) == (81, 3 << 16, 0)

    battery = {"COM_LOW_BAT_ACT": 3, "SIM_BAT_DRAIN": 40, "SIM_BAT_MIN_PCT": 0}
    client = make(simspec(vehicle={"parameters": battery}))
    client.airborne(3.0)
    begun = len(client.received)
    client.fly(40.0)
    texts = [text for text in sent(client, begun) if "attery" in text[1] or "Failsafe" in text[1]]
    assert texts[:4] == [(CRITICAL, "Low battery"), hold, (EMERGENCY, "Emergency battery level"), acts]


def test_px4_is_disarmed_by_force_at_once(make: Make) -> None:
    """In the air, without force refused; with it the rotors stop in that step."""
    client = px4(make)
    client.airborne(3.0)
    begun = len(client.received)
    assert client.command(ARM, 0) == [1]
    assert client.command(ARM, 0, 21196) == [0]
    assert not client.vehicle.condition().armed
    assert sent(client, begun) == [
        (CRITICAL, "Disarming denied: not landed"),
        (INFO, "Disarmed by external command"),
    ]


def test_ardupilot_reports_failsafes_and_refusals_in_these_words(make: Make) -> None:
    """A lost station, the radio, a low battery, a fence and refusals, one after the other in one flight."""
    client = copter(make, FS_GCS_ENABLE=1, BATT_FS_LOW_ACT=2, BATT_LOW_VOLT=11, BATT_LOW_TIMER=1)
    begun = len(client.received)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 99)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 23)
    client.fly(6.0)
    client.fly(1.0, lambda: beat(client))
    client.put(SIM_RC_FAIL=1)
    client.fly(1.5, lambda: beat(client))
    client.put(SIM_RC_FAIL=0)
    client.fly(1.0, lambda: beat(client))
    client.put(SIM_BATT_VOLTAGE=10.8)
    client.fly(3.0, lambda: beat(client))
    texts = sent(client, begun)
    (low,) = [text for _, text in texts if text.startswith("Battery 1 is low ")]
    assert texts == [
        (WARNING, "No such mode 99"),
        (WARNING, "Mode change to AUTO failed: init failed"),
        (WARNING, "Set FOLL_ENABLE = 1"),
        (WARNING, "Mode change to FOLLOW failed: init failed"),
        (WARNING, "GCS Failsafe"),
        (WARNING, "GCS Failsafe Cleared"),
        (WARNING, "Radio Failsafe"),
        (WARNING, "Radio Failsafe Cleared"),
        (WARNING, low),
        (WARNING, "Battery Failsafe"),
    ]


def test_ardupilot_reports_a_fence_and_a_landing_in_these_words(make: Make) -> None:
    client = copter(make, FENCE_ENABLE=1, FENCE_TYPE=2, FENCE_RADIUS=30, RTL_LOIT_TIME=0)
    begun = len(client.received)
    velocity = 0xFC7

    def north() -> None:
        beat(client)
        if client.vehicle.condition().mode == "GUIDED":
            client.setpoint(0, 0, 0, velocity, vn=6.0)

    client.fly(60.0, north)
    texts = sent(client, begun)
    (ground,) = [text for _, text in texts if text.startswith("SIM Hit ground at ")]
    assert [text for text in texts if "Manual" not in text[1]] == [
        (NOTICE, "Circle fence breached"),
        (NOTICE, "Fence breach cleared"),
        (INFO, ground),
        (INFO, "Disarming motors"),
    ]
