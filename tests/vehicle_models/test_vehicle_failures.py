"""What breaks: by the SimSpec's timeline at exact moments, and by command where the autopilot allows it."""

from __future__ import annotations

import math
from typing import Any

import pytest
from vehicle_client import Client, Make, simspec

from bench.contracts import SESSION_EVENTS, Record
from bench.errors import SetupError
from bench.simspec import SimSpec
from bench.simulation import open_plain_scene
from bench.simulation._truth import TruthRecorder
from vehicle_models.controller.links._dialect import dialect as mavlink


def failing(*failures: dict[str, Any], **vehicle: Any) -> Any:
    return simspec(vehicle={"failures": failures, **vehicle})


def error_m(client: Client) -> float:
    """How far the vehicle is from where it believes to be, over the ground."""
    true, believed = client.vehicle.truth().position_enu_m, client.vehicle.estimate().position_enu_m
    return math.hypot(true[0] - believed[0], true[1] - believed[1])


def test_a_link_is_silent_both_ways_and_counts_stay_true(make: Make) -> None:
    """During a loss nothing is sent or handled; messages that arrive are counted; then the link works as before."""
    taped: list[tuple[str, int]] = []
    spec = failing({"at_s": 2.0, "kind": "link_loss", "link": "onboard", "duration_s": 3.0})
    client = make(spec, streams="onboard", tap=lambda link, way, data: taped.append((way, len(data))))
    client.is_station = False
    client.fly(0.92)
    assert client.vehicle.time.s == pytest.approx(2.02)
    sent, received = client.vehicle.sent()["onboard"], client.vehicle.receive()["onboard"]
    message_count = len(client.received)
    taped.clear()
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 5) == []
    client.fly(2.9)
    assert client.vehicle.condition().failures == ("link_loss onboard",)
    assert (client.vehicle.sent()["onboard"], len(client.received)) == (sent, message_count)
    assert client.vehicle.receive()["onboard"] == received + 1
    assert taped == []
    client.fly(0.5)
    assert client.vehicle.condition().failures == ()
    assert client.vehicle.condition().mode == "AUTO_LOITER"
    assert len(client.received) > message_count
    assert client.vehicle.sent()["onboard"] == len(client.received)


def test_without_fixes_the_vehicle_reckons_on_and_says_so(make: Make) -> None:
    """Fix type 0, health bits gone, an error that grows; with fixes again, all is as before."""
    client = make(failing({"at_s": 18.0, "kind": "gps_off", "duration_s": 12.0}), streams="onboard")
    client.airborne(5.0)
    client.fly(18.0 - client.vehicle.time.s)
    assert client.last("GPS_RAW_INT").fix_type == 3
    client.fly(1.0)
    assert client.last("GPS_RAW_INT").fix_type == 0
    assert not client.last("SYS_STATUS").onboard_control_sensors_health & 0x20
    early = error_m(client)
    client.fly(10.5)
    assert error_m(client) > early
    assert 0.1 < error_m(client) < 10.0
    client.fly(4.0)
    assert client.last("GPS_RAW_INT").fix_type == 3
    assert client.last("SYS_STATUS").onboard_control_sensors_health & 0x20
    assert error_m(client) < 0.1


def test_fixes_that_drift_take_the_vehicle_along(make: Make) -> None:
    """Fixes that walk east at 1 m/s for 10 s move the estimate by some 10 m; then it jumps back."""
    drift = {"at_s": 6.0, "kind": "gps_drift", "drift_mps": 1.0, "towards_deg": 90.0, "duration_s": 10.0}
    client = make(failing(drift))
    client.fly(16.0 - client.vehicle.time.s)
    true, believed = client.vehicle.truth().position_enu_m, client.vehicle.estimate().position_enu_m
    assert believed[0] - true[0] == pytest.approx(9.5, abs=0.3)
    assert believed[1] - true[1] == pytest.approx(0.0, abs=0.1)
    client.fly(4.0)
    assert error_m(client) < 0.1


