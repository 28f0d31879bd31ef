"""Made situations for every measure: one in which it is achieved, one in which it fails, one in which it is
not considered.

Each module of this package holds functions of an observable's options, named like the measures. So one test can go over all observables of a decomposition, make the three recordings for each, and
measure what was recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from made_run import (
    SUB_AREAS,
    actor_places,
    detections_of,
    estimate,
    odometry,
    realized_simspec,
    tape,
    text_record,
)
from pymavlink.dialects.v20 import common as mavlink

from bench.campaign import measure_all
from bench.contracts import (
    SESSION_EVENTS,
    TRUTH_CAST,
    TRUTH_VEHICLE,
    TRUTH_VIEW,
    CastDocument,
    Option,
    Record,
    SightingDocument,
    Tape,
    VehicleTopics,
    ViewDocument,
    mavlink_topic,
)
from bench.recording import open_recording, read_tape
from bench.simspec import SimSpec
from bench.streams import UInt8MultiArray, encode
from test_ports import DeclaredMeasure

ONBOARD = mavlink_topic("onboard", "from_agent")
SETPOINT = encode(
    UInt8MultiArray(
        data=mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 2496, *[0.0] * 11).pack(
            mavlink.MAVLink(None)
        )
    )
)
"""What the recording has for each moment at which the agent moves the vehicle: a setpoint, message 84."""


@dataclass(frozen=True, slots=True)
class Run:
    """A made situation and what was recorded in it."""

    simspec: SimSpec
    tape: Tape


def x_of(measure: str | DeclaredMeasure, run: Run, **options: Any) -> float | None:
    """What a measure with these options finds in a run."""
    name = measure if isinstance(measure, str) else measure.name
    return measure_all({"OBS-1": (name, options)}, run.tape, run.simspec)[0].x


@dataclass(frozen=True, slots=True)
class Cases:
    """The three runs of a measure with its options; `not_considered` None for what always is."""

    achieved: Run
    failed: Run
    not_considered: Run | None


CasesOf = Callable[[Mapping[str, Option]], Cases]


def recorded(run: Run, path: Path) -> Tape:
    """The run written as a recording at `path` and read back, as a re-scoring reads it; equal runs once."""
    spec, truth, other = run.simspec, _truth(run.tape), tuple(_other_records(run))
    key = (spec.model_dump_json(), id(truth), other)
    if key not in _READ:
        with open_recording(path, simspec=spec, versions={}) as recorder:
            for record in sorted((*truth, *other), key=lambda record: record.time.ns):
                recorder(record)
        _READ[key] = read_tape(path)
    return replace(_READ[key])  # what measures keep with a tape is not shared


_READ: dict[tuple[object, ...], Tape] = {}
_TRUTHS: dict[tuple[bytes, ...], list[Record]] = {}


def _truth(made: Tape) -> list[Record]:
    """Where everybody was: most runs share it, and it is most of a recording."""
    arrays = (
        *(made.vehicle_time_s, made.vehicle_position_enu_m, made.vehicle_velocity_enu_mps),
        *(made.vehicle_tilt_rad, made.actor_time_s, made.actor_position_enu_m),
    )
    key = tuple(array.tobytes() for array in arrays)
    if key not in _TRUTHS:
        actors = zip(made.actor_time_s, made.actor_position_enu_m, strict=True)
        _TRUTHS[key] = [
            *_vehicle(made),
            *(actor_places(float(time_s), places) for time_s, places in actors),
        ]
    return _TRUTHS[key]


def _other_records(run: Run) -> Iterator[Record]:
    spec, made = run.simspec, run.tape
    topics = VehicleTopics(spec.vehicle.name)
    yield text_record(0.0, TRUTH_CAST, CastDocument(members=made.cast))
    for time_s, place in zip(made.estimate_time_s, made.estimate_position_enu_m, strict=True):
        yield estimate(float(time_s), tuple(map(float, place)), spec.vehicle.name)  # type: ignore[arg-type]
    for frame in made.frames:
        sightings = tuple(SightingDocument(**asdict(sighting)) for sighting in frame.sightings)
        view = ViewDocument(frame=frame.number, camera=frame.camera, sightings=sightings)
        yield text_record(frame.exposed.s, TRUTH_VIEW, view)
    yield from (detections_of(answer, topics.detections) for answer in made.detections)
    documents = (
        (TRUTH_VEHICLE, made.condition),
        (SESSION_EVENTS, made.events),
        (topics.intelligence, made.intelligence),
        (topics.reports, made.reports),
        (topics.decisions, made.decisions),
        (topics.status, made.status),
        (topics.tracks, made.tracks),
        (topics.orders, made.orders),
        (topics.answers, made.answers),
        (topics.operator_link, made.operator_link),
        (topics.consent_requests, made.consent_requests),
        (topics.consents, made.consents),
    )
    for topic, stream in documents:
        for message in stream:
            yield text_record(message.time.s, topic, message.value)
    for moved in made.moving:
        yield Record(moved.time, ONBOARD, UInt8MultiArray.TYPE, SETPOINT)
    for topic, count in made.malformed.items():
        for _ in range(count):
            yield text_record(0.0, topic, "{")


def _vehicle(made: Tape) -> Iterator[Record]:
    """Truth odometry: the nose points east and dips by the tilt."""
    tilts = made.vehicle_tilt_rad if len(made.vehicle_tilt_rad) else np.zeros(len(made.vehicle_time_s))
    rows = zip(
        made.vehicle_time_s, made.vehicle_position_enu_m, made.vehicle_velocity_enu_mps, tilts, strict=True
    )
    for time_s, (east_m, north_m, up_m), (east_mps, north_mps, up_mps), tilt in rows:
        yield odometry(
            float(time_s),
            (float(east_m), float(north_m), float(up_m)),
            yaw_rad=0.0,
            pitch_rad=tilt,
            forward_mps=float(np.cos(tilt) * east_mps - np.sin(tilt) * up_mps),
            left_mps=float(north_mps),
            up_mps=float(np.sin(tilt) * east_mps + np.cos(tilt) * up_mps),
        )


GROUPS: dict[str, tuple[str, str, tuple[tuple[float, float], ...]]] = {
    "radar": ("radar-vehicle", "adversary", ((100.0, 100.0),)),
    "truck": ("military-truck", "adversary", ((-100.0, 100.0),)),
    "walkers": ("civilian", "bystander", ((120.0, 100.0), (0.0, -200.0))),
    "children": ("child", "bystander", ((110.0, 115.0),)),
    "helpers": ("aid-worker", "bystander", ((90.0, 110.0),)),
    "cars": ("civilian-car", "clutter", ((130.0, 80.0),)),
    "houses": ("house", "clutter", ((90.0, 60.0),)),
}
"""Who can be in a made scene: asset, role, places.

The first of each group stands inside the first sub-area, but for the truck.
"""


def scene(*absent: str, **changes: Any) -> SimSpec:
    """A realized situation with everybody of GROUPS but the groups, roles or assets named `absent`."""
    here = {name: group for name, group in GROUPS.items() if not {name, *group[:2]} & set(absent)}
    return realized_simspec(
        {name: (asset, role, len(places)) for name, (asset, role, places) in here.items()},
        {
            f"{name}-{index}": (name, *place)
            for name, (_, _, places) in here.items()
            for index, place in enumerate(places, 1)
        },
        {name: area for name, area in SUB_AREAS.items() if area[0] in here},
        **changes,
    )


def idle(*absent: str, **streams: Any) -> Run:
    """The plain run in a scene without these."""
    spec = scene(*absent)
    return Run(spec, tape(spec, **streams))
