"""In a session no MAVLink client changes the simulation; where the SimSpec allows it, it can as with a SITL."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from vehicle_client import Client, Make, mavlink, of, simspec

from vehicle_models.controller import AUTOPILOTS
from vehicle_models.tables import SIMULATED_SENSORS

REAL32, INT32 = 9, 6
READ_ONLY = 5
TRIED = {
    "px4": ("SIM_BAT_DRAIN", "SIH_MASS", "SYS_FAILURE_EN", "SYS_HITL"),
    "ardupilot": ("SIM_BATT_VOLTAGE", "SIM_RC_FAIL"),
}
FREE = {"px4": "MPC_XY_CRUISE", "ardupilot": "WPNAV_SPEED"}


def restricted(autopilot: str, **vehicle: Any) -> Any:
    return simspec(autopilot, vehicle={"simulation_control": False, **vehicle})


def set_to(client: Client, name: str, value: float, kind: int = REAL32) -> list[Any]:
    client.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    return client.fly(0.1)


def kind_of(autopilot: str, name: str) -> int:
    return next(
        parameter.kind for parameter in AUTOPILOTS[autopilot].parameters.definitions if parameter.name == name
    )


def wire(autopilot: str, name: str, value: int) -> float:
    """A value as the autopilot takes it: PX4 has the bits of an integer in the float."""
    bitwise = autopilot == "px4" and kind_of(autopilot, name) != REAL32
    return float(struct.unpack("<f", struct.pack("<i", value))[0]) if bitwise else float(value)


@pytest.mark.parametrize("autopilot", sorted(TRIED))
def test_parameters_of_the_simulation_can_be_read_and_not_set(make: Make, autopilot: str) -> None:
    """Each is refused as the autopilot refuses, counted, and keeps its value; others are set."""
    client = make(restricted(autopilot))
    before = dict(client.vehicle.changed_parameters())  # type: ignore[attr-defined]
    for number, name in enumerate(TRIED[autopilot], start=1):
        answers = set_to(client, name, wire(autopilot, name, 7), kind_of(autopilot, name))
        if autopilot == "px4":
            assert [error.error for error in of("PARAM_ERROR", answers)] == [READ_ONLY]
            assert of("PARAM_VALUE", answers) == []
        else:
            assert f"Param write denied ({name})" in client.texts()
            (value,) = of("PARAM_VALUE", answers)
            assert value.param_value != 7.0
        assert client.vehicle.counters()["simulation_refused"] == number
        assert client.vehicle.changed_parameters() == before  # type: ignore[attr-defined]
    free = FREE[autopilot]
    assert of("PARAM_VALUE", set_to(client, free, 7.0, kind_of(autopilot, free)))[0].param_value == 7.0
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, TRIED[autopilot][0].encode(), -1))
    assert of("PARAM_VALUE", client.fly(0.1))[0].param_id == TRIED[autopilot][0]
    assert client.vehicle.counters()["simulation_refused"] == len(TRIED[autopilot])


def test_names_in_another_case_are_refused_too(make: Make) -> None:
    """ArduPilot finds names in any case, and so does the refusal; PX4 knows no such name."""
    client = make(restricted("ardupilot"))
    set_to(client, "sim_batt_voltage", 9.0)
    assert "Param write denied (SIM_BATT_VOLTAGE)" in client.texts()
    px4 = make(restricted("px4"))
    (error,) = of("PARAM_ERROR", set_to(px4, "sim_bat_drain", 9.0))
    assert error.error == 1


def test_failures_are_not_injected(make: Make) -> None:
    """DENIED though SYS_FAILURE_EN is 1, by two commands; nothing breaks, and both are counted."""
    client = make(restricted("px4", parameters={"SYS_FAILURE_EN": 1}))
    assert client.command(mavlink.MAV_CMD_INJECT_FAILURE, 4, 1, 0) == [2]
    assert client.command(mavlink.MAV_CMD_INJECT_FAILURE, 101, 1, 1) == [2]
    client.fly(0.1)
    assert client.vehicle.condition().failures == ()
    assert client.vehicle.counters()["simulation_refused"] == 2


def test_the_simspec_allows_it_and_sets_anything_itself(make: Make) -> None:
    """With `simulation_control` the same attempts succeed and are no attempts; without, the SimSpec still sets them."""
    client = make(simspec("ardupilot"))
    assert of("PARAM_VALUE", set_to(client, "SIM_RC_FAIL", 1.0))[0].param_value == 1.0
    assert client.vehicle.counters()["simulation_refused"] == 0
    given = make(restricted("px4", parameters={"SIM_BAT_DRAIN": 20.0, "SIM_BAT_MIN_PCT": 30.0}))
    given.fly(0.1)
    assert given.vehicle.changed_parameters()["SIM_BAT_DRAIN"] == 20.0  # type: ignore[attr-defined]


@pytest.mark.parametrize("autopilot", sorted(TRIED))
def test_nobody_plays_the_sensors(make: Make, autopilot: str) -> None:
    """Every message of the table, filled with zeros, is counted as unheard; the vehicle's estimate stays."""
    client, other = make(restricted(autopilot)), make(restricted(autopilot))
    for name in SIMULATED_SENSORS:
        kind = getattr(mavlink, f"MAVLink_{name.lower()}_message")
        lengths = [kind.array_lengths[kind.ordered_fieldnames.index(field)] for field in kind.fieldnames]
        client.send(kind(*[[0] * length if length > 1 else 0 for length in lengths]))
    client.fly(2.0)
    other.fly(2.0)
    assert client.vehicle.counters()["mavlink_unheard"] == len(SIMULATED_SENSORS)
    assert client.vehicle.estimate() == other.vehicle.estimate()
    assert client.vehicle.truth() == other.vehicle.truth()
