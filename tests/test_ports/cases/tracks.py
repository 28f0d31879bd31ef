"""Pictures that are right, missing, astray, torn or of the wrong role."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from made_run import at_s, cast, tape

from bench.contracts import AgentTrack, AgentTracks, Option, Timed
from bench.simspec import SimSpec
from cases import Cases, Run, idle, scene
from cases.perception import actors_of, looked_at

MOMENTS_S = tuple(float(second) for second in range(4, 198))
Held = tuple[str, str, float, float]
"""Track id, class label, east and north in metres."""


def pictured(
    spec: SimSpec, *messages: Sequence[Held], confidence: float = 1.0, moments_s: Sequence[float] = MOMENTS_S
) -> Run:
    """A run in which the agent tells these pictures in turn, one at each moment."""
    track_messages = []
    for index, time_s in enumerate(moments_s):
        tracks = tuple(
            AgentTrack(
                id=name, class_label=label, east_m=east_m, north_m=north_m, confidence=confidence, frames=20
            )
            for name, label, east_m, north_m in messages[index % len(messages)]
        )
        track_messages.append(Timed(at_s(time_s), AgentTracks(time_s=time_s, tracks=tracks)))
    return Run(spec, tape(spec, tracks=tuple(track_messages)))


def held(
    spec: SimSpec, actors: Sequence[int], *, label: str = "", off_m: float = 0.0, prefix: str = "t"
) -> list[Held]:
    """A track on each of the actors, `off_m` east of it, with its own class or the one given."""
    assert spec.realized is not None
    places, members = spec.realized.actors, cast(spec)
    return [
        (
            f"{prefix}{actor}",
            label or members[actor].class_label,
            places[actor].east_m + off_m,
            places[actor].north_m,
        )
        for actor in actors
    ]


def _nobody(options: Mapping[str, Option]) -> Run:
    return idle(str(options.get("asset") or options["role"]))


def classified_share(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors = actors_of(spec, str(options["role"]), str(options.get("asset", "")))
    return Cases(
        pictured(spec, held(spec, actors)), pictured(spec, held(spec, actors, off_m=100.0)), _nobody(options)
    )


def no_false_tracks(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    return Cases(
        pictured(spec, held(spec, actors_of(spec))),
        pictured(spec, held(spec, actors_of(spec), off_m=-400.0)),
        None,
    )


def track_accuracy(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors = actors_of(spec, str(options["role"]))
    just_inside = float(options.get("scale_m", 15.0)) - 0.5
    apart = [actor for actor in actors if cast(spec)[actor].id not in ("walkers-2",)]
    return Cases(
        pictured(spec, held(spec, actors)),
        pictured(spec, held(spec, apart, off_m=just_inside)),
        _nobody(options),
    )


def track_continuity(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors = actors_of(spec, str(options["role"]))
    torn = pictured(spec, held(spec, actors), held(spec, actors, prefix="u"))
    return Cases(pictured(spec, held(spec, actors)), torn, _nobody(options))


def track_uniqueness(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors = actors_of(spec, str(options["role"]))
    doubled = held(spec, actors) + held(spec, actors, prefix="u", off_m=1.0)
    return Cases(pictured(spec, held(spec, actors)), pictured(spec, doubled), _nobody(options))


def track_role_right(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors, others = actors_of(spec, str(options["role"])), actors_of(spec, str(options["as_role"]))
    wrong = held(spec, actors, label=cast(spec)[others[0]].class_label)
    return Cases(pictured(spec, held(spec, actors)), pictured(spec, wrong), idle(str(options["as_role"])))


def _in_view(run: Run, actors: Sequence[int], options: Mapping[str, Option]) -> Run:
    """The run with frames that have each of the actors in view, as the options ask."""
    frames = looked_at(run.simspec, actors, options, {}).tape.frames
    return Run(run.simspec, replace(run.tape, frames=frames))


def track_share(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors = actors_of(spec, str(options["role"]), str(options.get("asset", "")))
    return Cases(
        _in_view(pictured(spec, held(spec, actors)), actors, options),
        _in_view(pictured(spec, held(spec, actors, off_m=100.0)), actors, options),
        _nobody(options),
    )


def steady_tracks(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    actors = actors_of(spec, str(options["role"]))[:1]
    steady = _in_view(pictured(spec, held(spec, actors)), actors, options)
    half = tuple(message for message in steady.tape.tracks if message.time.s < 38.0)
    return Cases(steady, Run(spec, replace(steady.tape, tracks=half)), _nobody(options))


def track_fairness(options: Mapping[str, Option]) -> Cases:
    spec, alone = scene(), scene("children", "helpers")
    people, adults = actors_of(spec, "bystander"), actors_of(spec, "bystander", "civilian")
    lone = actors_of(alone, "bystander")
    return Cases(
        pictured(spec, held(spec, people)),
        pictured(spec, held(spec, adults)),
        pictured(alone, held(alone, lone)),
    )


def track_freshness(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    message = held(spec, actors_of(spec))
    return Cases(pictured(spec, message), pictured(spec, message, moments_s=(20.0,)), None)


track_confidence_honest = no_false_tracks
