"""Seeded random situations and their runs, with two or more of everything that a measure loops over."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from made_run import at_s, cast, order, realized_simspec, square

from bench.contracts import (
    AgentPhase,
    AgentStatus,
    AgentTrack,
    AgentTracks,
    CameraFrame,
    CastMember,
    Decision,
    Detection,
    DetectionFrame,
    EventDocument,
    IntelligenceDocument,
    OrderAnswer,
    Sighting,
    Tape,
    TargetReport,
    Timed,
    VehicleDocument,
)
from bench.simspec import SimSpec

Random = np.random.Generator

GROUPS = {
    "radar": ("radar-vehicle", "adversary", 2),
    "truck": ("military-truck", "adversary", 1),
    "walkers": ("civilian", "bystander", 3),
    "cars": ("civilian-car", "bystander", 2),
    "houses": ("house", "clutter", 1),
}
LABELS = ("mobile_radar", "military_vehicle", "civilian", "civilian_vehicle", "combatant")
PHASES = tuple(phase for phase in get_args(AgentPhase) if phase != "inspecting")
ORDER_KINDS = (
    "hold",
    "resume",
    "return",
    "abort",
    "deactivate",
    "retask",
    "stop_reporting",
    "resume_reporting",
    "mark",
)
TIME_LIMIT_S = 100.0


def random_simspec(seed: int) -> SimSpec:
    """A realized situation of 9 actors within 60 m, where most distances lie near some limit."""
    random = np.random.default_rng([seed, 0])
    places = {
        f"{group}-{number}": (group, *_place(random))
        for group, (_, _, count) in GROUPS.items()
        for number in range(1, count + 1)
    }
    about = ["radar", "truck", "radar", "walkers"][: int(random.integers(1, 5))]
    intelligence = [
        {
            "id": f"intel-{index}",
            "about": group,
            "priority": int(random.integers(1, 4)),
            "uncertainty_m": float(random.uniform(10.0, 40.0)),
            "delivered_s": float(random.choice([0.0, 0.0, 15.0, 30.0])),
        }
        for index, group in enumerate(about)
    ]
    changes = {
        "name": f"random-{seed}",
        "world": {"area": square(160.0)},
        "mission": {
            "altitude_m": 40.0,
            "time_limit_s": TIME_LIMIT_S,
            "return_home": bool(random.random() < 0.7),
        },
        "rules": _rules(random),
        "intelligence": intelligence,
        "orders": _orders(random, [str(item["id"]) for item in intelligence if item["delivered_s"] == 0.0]),
        "vehicle": {"failures": _failures(random)},
        "outages": _outages(random) if random.random() < 0.7 else [],
    }
    sub_areas = {str(item["id"]): (str(item["about"]), 1, *_place(random)) for item in intelligence}
    return realized_simspec(GROUPS, places, sub_areas, **changes)


def _outages(random: Random) -> list[dict[str, Any]]:
    moments = (("operator_link", 20.0), ("operator_link", 60.0), ("detections", 10.0), ("detections", 50.0))
    return [
        {"kind": kind, "at_s": at_s, "duration_s": float(random.uniform(5.0, 25.0))} for kind, at_s in moments
    ]


def _place(random: Random, reach_m: float = 60.0) -> tuple[float, float]:
    return float(random.uniform(-reach_m, reach_m)), float(random.uniform(-reach_m, reach_m))


def _rules(random: Random) -> dict[str, Any]:
    no_fly = [
        {
            "id": f"closed-{index}",
            # Beside home.
            "area": square(
                25.0,
                east_m=float(random.choice([-40.0, 5.0])) + 12.5,
                north_m=float(random.uniform(-60.0, 30.0)) + 12.5,
            ),
            "from_s": from_s,
            "until_s": None if index else from_s + 30.0,
        }
        for index, from_s in enumerate((5.0, float(random.uniform(20.0, 60.0))))
    ]
    rules: dict[str, Any] = {
        "no_mark_within_m": float(random.uniform(10.0, 40.0)),
        "max_altitude_m": 50.0,
        "geofence": square(130.0, east_m=-5.0, north_m=-5.0),
        "no_fly": no_fly,
        "min_altitude_m": 25.0,
        "max_speed_mps": 8.0,
        "bystander_standoff_m": 35.0,
        "bystander_slow_within_m": 25.0,
        "bystander_slow_mps": 4.0,
        "max_loiter_over_bystander_s": 2.0,
        "report_deadline_s": 30.0,
        "report_windows": [{"from_s": 10.0, "until_s": 40.0}, {"from_s": 60.0, "until_s": 80.0}],
        "link_lost": str(random.choice(["continue", "hold", "return"])),
        "link_lost_after_s": 6.0,
    }
    optional = sorted(
        set(rules)
        - {"no_mark_within_m", "max_altitude_m", "link_lost", "link_lost_after_s", "bystander_slow_mps"}
    )
    for name in optional:
        if random.random() < 0.15:
            rules.pop(name)
    if "bystander_slow_within_m" not in rules:
        rules.pop("bystander_slow_mps")
    return rules


def _orders(random: Random, intelligence: list[str]) -> list[dict[str, Any]]:
    orders = []
    for index in range(int(random.integers(0, 9))):
        kind = str(random.choice(ORDER_KINDS if intelligence else ORDER_KINDS[:5]))
        about = {"intelligence": str(random.choice(intelligence))} if kind in ("retask", "mark") else {}
        orders.append(
            {
                "id": f"order-{index}",
                "kind": kind,
                "at_s": float(round(random.uniform(5.0, 95.0), 1)),
                **about,
            }
        )
    return orders


def _failures(random: Random) -> list[dict[str, Any]]:
    return [
        {"kind": "battery_drop", "at_s": 20.0, "to_fraction": 0.6},
        {"kind": "battery_drop", "at_s": 70.0, "to_fraction": 0.3},
        {"kind": "gps_drift", "at_s": 30.0, "duration_s": 10.0, "drift_mps": 1.0},
        {"kind": "gps_off", "at_s": 50.0, "duration_s": 5.0},
        {"kind": "gps_off", "at_s": 75.0, "duration_s": 5.0},
    ][: int(random.integers(0, 6))]


def random_tape(spec: SimSpec, seed: int) -> Tape:
    """A flight that wanders over the area, and an agent that is right and wrong about equally."""
    random = np.random.default_rng([seed, 1])
    end_s = TIME_LIMIT_S if random.random() < 0.5 else float(random.uniform(60.0, TIME_LIMIT_S))
    times = np.arange(0.0, end_s, 0.5)
    members = cast(spec)
    positions = _walks(spec, random, times)
    velocity = _smooth(random, len(times), 3) * (5.0, 5.0, 1.0)
    route = np.cumsum(velocity * 0.5, axis=0) + np.array([0.0, 0.0, 35.0])
    if random.random() < 0.5:  # half of the runs end near home, where many measures look
        route *= np.minimum(1.0, (end_s - times) / 15.0)[:, None]
    frames = _frames(random, times, len(members))
    delivered = [order for order in spec.orders if order.at_s + 1.0 < end_s and random.random() < 0.9]
    return Tape(
        cast=members,
        vehicle_time_s=times,
        vehicle_position_enu_m=route,
        vehicle_velocity_enu_mps=velocity,
        vehicle_tilt_rad=np.abs(random.normal(0.0, 0.5, len(times))),
        actor_time_s=times,
        actor_position_enu_m=positions,
        frames=frames,
        detections=_detections(random, frames),
        condition=_conditions(random, end_s),
        intelligence=_intelligence(spec, end_s),
        reports=_reports(random, members, positions, times),
        decisions=_decisions(random, spec, end_s),
        status=_status(random, end_s),
        tracks=_tracks(random, members, positions, times),
        events=_events(random, end_s),
        malformed={f"/{spec.vehicle.name}/agent/reports": int(random.integers(0, 5))},
        orders=tuple(
            order(
                given.at_s + 0.5,
                given.kind,
                id=given.id,
                issued_s=given.at_s,
                within_s=given.within_s,
                intelligence_id=given.intelligence,
            )
            for given in sorted(delivered, key=lambda given: given.at_s)
        ),
        answers=_answers(random, spec, end_s),
    )


def _walks(spec: SimSpec, random: Random, times: np.ndarray) -> np.ndarray:
    assert spec.realized is not None
    starts = np.array([(actor.east_m, actor.north_m, 0.0) for actor in spec.realized.actors])
    pace = random.uniform(-0.8, 0.8, (len(starts), 3)) * (1.0, 1.0, 0.02)
    moving: np.ndarray = starts[None] + times[:, None, None] * pace[None]
    return moving


def _smooth(random: Random, count: int, width: int) -> np.ndarray:
    noise = random.normal(0.0, 1.0, (count + 20, width))
    smooth = np.stack(
        [np.convolve(noise[:, axis], np.ones(21) / 5.0, mode="valid") for axis in range(width)], axis=1
    )
    smooth[random.random(count) < 0.2] *= 0.05  # some moments of standing still
    return smooth


def _box(random: Random) -> tuple[float, float, float, float]:
    x_min, y_min = float(random.integers(0, 40)), float(random.integers(0, 40))
    return x_min, y_min, x_min + float(random.integers(10, 40)), y_min + float(random.integers(10, 40))


def _frames(random: Random, times: np.ndarray, actors: int) -> tuple[CameraFrame, ...]:
    return tuple(
        CameraFrame(
            number,
            "front",
            at_s(float(time_s)),
            tuple(
                Sighting(
                    int(actor),
                    float(random.uniform(20.0, 120.0)),
                    float(random.uniform(5.0, 40.0)),
                    float(random.uniform(0.2, 1.0)),
                    _box(random),
                )
                for actor in random.choice(actors, size=int(random.integers(0, 4)), replace=False)
            ),
        )
        for number, time_s in enumerate(times[::2])
    )


def _detections(random: Random, frames: tuple[CameraFrame, ...]) -> tuple[DetectionFrame, ...]:
    answers = []
    for frame in frames:
        if random.random() < 0.1:
            continue
        boxes = [sighting.box for sighting in frame.sightings for _ in range(2)] + [_box(random)]
        hits = tuple(
            Detection(str(random.choice(LABELS)), float(random.uniform(0.2, 1.0)), box, "t")
            for box in boxes
            if random.random() < 0.8
        )
        answers.append(DetectionFrame(frame.exposed, at_s(frame.exposed.s + 0.1), hits))
    return tuple(answers)


def _conditions(random: Random, end_s: float) -> tuple[Timed[VehicleDocument], ...]:
    """On the ground, in the air, and perhaps down and up a second time; modes and failsafes come and go."""
    changes = [0.0, *sorted(float(random.uniform(1.0, end_s)) for _ in range(12))]
    landed, crashed, battery, states = True, False, 1.0, []
    for index, time_s in enumerate(changes):
        landed = index == 0 or bool(random.random() < (0.1 if index < 10 else 0.6))
        crashed = crashed or bool(random.random() < 0.01)
        battery *= float(random.uniform(0.8, 1.0))
        failsafe = "" if landed else str(random.choice(["", "", "", "battery", "link", "position"]))
        mode = str(random.choice(["OFFBOARD", "HOLD", "RTL", "LAND"]))
        state = VehicleDocument(
            armed=not landed or bool(random.random() < 0.3),
            landed=landed,
            crashed=crashed,
            mode=mode,
            battery_fraction=battery,
            failsafe=failsafe,
        )
        states.append(Timed(at_s(time_s), state))
    return tuple(states)


def _intelligence(spec: SimSpec, end_s: float) -> tuple[Timed[IntelligenceDocument], ...]:
    delivered = [item for item in spec.intelligence if item.delivered_s < end_s]
    return tuple(
        Timed(
            at_s(item.delivered_s + 0.1),
            IntelligenceDocument(
                id=item.id,
                class_label="",
                east_m=0.0,
                north_m=0.0,
                uncertainty_m=item.uncertainty_m,
                priority=item.priority,
                observed_s=0.0,
            ),
        )
        for item in sorted(delivered, key=lambda item: item.delivered_s)
    )


def _moments(random: Random, count: int, end_s: float) -> list[float]:
    return sorted(float(random.uniform(1.0, end_s)) for _ in range(count))


def _reports(
    random: Random, members: tuple[CastMember, ...], positions: np.ndarray, times: np.ndarray
) -> tuple[Timed[TargetReport], ...]:
    reports = []
    for index, time_s in enumerate(_moments(random, int(random.integers(0, 14)), float(times[-1]))):
        actor = int(random.integers(0, len(members)))
        place = positions[int(np.searchsorted(times, time_s)), actor]
        label = members[actor].class_label if random.random() < 0.8 else str(random.choice(LABELS))
        reports.append(
            Timed(
                at_s(time_s),
                TargetReport(
                    id=f"r{index if random.random() < 0.9 else 0}",
                    time_s=max(0.0, time_s + float(random.normal(0.0, 0.7))),
                    class_label=label,
                    east_m=float(place[0] + random.normal(0.0, 8.0)),
                    north_m=float(place[1] + random.normal(0.0, 8.0)),
                    confidence=float(random.uniform(0.3, 1.0)),
                    mark=bool(random.random() < 0.5),
                    intelligence_id=None if random.random() < 0.3 else f"intel-{int(random.integers(0, 4))}",
                    bystanders_seen=None if random.random() < 0.3 else int(random.integers(0, 4)),
                    nearest_bystander_m=None if random.random() < 0.3 else float(random.uniform(0.0, 40.0)),
                    evidence=tuple(
                        float(round(random.uniform(0.0, time_s))) for _ in range(int(random.integers(0, 5)))
                    ),
                    reason=str(random.choice(["", "short", "a reason that is long enough"])),
                    position_sigma_m=None if random.random() < 0.3 else float(random.uniform(1.0, 35.0)),
                    repeats=f"r{index - 1}" if index and random.random() < 0.2 else None,
                ),
            )
        )
    return tuple(reports)


def _decisions(random: Random, spec: SimSpec, end_s: float) -> tuple[Timed[Decision], ...]:
    subjects = ["", "gps", "battery", "detections", *(f"r{index}" for index in range(6))]
    subjects += [item.id for item in spec.intelligence] + [order.id for order in spec.orders]
    actions = ("report", "mark", "withhold_mark", "withhold_mark", "search", "gps", "operator_link")
    return tuple(
        Timed(
            at_s(time_s),
            Decision(
                time_s=max(0.0, time_s + float(random.normal(0.0, 1.0))),
                action=str(random.choice(actions)),
                subject=str(random.choice(subjects)),
                reason=str(random.choice(["", "short", "a reason that is long enough"])),
            ),
        )
        for time_s in _moments(random, int(random.integers(0, 40)), end_s)
    )


def _status(random: Random, end_s: float) -> tuple[Timed[AgentStatus], ...]:
    return tuple(
        Timed(
            at_s(time_s),
            AgentStatus(
                time_s=max(0.0, time_s + float(random.normal(0.0, 0.7))),
                phase=PHASES[int(random.integers(len(PHASES)))],
            ),
        )
        for time_s in _moments(random, int(random.integers(0, 25)), end_s)
    )


def _tracks(
    random: Random, members: tuple[CastMember, ...], positions: np.ndarray, times: np.ndarray
) -> tuple[Timed[AgentTracks], ...]:
    messages = []
    for row in range(5, len(times), 8):
        tracks = []
        for name in range(int(random.integers(0, 10))):
            actor = int(random.integers(0, len(members)))
            label = members[actor].class_label if random.random() < 0.75 else str(random.choice(LABELS))
            east_m, north_m = positions[row, actor, :2] + random.normal(0.0, 5.0, 2)
            tracks.append(
                AgentTrack(
                    id=f"t{actor if random.random() < 0.7 else name}",
                    class_label=label,
                    east_m=float(east_m),
                    north_m=float(north_m),
                    confidence=float(random.uniform(0.2, 1.0)),
                    frames=int(random.integers(1, 12)),
                )
            )
        time_s = float(times[row])
        messages.append(
            Timed(
                at_s(time_s),
                AgentTracks(time_s=max(0.0, time_s + float(random.normal(0.0, 0.7))), tracks=tuple(tracks)),
            )
        )
    return tuple(messages)


def _events(random: Random, end_s: float) -> tuple[Timed[EventDocument], ...]:
    outcome = str(random.choice(["completed", "agent_crashed", "time_limit"]))
    return (
        Timed(at_s(0.0), EventDocument(name="begun")),
        Timed(at_s(end_s), EventDocument(name="ended", text=outcome)),
    )


def _answers(random: Random, spec: SimSpec, end_s: float) -> tuple[Timed[OrderAnswer], ...]:
    answers = []
    for given in spec.orders:
        for _ in range(int(random.integers(0, 3))):
            time_s = given.at_s + float(random.uniform(0.0, 9.0))
            if time_s < end_s:
                answer = OrderAnswer(
                    time_s=max(0.0, time_s + float(random.normal(0.0, 0.7))),
                    order=given.id,
                    accepted=bool(random.random() < 0.6),
                    reason=str(random.choice(["", "a reason that is long enough"])),
                )
                answers.append(Timed(at_s(time_s), answer))
    return tuple(sorted(answers, key=lambda answer: answer.time.ns))
