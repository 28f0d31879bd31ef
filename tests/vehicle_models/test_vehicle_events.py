"""Events of PX4: those that are a text as well, and those that are none."""

from __future__ import annotations

from test_vehicle_missions import upload
from vehicle_client import NAN, Client, Make, mavlink, of, simspec

from vehicle_models.controller.px4._identity import EVENTS

NUMBERS = {event.name: event.number for event in EVENTS}


def events(client: Client) -> list[str]:
    """Names of the received events, in order."""
    names = {number: name for name, number in NUMBERS.items()}
    return [names[message.id] for message in of("EVENT", client.received)]


def test_a_lost_station_is_an_event_and_no_text(make: Make) -> None:
    """12 s after its last heartbeat, whatever the reaction; once, until the next heartbeat."""
    client = make()
    client.airborne(3.0)
    client.is_station = False
    client.beat()
    client.received.clear()
    client.fly(11.8)
    assert events(client) == []
    client.fly(0.3)
    assert events(client) == ["commander_gcs_lost"]
    assert client.texts() == []
    client.fly(15.0)
    client.beat()
    client.fly(13.0)
    assert events(client) == ["commander_gcs_lost"] * 2
    assert client.vehicle.condition().mode == "AUTO_LOITER"
    # Events with and without a text share one numbering; a client can request all of them.
    last = client.last("EVENT").sequence
    client.received.clear()
    client.send(mavlink.MAVLink_request_event_message(1, 1, 0, last))
    client.fly(0.1)
    again = of("EVENT", client.received)
    assert [message.sequence for message in again] == [*range(last + 1)]
    assert events(client)[-2:] == ["commander_gcs_lost"] * 2
    first = again[0]
    assert (first.id >> 24, first.log_levels, len({*events(client)}) > 1) == (1, 0x66, True)
    client.send(mavlink.MAVLink_request_event_message(1, 1, last + 7, last + 9))
    (error,) = of("RESPONSE_EVENT_ERROR", client.fly(0.02))
    assert (error.sequence, error.sequence_oldest_available) == (last + 7, 0)


def test_a_plan_too_far_away_is_an_event_and_no_text(make: Make) -> None:
    """Latitude 200 is stored, reported by an event alone, and cannot be flown; a valid plan sends no event."""
    client = make()
    client.fly(5.0)
    client.received.clear()
    assert upload(client, [(mavlink.MAV_CMD_NAV_WAYPOINT, 3, 0, 0, 0, NAN, 2_000_000_000, 0, 10)]) == 0
    assert events(client) == ["navigator_mis_first_wp_far"]
    assert client.texts() == []
    (event,) = of("EVENT", client.received)
    assert event.log_levels == 0x33
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    assert upload(client, [(16, 3, 0, 0, 0, NAN, *client.vehicle_goal(0, 50), 10)]) == 0
    assert events(client) == ["navigator_mis_first_wp_far"]


def test_ardupilot_has_no_events(make: Make) -> None:
    client = make(simspec("ardupilot"))
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    client.fly(3.0)
    assert client.texts() == ["Arming motors"]
    assert not of("EVENT", client.received)
