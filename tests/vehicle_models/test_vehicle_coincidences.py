"""Two causes of a failsafe, a return without a position, two clients, a battery that dips twice."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import pytest
from test_vehicle_failsafes import copter
from vehicle_client import NAN, Client, Make, mavlink, of, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500
from vehicle_models.controller.px4._identity import EVENTS

PX4_HOLD = (1, 4, 3)
ALTCTL, POSCTL = (1, 2), (1, 3)
ALT_HOLD, GUIDED, RTL = 2, 4, 6


def sticks(client: Client) -> None:
    client.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))


def beat_and_sticks(client: Client) -> Callable[[], None]:
    def send() -> None:
        client.beat()
        sticks(client)

    return send


def lose_position(client: Client) -> None:
    """Take the satellites away until the loss of the position counts: 5.1 s later on PX4, 8.0 s on ArduCopter."""
    client.vehicle._navigation.set_off(True)  # type: ignore[attr-defined]
    client.fly(8.2, beat_and_sticks(client))


def px4_by_sticks(make: Make, mode: tuple[int, int] = POSCTL, **parameters: float) -> Client:
    """A PX4 flown by a joystick, with a ground station: lost 2.8 s and 2.9 s after they fall silent."""
    # COM_DL_LOSS_T is exceeded by 1.9 s before a station counts as lost.
    silence = {"COM_RC_LOSS_T": 2.8, "COM_DL_LOSS_T": 1.0}
    client = make(
        simspec(vehicle={"parameters": {**silence, "NAV_DLL_ACT": 2, "NAV_RCL_ACT": 2, **parameters}})
    )
    client.airborne(3.0)
    client.is_station = False
    client.fly(0.5, beat_and_sticks(client))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, *mode)
    client.fly(0.5, beat_and_sticks(client))
    return client


# Two causes of equal strength at once.


@pytest.mark.parametrize("back", ["", "station", "sticks"])
def test_px4_holds_and_returns_for_two_causes(make: Make, back: str) -> None:
    """Lost in the same tenth of a second: one Hold, one return, although one cause ends meanwhile."""
    client = px4_by_sticks(make)
    each = {"": None, "station": client.beat, "sticks": lambda: sticks(client)}[back]
    client.fly(3.2)
    assert client.state() == ("AUTO_LOITER", "link")
    client.fly(1.0, each)
    assert client.state() == ("AUTO_LOITER", "link")
    client.fly(4.5, each)
    assert client.state() == ("AUTO_RTL", "link")
    if not back:
        (number,) = {event.number for event in EVENTS if event.name == "commander_failsafe_enter"}
        events = [message.id for message in of("EVENT", client.received)]
        assert events.count(number) == 2
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, *PX4_HOLD)[-1] == 0
    assert client.state() == ("AUTO_LOITER", "")


def test_copter_returns_until_both_causes_have_ended(make: Make) -> None:
    """The remaining cause is shown, whichever of the two ends first; the mode stays."""
    client = copter(make, FS_GCS_ENABLE=1, FS_THR_ENABLE=1)
    client.fly(4.1)
    client.put(SIM_RC_FAIL=1)
    client.fly(1.3)
    assert client.state()[0] == "RTL"
    assert {"GCS Failsafe", "Radio Failsafe"} <= {*client.texts()}
    client.beat()
    client.fly(0.1)
    assert client.state() == ("RTL", "radio")
    client.put(SIM_RC_FAIL=0)
    client.fly(0.1)
    assert client.state() == ("RTL", "")


def test_copter_follows_the_later_of_two_causes(make: Make) -> None:
    """No reaction is stronger than another: a return replaces a landing."""
    client = copter(make, FS_GCS_ENABLE=1, FS_THR_ENABLE=3)
    client.fly(3.0)
    client.put(SIM_RC_FAIL=1)
    client.fly(1.2)
    assert client.state() == ("LAND", "radio")
    client.fly(1.5)
    assert client.state() == ("RTL", "link")


# A return without a position.


def test_px4_refuses_what_needs_a_position_without_one(make: Make) -> None:
    """As every mode that cannot be flown; the pilot flies on."""
    client = px4_by_sticks(make, ALTCTL)
    lose_position(client)
    assert client.state() == ("ALTCTL", "")
    for number, params, label in (
        (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, (), "RTL"),
        (mavlink.MAV_CMD_NAV_LAND, (), "Land"),
        (mavlink.MAV_CMD_NAV_TAKEOFF, (), "Takeoff"),
        (mavlink.MAV_CMD_DO_REPOSITION, (-1, 1), "Hold"),
        (mavlink.MAV_CMD_DO_ORBIT, (10, 2), "Orbit"),
        (mavlink.MAV_CMD_DO_SET_MODE, PX4_HOLD, "Hold"),
    ):
        client.received.clear()
        assert client.command(number, *params)[-1] == 1
        assert f"Switching to {label} is currently not available\t" in client.texts()
        client.fly(1.0, beat_and_sticks(client))
        assert client.state() == ("ALTCTL", "")


def test_px4_refuses_offboard_control_while_it_descends_without_a_position(make: Make) -> None:
    """An agent that asks for control again and again cannot keep the vehicle from landing."""
    client = make()
    client.airborne(5.0)
    client.vehicle._navigation.set_off(True)  # type: ignore[attr-defined]
    client.fly(5.2)
    asked = 0
    while client.vehicle.condition().armed:
        client.setpoint(0.0, 0.0, -5.0)
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)[-1] == 1
        client.fly(0.4, lambda: client.setpoint(0.0, 0.0, -5.0))
        asked += 1
    assert 10 < asked < 40


def test_px4_lands_when_a_failsafe_returns_without_a_position(make: Make) -> None:
    """Lost sticks hold and return; without a position it lands at once and stays in the landing."""
    client = px4_by_sticks(make, ALTCTL)
    lose_position(client)
    client.fly(3.2, client.beat)
    assert client.state() == ("AUTO_LAND", "sticks")
    client.fly(1.0, client.beat)
    assert client.state() == ("AUTO_LAND", "sticks")


def test_copter_refuses_what_needs_a_position_without_one(make: Make) -> None:
    """Also while the failsafe lands, which no such order ends; a landing needs none."""
    client = copter(make)
    client.fly(0.5, beat_and_sticks(client))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, ALT_HOLD)
    lose_position(client)
    for state in ("ALT_HOLD", "LAND"):
        for number, params, mode in (
            (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, (), "RTL"),
            (mavlink.MAV_CMD_NAV_LOITER_UNLIM, (), "LOITER"),
            (mavlink.MAV_CMD_DO_SET_MODE, (1, GUIDED), "GUIDED"),
        ):
            assert client.command(number, *params) == [4]
            assert f"Mode change to {mode} failed: requires position" in client.texts()
            assert client.state() == (state, "")
        assert client.command(mavlink.MAV_CMD_NAV_LAND) == [0]


def test_copter_lands_when_a_failsafe_returns_without_a_position(make: Make) -> None:
    client = copter(make, FS_GCS_ENABLE=1)
    client.fly(0.5, beat_and_sticks(client))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, ALT_HOLD)
    lose_position(client)
    assert client.state() == ("ALT_HOLD", "")
    client.fly(5.2, lambda: sticks(client))
    assert client.state() == ("LAND", "link")


# Two clients at once.


def acknowledged(client: Client) -> list[tuple[int, int, int]]:
    """Commands, results and target systems of the acknowledgements that came to a client."""
    acknowledgements = of("COMMAND_ACK", client.received)
    return [(message.command, message.result, message.target_system) for message in acknowledgements]


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_each_client_is_answered_for_itself(autopilot: str) -> None:
    """The first arms and the second disarms in one step: it stands disarmed, in the order of their links."""
    with ExitStack() as stack:
        clients = [Client(245), Client(246)]
        for client in clients:
            stack.callback(client.socket.close)
        links = tuple(
            LinkSpec(name, "udp_out", port=client.port, streams="none")
            for name, client in zip(("first", "second"), clients, strict=True)
        )
        vehicle = stack.enter_context(open_x500(VehiclePlan(simspec(autopilot), links)))
        first, second = clients
        first.vehicle = vehicle
        first.fly(5.0)
        first.command(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED, 3)
        second._listen()
        arm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
        for armed in (False, True):
            first.received.clear()
            second.received.clear()
            for client, value in ((first, not armed), (second, armed)):
                client.send(mavlink.MAVLink_command_long_message(1, 1, arm, 0, value, *[0.0] * 6))
            first.fly(0.02)
            second._listen()
            assert vehicle.condition().armed is armed
            assert acknowledged(first) == [(arm, 0, 245)]
            assert acknowledged(second) == [(arm, 0, 246)]


# A battery that dips twice.


def test_copter_reacts_to_the_first_long_dip_alone(make: Make) -> None:
    """Two dips of six seconds are none where BATT_LOW_TIMER is ten. A level that was passed is not passed again."""
    client = copter(make, BATT_LOW_VOLT=11.0, BATT_FS_LOW_ACT=2)

    def dip(seconds: float) -> tuple[str, str]:
        client.put(SIM_BATT_VOLTAGE=10.5)
        client.fly(seconds, client.beat)
        state = client.state()
        client.put(SIM_BATT_VOLTAGE=12.6)
        client.fly(1.0, client.beat)
        return state

    assert dip(6.0) == dip(6.0) == ("GUIDED", "")
    assert dip(10.6) == ("RTL", "battery")
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED) == [0]
    assert client.state() == ("GUIDED", "battery")
    assert dip(10.6) == ("GUIDED", "battery")
    assert client.texts().count("Battery Failsafe") == 1


def test_px4_warns_of_the_first_dip_and_acts_when_the_second_goes_deeper(make: Make) -> None:
    """SIM_BAT_MIN_PCT moves the charge: 10 % is low, 6 % critical."""
    battery = {"SIM_BAT_DRAIN": 10.0, "SIM_BAT_MIN_PCT": 10.0, "COM_LOW_BAT_ACT": 3}
    client = make(simspec(vehicle={"parameters": battery}))
    client.fly(5.0)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 493.0)
    client.fly(12.0)
    warnings = [text for text in client.texts() if text.strip() == "Low battery"]
    client.put(SIM_BAT_MIN_PCT=50.0)
    client.fly(1.0)
    client.put(SIM_BAT_MIN_PCT=10.0)
    client.fly(6.0)
    assert [text for text in client.texts() if text.strip() == "Low battery"] == warnings
    assert len(warnings) == 1
    assert client.state() == ("AUTO_LOITER", "")
    client.put(SIM_BAT_MIN_PCT=6.0)
    client.fly(1.0)
    assert client.state() == ("AUTO_LOITER", "battery")
    client.fly(5.0)
    assert client.state() == ("AUTO_RTL", "battery")
