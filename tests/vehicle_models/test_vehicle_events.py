"""Events of PX4: those that are a text as well, and those that are none."""

from __future__ import annotations

from collections.abc import Callable

from test_vehicle_missions import upload
from vehicle_client import NAN, Client, mavlink, simspec

from vehicle_models.controller.px4._identity import EVENTS

Make = Callable[..., Client]
NUMBERS = {one.name: one.number for one in EVENTS}


def events(client: Client) -> list[str]:
    """Names of the events heard, in order."""
    names = {number: name for name, number in NUMBERS.items()}
    return [names[one.id] for one in client.received if one.get_type() == "EVENT"]


def test_a_lost_station_is_an_event_and_no_text(make: Make) -> None:
    """12 s after its last heartbeat, whatever is done about it; once, until it has been heard again."""
    client = make()
    client.airborne(3.0)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    client.received.clear()
    client.fly(11.8)
    assert events(client) == []
    client.fly(0.3)
    assert events(client) == ["commander_gcs_lost"]
    assert client.texts() == []
    client.fly(15.0)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    client.fly(13.0)
    assert events(client) == ["commander_gcs_lost"] * 2
    assert client.vehicle.condition().mode == "AUTO_LOITER"


def test_a_plan_too_far_away_is_an_event_and_no_text(make: Make) -> None:
    """Latitude 200 is taken, said as an event alone, and cannot be flown; a plan that can be is not remarked on."""
    client = make()
    client.fly(5.0)
    client.received.clear()
    assert upload(client, [(16, 3, 0, 0, 0, NAN, 2_000_000_000, 0, 10)]) == 0
    assert events(client) == ["navigator_mis_first_wp_far"]
    assert client.texts() == []
    (event,) = [one for one in client.received if one.get_type() == "EVENT"]
    assert event.log_levels == 0x33
    client.command(512, 242)
    assert upload(client, [(16, 3, 0, 0, 0, NAN, *client.vehicle_goal(0, 50), 10)]) == 0
    assert events(client) == ["navigator_mis_first_wp_far"]


def test_events_are_numbered_without_gaps_and_come_again(make: Make) -> None:
    """Texts and events that are none count alike; all of them can be asked for."""
    client = make()
    client.airborne(3.0)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    client.fly(13.0)
    first = [(one.sequence, one.id) for one in client.received if one.get_type() == "EVENT"]
    assert [sequence for sequence, _ in first] == list(range(len(first)))
    assert first[-1][1] == NUMBERS["commander_gcs_lost"]
    client.received.clear()
    client.send(mavlink.MAVLink_request_event_message(1, 1, 0, len(first) - 1))
    client.fly(0.1)
    assert [(one.sequence, one.id) for one in client.received if one.get_type() == "EVENT"] == first


def test_ardupilot_has_no_events(make: Make) -> None:
    client = make(simspec("ardupilot"))
    client.command(400, 1)
    client.fly(3.0)
    assert [one for one in client.texts() if one.startswith("Arm: ")]
    assert not [one for one in client.received if one.get_type() == "EVENT"]
