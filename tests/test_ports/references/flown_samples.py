"""Random runs, and their truth one sample at a time."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

from random_run import random_simspec, random_tape

from bench.contracts import Tape
from bench.simspec import SimSpec

SEEDS = range(40)

Place = tuple[float, float, float]
Reference = Callable[[SimSpec, Tape, tuple["Sample", ...]], float | None]


@cache
def random_run(seed: int) -> tuple[SimSpec, Tape]:
    spec = random_simspec(seed)
    return spec, random_tape(spec, seed)


def seed_of(spec: SimSpec) -> int:
    return int(spec.name.removeprefix("random-"))


class Sample:
    """One truth sample of a vehicle in the air, with the time that it stands for."""

    def __init__(self, tape: Tape, row: int) -> None:
        times = tape.vehicle_time_s
        self.time_s = float(times[row])
        self.span_s = float(times[row + 1] - times[row]) if row + 1 < len(times) else 0.0
        self.place: Place = tuple(map(float, tape.vehicle_position_enu_m[row]))  # type: ignore[assignment]
        self.speed_mps = math.hypot(*map(float, tape.vehicle_velocity_enu_mps[row][:2]))
        # The random runs sample actors and vehicle at the same moments, so no place has to be interpolated.
        self.actors: list[Place] = [tuple(map(float, place)) for place in tape.actor_position_enu_m[row]]  # type: ignore[misc]


@cache
def airborne(seed: int) -> tuple[Sample, ...]:
    _, tape = random_run(seed)
    samples = []
    for row, time_s in enumerate(tape.vehicle_time_s):
        states = [state.value for state in tape.condition if state.time.s <= time_s]
        if states and not states[-1].landed and not any(state.crashed for state in states):
            samples.append(Sample(tape, row))
    return tuple(samples)


def free(tape: Tape, samples: tuple[Sample, ...]) -> list[Sample]:
    """The samples before the operator orders the vehicle to land where it is."""
    ordered_s = [order.time.s for order in tape.orders if order.value.kind == "deactivate"]
    return [sample for sample in samples if all(sample.time_s < time_s for time_s in ordered_s)]


def role_of(tape: Tape, role: str) -> list[int]:
    return [index for index, member in enumerate(tape.cast) if member.role == role]


def actors_at(tape: Tape, time_s: float) -> list[tuple[float, float]]:
    """Places by linear interpolation between the two samples around a moment."""
    times = tape.actor_time_s
    after = next((row for row, time in enumerate(times) if time >= time_s), len(times) - 1)
    before = max(0, after - 1)
    length_s = float(times[after] - times[before])
    share = min(1.0, max(0.0, (time_s - float(times[before])) / length_s)) if length_s else 0.0
    starts, ends = tape.actor_position_enu_m[before], tape.actor_position_enu_m[after]
    return [
        (float(a[0] + share * (b[0] - a[0])), float(a[1] + share * (b[1] - a[1])))
        for a, b in zip(starts, ends, strict=True)
    ]


def time_share(samples: list[tuple[float, bool]]) -> float:
    total_s = math.fsum(span_s for span_s, _ in samples)
    return math.fsum(span_s for span_s, holds in samples if holds) / total_s if total_s else 0.0


def out_s(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...], among_m: float = math.inf) -> float:
    """Seconds in the air more than 40 m from home, with a bystander within `among_m` where that is finite."""
    home = (spec.vehicle.home.east_m, spec.vehicle.home.north_m)
    return math.fsum(
        sample.span_s
        for sample in samples
        if math.dist(sample.place[:2], home) > 40.0
        and (
            math.isinf(among_m)
            or any(
                math.dist(sample.place[:2], sample.actors[person][:2]) <= among_m
                for person in role_of(tape, "bystander")
            )
        )
    )