def test_a_battery_falls_at_once(make: Make) -> None:
    """Charge drops to the given fraction in the step of the failure, and never rises."""
    client = make(
        failing(
            {"at_s": 3.0, "kind": "battery_drop", "to_fraction": 0.2},
            {"at_s": 4.0, "kind": "battery_drop", "to_fraction": 0.9},
        )
    )
    client.fly(3.0 - client.vehicle.time.s)
    assert client.vehicle.condition().battery_fraction > 0.9
    client.fly(0.02)
    assert client.vehicle.condition().battery_fraction == pytest.approx(0.2, abs=1e-4)
    client.fly(2.0)
    assert client.vehicle.condition().battery_fraction < 0.2


def test_a_quadrotor_without_one_rotor_comes_down(make: Make) -> None:
    """The rotor stops, whatever is commanded, and the vehicle crashes."""
    client = make(failing({"at_s": 20.0, "kind": "motor_off", "instance": 2}))
    client.airborne(10.0)
    client.fly(10.0)
    assert client.vehicle.condition().crashed
    assert "motor_off 2" in client.vehicle.condition().failures


def test_what_is_not_there_cannot_break(make: Make) -> None:
    """A rotor or a link that the vehicle does not have is a fault of the SimSpec, with its place."""
    no_rotor = {"at_s": 1, "kind": "motor_off", "instance": 5}
    no_link = {"at_s": 1, "kind": "link_loss", "link": "radio"}
    with pytest.raises(SetupError) as caught:
        make(failing(no_rotor, no_link))
    places = [fault.where for fault in caught.value.faults]
    assert places == ["vehicle.failures[0].instance", "vehicle.failures[1].link"]


def test_failures_by_command(make: Make) -> None:
    """Denied without SYS_FAILURE_EN; with it GPS and rotors, and nothing that is not modelled. ArduPilot has none."""
    inject = mavlink.MAV_CMD_INJECT_FAILURE
    assert make(failing(parameters={"SYS_FAILURE_EN": 0})).command(inject, 4, 1, 0) == [2]
    assert make(simspec("ardupilot")).command(inject, 4, 1, 0) == [3]
    client = make(failing({"at_s": 5.0, "kind": "gps_off"}))

    def failures_after(*params: float) -> tuple[str, ...]:
        assert client.command(inject, *params) == [0]
        client.fly(0.1)
        return client.vehicle.condition().failures

    assert failures_after(4, 1, 0) == ("gps_off",)
    assert failures_after(4, 0, 0) == ()
    for params in ((1, 1, 0), (101, 1, 9), (math.nan, math.nan, math.nan)):
        assert client.command(inject, *params) == [3]
    client.fly(5.0)
    # An agent cannot end the failures of the SimSpec; what it broke itself it can repair meanwhile.
    assert failures_after(101, 1, 2) == ("gps_off", "motor_off 2")
    assert failures_after(4, 0, 0) == ("gps_off", "motor_off 2")
    assert failures_after(101, 0, 2) == ("gps_off",)


def test_the_session_log_names_what_breaks_and_what_works_again(make: Make) -> None:
    """Truth writes an event at the sample after a failure and after its end."""
    records: list[Record] = []
    client = make(failing({"at_s": 2.0, "kind": "gps_off", "duration_s": 1.0}))
    realized = SimSpec.model_validate({**simspec().model_dump(), "realized": {"actors": []}})
    truth, scene = TruthRecorder("vehicle_1", records.append), open_plain_scene(realized)
    for _ in range(4):
        client.fly(0.7)
        truth.write_due(client.vehicle.time, client.vehicle, scene)
    events = [record for record in records if record.topic == SESSION_EVENTS]
    assert [b"gps_off" in event.data for event in events] == [True, True]
    assert [b'"failure"' in event.data for event in events] == [True, False]
    assert b'"repaired"' in events[1].data
