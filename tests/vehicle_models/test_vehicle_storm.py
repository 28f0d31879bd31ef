"""Under fire: a hovering vehicle and datagrams that mean it no good."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Any

import pytest
from vehicle_client import Client, Make, simspec

from vehicle_models.controller.links._frames import KINDS, Packer

# Messages that do what they say to a vehicle in flight whatever their values are; SETUP_SIGNING would lock
# the others out.
OBEYED = {"SETUP_SIGNING", "SET_MODE"}  # mode 0 is a mode, and without a pilot the end of a flight
FLOATS = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, 0.0, -1.0)


def integers(kind: str) -> tuple[int, ...]:
    bits = int(kind.removeprefix("u").removeprefix("int").removesuffix("_t"))
    return (
        (0, 1, 2**bits - 1, 2 ** (bits - 1))
        if kind.startswith("u")
        else (0, -1, 2 ** (bits - 1) - 1, -(2 ** (bits - 1)))
    )


def extreme_frames(draw: random.Random, rounds: int) -> Iterator[bytes]:
    """Every message of the dialect with limits in all fields, addressed to the vehicle, to every system, or
    to none.
    """
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


def hover(make: Make, autopilot: str) -> Client:
    client = make(simspec(autopilot))
    if autopilot == "px4":
        client.airborne(20.0)
        return client
    client.guided(20.0, risen_s=20.0)
    return client


def still_flies(client: Client) -> None:
    condition = client.vehicle.condition()
    east, north, up = client.vehicle.truth().position_enu_m
    assert condition.armed
    assert not condition.crashed
    assert not condition.landed
    assert up > 5.0
    assert math.isfinite(east + north + up)
    client.send_bytes(b"\xfd")
    client.fly(1.0)
    assert client.command(31999) == [3]  # it listens and answers


def fire(client: Client, datagrams: Iterator[bytes], per_step: int) -> int:
    sent = 0
    for number, data in enumerate(datagrams):
        client.send_bytes(data)
        sent += 1
        if number % per_step == per_step - 1:
            client.fly(0.02)
            client.received.clear()
            client.raw = b""
    return sent


def extreme(client: Client, rounds: int) -> None:
    sent = fire(client, extreme_frames(random.Random(1), rounds), 50)
    assert sent > 250 * rounds
    still_flies(client)


def rubbish(client: Client, count: int, per_step: int) -> None:
    """Five in a step are looked at whole; of more, the rest is thrown away unread."""
    draw = random.Random(2)
    whole = list(extreme_frames(draw, 1))
    fire(client, (mutilated(draw, whole) for _ in range(count)), per_step)
    still_flies(client)
    counters = client.vehicle.counters()
    assert counters["mavlink_garbage_bytes"] > 150 * count // per_step


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_every_message_with_extreme_values_leaves_it_flying(make: Make, autopilot: str) -> None:
    """All of the dialect, NaN, infinities, limits, twice over, into a hover."""
    extreme(hover(make, autopilot), 2)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_rubbish_leaves_it_flying(make: Make, autopilot: str) -> None:
    """Ten thousand random, truncated and mutated datagrams into a hover; what was dropped is counted."""
    rubbish(hover(make, autopilot), 10_000, 5)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_million_datagrams_leave_it_flying(make: Make, autopilot: str) -> None:
    """Half a million for each of the two, and a hundred rounds of extreme values."""
    client = hover(make, autopilot)
    rubbish(client, 500_000, 50)
    assert client.vehicle.counters()["mavlink_dropped"] > 100_000
    extreme(client, 100)
