"""A parameter whose effect is measured, and what is measured. A client comes standing and ready for takeoff."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from vehicle_client import NAN, Client, mavlink

Measured = float | str
Measure = Callable[[Client], Measured]


@dataclass(frozen=True)
class Effect:
    """A parameter, two values of it, how its effect is measured, and what comes of each value."""

    name: str
    values: tuple[float, float]
    measure: Measure
    comes: tuple[Measured, Measured]
    within: float = 0.3
    beside: tuple[tuple[str, float], ...] = ()  # parameters that have to be so as well


def speed_mps(client: Client) -> float:
    return math.hypot(*client.vehicle.truth().velocity_enu_mps[:2])


def up_mps(client: Client) -> float:
    return client.vehicle.truth().velocity_enu_mps[2]


def up_m(client: Client) -> float:
    return client.vehicle.truth().position_enu_m[2]


def sink_mps(client: Client) -> float:
    return -up_mps(client)


def turn_radps(client: Client) -> float:
    return abs(client.vehicle.truth().rates_body_radps[2])


def tilt_deg(client: Client) -> float:
    truth = client.vehicle.truth()
    return math.degrees(math.acos(math.cos(truth.roll_rad) * math.cos(truth.pitch_rad)))


def most(
    of: Callable[[Client], float], client: Client, seconds: float, each: Callable[[], None] | None = None
) -> float:
    """The greatest value within so many seconds."""
    highest = -math.inf
    for _ in range(round(seconds * 5)):
        client.fly(0.2, each)
        highest = max(highest, of(client))
    return highest


def wait(
    client: Client, until: Callable[[Client], bool], seconds: float, each: Callable[[], None] | None = None
) -> float:
    """Seconds until something is so; the whole time when it never is."""
    begun = client.vehicle.time.s
    for _ in range(round(seconds * 10)):
        client.fly(0.1, each)
        if until(client):
            break
    return client.vehicle.time.s - begun


def in_mode(name: str) -> Callable[[Client], bool]:
    return lambda client: client.vehicle.condition().mode == name


def has_sent(text: str) -> Callable[[Client], bool]:
    return lambda client: any(text in sent for sent in client.texts())


def disarmed(client: Client) -> bool:
    return not client.vehicle.condition().armed


def hover(client: Client, height_m: float = 12.0) -> None:
    copter = client.vehicle.condition().mode in ("STABILIZE", "GUIDED")
    if copter:
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert client.command(
        mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, height_m if copter else 488.0 + height_m
    ) == [0]
    wait(client, lambda flown: up_m(flown) > height_m - 0.3, 60.0)
    client.fly(1.5)


def go(client: Client, east_m: float, north_m: float, height_m: float) -> None:
    assert client.reposition(east_m, north_m, 488.0 + height_m) == [0]


def joystick(
    client: Client, ahead: int = 0, right: int = 0, up: int = 500, turn: int = 0
) -> Callable[[], None]:
    return lambda: client.send(mavlink.MAVLink_manual_control_message(1, ahead, right, up, turn, 0))


def velocity(client: Client, north: float = 0.0, down: float = 0.0) -> Callable[[], None]:
    return lambda: client.setpoint(0, 0, 0, mask=0xDC7, vn=north, vd=down)


def climbing(client: Client) -> float:
    hover(client, 10.0)
    go(client, 0, 0, 40)
    return most(up_mps, client, 5.0)


def sinking(client: Client) -> float:
    hover(client, 14.0)
    go(client, 0, 0, 2)
    return most(sink_mps, client, 4.0)


def speed_after(seconds: float) -> Measure:
    """Speed so long after a reposition to a place 60 m away."""

    def measured(client: Client) -> float:
        hover(client, 5.0)
        go(client, 0, 60, 5)
        client.fly(seconds)
        return speed_mps(client)

    return measured


def climbing_s(client: Client) -> float:
    """From the order to go 10 m higher to the last metre."""
    hover(client, 5.0)
    client.fly(1.0)
    go(client, 0, 0, 15)
    return wait(client, lambda flown: up_m(flown) > 14.0, 40.0)


def touching(client: Client) -> float:
    """Speed of coming down, at about 1 m."""
    hover(client, 3.0)
    client.command(mavlink.MAV_CMD_NAV_LAND)
    wait(client, lambda flown: up_m(flown) < 1.0, 30.0)
    return sink_mps(client)


def station_lost_s(mode: str, within_s: float = 20.0) -> Measure:
    """From the last heartbeat of the ground station to a mode."""

    def measured(client: Client) -> float:
        hover(client, 5.0)
        client.fly(1.0, client.beat)
        client.is_station = False
        return wait(client, in_mode(mode), within_s)

    return measured


def station_lost(within_s: float) -> Measure:
    """The mode so many seconds after the last heartbeat of the ground station."""

    def measured(client: Client) -> str:
        station_lost_s("", within_s)(client)
        return client.vehicle.condition().mode

    return measured


def idling_s(client: Client) -> float:
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    return wait(client, disarmed, 15.0)


def returning_height(away_m: float) -> Measure:
    def measured(client: Client) -> float:
        hover(client, 10.0)
        go(client, 0, away_m, 10)
        client.fly(2.0 + away_m / 4.0)
        client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
        return most(up_m, client, 8.0)

    return measured


def sticks(mode: tuple[float, ...], of: Callable[[Client], float], **stick: int) -> Measure:
    """Full stick in a mode, for four seconds."""

    def measured(client: Client) -> float:
        hover(client, 10.0)
        client.fly(0.5, joystick(client))
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *mode)
        client.fly(4.0, joystick(client, **stick))
        return of(client)

    return measured
