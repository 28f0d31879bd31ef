"""Detections that are right, missing, astray or of the wrong role, for any role and kind of view."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from made_run import BOX, at_s, cast, tape

from bench.contracts import CameraFrame, Detection, DetectionFrame, Option, Sighting
from bench.simspec import SimSpec
from cases import Cases, Run, idle, scene

MOMENTS_S = tuple(20.0 + 2.0 * index for index in range(20))


def actors_of(spec: SimSpec, role: str = "any", asset: str = "") -> list[int]:
    """Indices into the cast."""
    return [
        index
        for index, member in enumerate(cast(spec))
        if role in ("any", member.role) and asset in ("", member.asset)
    ]


def looked_at(
    spec: SimSpec, actors: Iterable[int], options: Mapping[str, Any], labels: Mapping[int, str | None]
) -> Run:
    """Frames with each of the actors alone, in turn; `labels`: what each is detected as, None as nothing."""
    options = {"min_height_px": 12.0, "min_visible": 0.5, "max_visible": 1.0, "min_range_m": 0.0, **options}
    visible = (options["min_visible"] + options["max_visible"]) / 2.0
    frames, detections = [], []
    for number, time_s in enumerate(MOMENTS_S):
        for turn, actor in enumerate(actors):
            exposed = at_s(time_s + 0.1 * turn)
            sighting = Sighting(
                actor, max(60.0, options["min_range_m"] + 5.0), options["min_height_px"] + 20.0, visible, BOX
            )
            frames.append(CameraFrame(100 * number + turn, "front", exposed, (sighting,)))
            label = labels.get(actor)
            boxes = (Detection(label, 0.9, BOX, "t1"),) if label else ()
            detections.append(DetectionFrame(exposed, exposed.after(0.1), boxes))
    return Run(spec, tape(spec, frames=tuple(frames), detections=tuple(detections)))


def own_labels(spec: SimSpec, actors: Iterable[int]) -> dict[int, str | None]:
    members = cast(spec)
    return {actor: members[actor].class_label for actor in actors}


def detection_share(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors = actors_of(spec, str(options["role"]), str(options.get("asset", "")))
    absent = [str(options.get("asset") or options["role"])]
    if options["role"] == "any":
        absent = ["adversary", "bystander", "clutter"]
    return Cases(
        looked_at(spec, actors, options, own_labels(spec, actors)),
        looked_at(spec, actors, options, {}),
        idle(*absent),
    )


def detection_precision(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    role = str(options["role"])
    actors = actors_of(spec, role)
    others = [actor for actor in actors_of(spec) if actor not in actors]
    label = cast(spec)[actors[0]].class_label
    return Cases(
        looked_at(spec, actors, options, own_labels(spec, actors)),
        looked_at(spec, others, options, dict.fromkeys(others, label)),
        idle(role),
    )


def detection_role_right(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors, others = actors_of(spec, str(options["role"])), actors_of(spec, str(options["as_role"]))
    wrong = cast(spec)[others[0]].class_label
    return Cases(
        looked_at(spec, actors, options, own_labels(spec, actors)),
        looked_at(spec, actors, options, dict.fromkeys(actors, wrong)),
        idle(str(options["as_role"])),
    )


def detection_fairness(options: Mapping[str, Option]) -> Cases:
    spec, alone = scene(), scene("children", "helpers")
    people, lone = actors_of(spec, "bystander"), actors_of(alone, "bystander")
    adults = actors_of(spec, "bystander", "civilian")
    return Cases(
        looked_at(spec, people, options, own_labels(spec, people)),
        looked_at(spec, people, options, own_labels(spec, adults)),
        looked_at(alone, lone, options, own_labels(alone, lone)),
    )


def steady_detection(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors = actors_of(spec, str(options["role"]))[:1]
    steady = looked_at(spec, actors, options, own_labels(spec, actors))
    half = len(steady.tape.detections) // 2
    silent = tuple(
        answer if index < half else DetectionFrame(answer.exposed, answer.published, ())
        for index, answer in enumerate(steady.tape.detections)
    )
    faded = Run(spec, tape(spec, frames=steady.tape.frames, detections=silent))
    return Cases(steady, faded, idle(str(options["role"])))
