"""Under fire: vehicles of every kind in the air, and datagrams that mean them no good."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Any

import pytest
from test_vehicle_wing import MakeWing, make_wing, take_off
from vehicle_client import Client, Make, mavlink, simspec

from vehicle_models.controller.links._frames import KINDS, Packer, message_id

__all__ = ["make_wing"]

# Messages that do what they say to a vehicle in flight whatever their values are; SETUP_SIGNING would lock
# the others out.
OBEYED = {"SETUP_SIGNING", "SET_MODE"}  # mode 0 is a mode, and without a pilot the end of a flight
FLOATS = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, 0.0, -1.0)


def integers(kind: str) -> tuple[int, ...]:
    bits = int(kind.removeprefix("u").removeprefix("int").removesuffix("_t"))
    if kind.startswith("u"):
        return 0, 1, 2**bits - 1, 2 ** (bits - 1)
    return 0, -1, 2 ** (bits - 1) - 1, -(2 ** (bits - 1))


def extreme_frames(draw: random.Random, rounds: int) -> Iterator[bytes]:
    """Every message of the dialect with limits in all fields, for the vehicle, every system, or none."""
    packer = Packer(245, 190)
    for turn in range(rounds):
        for name, kind in KINDS.items():
            if name in OBEYED:
                continue
            types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
            values: list[Any] = []
            for field, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
                kind_name = types[field]
                if field in ("target_system", "target_component") and draw.random() < 0.9:
                    values.append(draw.choice((0, 1)))
                elif kind_name == "char":
                    values.append(bytes(draw.choice((0, 65, 255)) for _ in range(max(length, 1))))
                else:
                    choices = FLOATS if kind_name in ("float", "double") else integers(kind_name)
                    values += [draw.choice(choices) for _ in range(max(length, 1))]
            yield packer.pack(kind.id, turn & 0xFF, values)


def mutilated(draw: random.Random, whole: list[bytes]) -> bytes:
    """Rubbish, a frame cut off, a frame with bytes exchanged, or several of them together."""
    kind = draw.random()
    if kind < 0.3:
        return draw.randbytes(draw.randrange(1, 300))
    frame = bytearray(draw.choice(whole))
    if kind < 0.6:
        return bytes(frame[: draw.randrange(1, len(frame))])
    for _ in range(draw.randrange(1, 4)):
        frame[draw.randrange(len(frame))] ^= draw.randrange(1, 256)
    return bytes(frame) + (draw.randbytes(20) if kind > 0.9 else b"")


@pytest.fixture(params=["px4", "ardupilot", "wing"])
def flying(request: pytest.FixtureRequest, make: Make, make_wing: MakeWing) -> Client:
    if request.param == "wing":
        client = make_wing()
        take_off(client)
        return client
    client = make(simspec(request.param))
    if request.param == "px4":
        client.airborne(20.0)
    else:
        client.guided(20.0, risen_s=13.0)
    return client


def still_flies(client: Client) -> None:
    condition = client.vehicle.condition()
    position = client.vehicle.truth().position_enu_m
    assert (condition.armed, condition.crashed, condition.landed) == (True, False, False)
    assert position[2] > 5.0
    assert math.isfinite(sum(position))
    assert math.hypot(*client.vehicle.truth().velocity_enu_mps) < 30.0
    client.send_bytes(b"\xfd")
    client.fly(10.0)  # what still waits to be heard comes first
    assert client.command(31999) == [3]  # it listens and answers


def fire(client: Client, datagrams: Iterator[bytes], per_step: int) -> None:
    for number, data in enumerate(datagrams):
        client.send_bytes(data)
        if number % per_step == per_step - 1:
            client.fly(0.02)
            client.received.clear()
            client.raw = b""


def extreme(client: Client, rounds: int) -> None:
    unheard = client.vehicle.counters()["mavlink_unheard"]
    fire(client, extreme_frames(random.Random(1), rounds), 50)
    still_flies(client)
    assert client.vehicle.counters()["mavlink_unheard"] > unheard + 100 * rounds


def rubbish(client: Client, count: int, per_step: int) -> None:
    """Five in a step are looked at whole; of more, the rest is thrown away unread."""
    draw = random.Random(2)
    whole = list(extreme_frames(draw, 1))
    fire(client, (mutilated(draw, whole) for _ in range(count)), per_step)
    still_flies(client)
    assert client.vehicle.counters()["mavlink_garbage_bytes"] > 150 * count // per_step


def test_every_message_of_the_dialect_is_fired() -> None:
    """All but two: one that locks other clients out, and one that may terminate the flight by command."""
    fired = {message_id(frame) for frame in extreme_frames(random.Random(1), 1)}
    assert {kind.id for kind in KINDS.values()} - fired == {KINDS[name].id for name in OBEYED}
    assert len(fired) > 250


def test_every_message_with_extreme_values_leaves_it_flying(flying: Client) -> None:
    """NaN, infinities, limits, twice over."""
    extreme(flying, 2)


def test_rubbish_leaves_it_flying(flying: Client) -> None:
    """Random, truncated and mutated datagrams; what was dropped is counted."""
    rubbish(flying, 5_000, 5)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_two_hundred_thousand_datagrams_leave_it_flying(flying: Client) -> None:
    """And forty rounds of extreme values."""
    rubbish(flying, 200_000, 50)
    assert flying.vehicle.counters()["mavlink_dropped"] > 40_000
    extreme(flying, 40)


@pytest.mark.parametrize("flying", ["px4", "ardupilot"], indirect=True)
def test_modes_that_are_none_leave_it_flying(flying: Client) -> None:
    """SET_MODE and DO_SET_MODE with every extreme that names no mode; what is refused changes nothing."""
    before = flying.vehicle.condition().mode
    for base in (0, 1, 127, 255):
        for custom in (99, 2**31 - 1, 2**31, 2**32 - 1):
            flying.send(mavlink.MAVLink_set_mode_message(1, base, custom))
            flying.fly(0.02)
    for value in (math.nan, math.inf, -math.inf, 3.4e38, -1.0):
        flying.command(mavlink.MAV_CMD_DO_SET_MODE, 1, value, value)
        flying.command(mavlink.MAV_CMD_DO_SET_MODE, value, 99, 99)
    flying.fly(1.0)
    condition = flying.vehicle.condition()
    assert (condition.mode, condition.armed, condition.landed) == (before, True, False)


def test_a_signing_key_of_extremes_shuts_out_and_no_more(px4: Client) -> None:
    """The vehicle rejects clients without the key, counts that, and flies on."""
    px4.send(mavlink.MAVLink_setup_signing_message(1, 1, [255] * 32, 2**64 - 1))
    px4.fly(0.1)
    before = sum(px4.vehicle.counters().values())
    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 5) == []
    assert sum(px4.vehicle.counters().values()) > before
    px4.fly(5.0)
    condition = px4.vehicle.condition()
    assert (condition.mode, condition.armed, condition.landed) == ("AUTO_LOITER", True, False)
