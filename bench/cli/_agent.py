"""`rebar agent new`: a folder with an agent that flies at once, and a campaign for it; `rebar agent check`: what holds of one."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.errors import SetupError, command_line
from bench.simspec import DEFAULT_VEHICLE

from ._examples import shipped
from ._run_request import IsolationOption, Pace, manifest_of
from ._tables import plain_console

if TYPE_CHECKING:
    from bench.contracts import Record, SessionResult
    from bench.simspec import SimSpec


class Language(StrEnum):
    """What a new agent is written in. Each but `ros2` needs nothing but the language itself."""

    PYTHON = "python"
    NODE = "node"
    C = "c"
    RUST = "rust"
    ROS2 = "ros2"


@dataclass(frozen=True, slots=True)
class _Kit:
    """The files of a folder of examples for a language; `build` is given in the new folder before the first flight."""

    manifest: str
    program: str
    helpers: Mapping[str, str]
    """What each further file does."""
    build: tuple[str, ...] = ()
    folder: str = "tick"
    pace: str = "lockstep"


_CLIENT = "is its client: the bench's ticks and messages, MAVLink, pixels to ground."
_BUILD = "says how it is built: build it after each change."
_KITS = {
    Language.PYTHON: _Kit("search.yaml", "search.py", {"rebar_air.py": _CLIENT}),
    Language.NODE: _Kit("search-node.yaml", "search.js", {"rebar_air.js": _CLIENT}),
    Language.C: _Kit(
        "search-c.yaml",
        "search.c",
        {"rebar_air.h": _CLIENT, "Makefile": _BUILD},
        ("make", "-C", "{folder}"),
    ),
    Language.RUST: _Kit(
        "search-rust.yaml",
        "search.rs",
        {"rebar_air.rs": _CLIENT, "Cargo.toml": _BUILD},
        ("cargo", "build", "--release", "--manifest-path", "{folder}/Cargo.toml"),
    ),
    Language.ROS2: _Kit(
        "search-ros2.yaml",
        "search_node.py",
        {
            "drone.py": "is what it flies and sees with: pymavlink, pixels to ground.",
            "on_pyzeros.py": "runs it without ROS; examples/ros2/README.md (`rebar examples`) says how to use rclpy.",
        },
        # The version that the tests fly.
        ("pip", "install", "pyzeros==0.1.0"),
        "ros2",
        "warp",
    ),
}
_README = """\
# {name}

{build}- `rebar agent check .` flies a minute of every kind of input and says what holds of the agent.
- `rebar simulate scene.yaml --out out/scene` flies one session and says what was not achieved.
- `rebar run campaign.yaml --out out/campaign` flies the campaign and writes out/campaign/report.html.
- `{program}` is the agent: it searches, reports, publishes tracks and lands. Change it.
{helpers}- `{name}.yaml` is what the bench reads: command, pace, limits (`rebar schema agent`).
- The messages: `rebar schema --keys scene.yaml`, and `rebar schema target-report` for one of them.
"""

agent = typer.Typer(
    name="agent", help="Begin an agent, and check one.", no_args_is_help=True, pretty_exceptions_enable=False
)


@agent.callback()
def options() -> None:
    """Begin an agent, and check one."""


@agent.command()
def new(
    folder: Annotated[
        Path, typer.Argument(help="The folder to make; its name becomes the agent's", show_default=False)
    ],
    language: Annotated[Language, typer.Option(help="What the agent is written in")] = Language.PYTHON,
    speaks: Annotated[
        Literal["px4", "ardupilot"], typer.Option(help="The autopilot in the scene; the agent speaks both")
    ] = "px4",
) -> None:
    """Make a folder with an agent that flies at once, a scene, and a campaign of two scenes.

    Example: rebar agent new scout --language c
    """
    name = folder.resolve().name
    if not re.fullmatch(r"[a-z0-9][a-z0-9-]{0,63}", name):
        raise SetupError(
            folder, "its name is no agent's", "use lower-case letters, digits and hyphens: scout-2"
        )
    if os.path.lexists(folder):
        raise SetupError(folder, "this path exists", "give a folder that is to be made")
    kit = _KITS[language]
    source = f"examples/{kit.folder}"
    files = (kit.program, *kit.helpers)
    texts = {file: shipped(f"{source}/{file}").read_text(encoding="utf-8") for file in files}
    text = shipped(f"{source}/{kit.manifest}").read_text(encoding="utf-8")
    text = re.sub(r"^name: .*$", f"name: {name}", text, flags=re.MULTILINE)
    # Results name an agent by its manifest's file.
    texts[f"{name}.yaml"] = re.sub(r"^description: .*\n", "", text, flags=re.MULTILINE)
    scene = shipped("examples/search.yaml").read_text(encoding="utf-8")
    texts["scene.yaml"] = re.sub(
        r"^agent: .*$", f"agent: {{manifest: {name}.yaml}}", scene, flags=re.MULTILINE
    ).replace("rebar simulate examples/search.yaml", "rebar simulate scene.yaml")
    if kit.pace != "lockstep":
        texts["scene.yaml"] += f"pace: {{mode: {kit.pace}}}\n"
    if speaks != "px4":
        model = f"model: {DEFAULT_VEHICLE}"
        texts["scene.yaml"] = texts["scene.yaml"].replace(model, f"{model}\n  autopilot: {speaks}")
    campaign = shipped("examples/tick/campaign.yaml").read_text(encoding="utf-8")
    for shipped_words, words in (
        ("name: tick-search", f"name: {name}"),
        ("manifest: search.yaml", f"manifest: {name}.yaml"),
        ("base_file: ../search.yaml", "base_file: scene.yaml"),
    ):
        campaign = campaign.replace(shipped_words, words)
    texts["campaign.yaml"] = campaign
    build = " ".join(kit.build).replace("{folder}", ".")
    texts["README.md"] = _README.format(
        name=name,
        program=kit.program,
        helpers="".join(f"- `{file}` {words}\n" for file, words in kit.helpers.items()),
        build=f"- `{build}` comes first.\n" if build else "",
    )
    folder.mkdir(parents=True)
    for file, content in texts.items():
        (folder / file).write_text(content, encoding="utf-8")
    print(f"{len(texts)} files in {folder}. Try:")
    if kit.build:
        print(f"  {command_line(*(word.replace('{folder}', str(folder)) for word in kit.build))}")
    print(f"  {command_line('rebar', 'simulate', folder / 'scene.yaml')}")


@agent.command()
def check(
    manifest: Annotated[str, typer.Argument(help="The agent's folder, manifest or name", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder for recording.mcap and agent.log")] = Path("out/check"),
    pace: Annotated[Pace | None, typer.Option(help="Default: the first that the agent can follow")] = None,
    isolation: IsolationOption = None,
) -> None:
    """Fly a scene of a minute with a target, people, two orders, consent and a lost link; say what holds of the agent.

    Ends with code 1 where something does not. Example: rebar agent check scout
    """
    from bench.agents import load_manifest
    from bench.campaign import check_file_system, fly_realization, load_measurable_decomposition, write_result
    from bench.recording import read_records
    from bench.simspec import load_simspec

    # A name stays one; a path is of this folder, not of the scene's.
    path = manifest_of(manifest)
    loaded, _ = load_manifest(path)
    scene = load_simspec(shipped("examples/agent_check.yaml"))
    spec = {"manifest": path, "isolation": isolation or scene.agent.isolation}
    agent_spec, mode = scene.agent.model_copy(update=spec), pace or loaded.pace[0]
    scene = scene.model_copy(
        update={"agent": agent_spec, "pace": scene.pace.model_copy(update={"mode": mode})}
    )
    out.mkdir(parents=True, exist_ok=True)
    check_file_system(out, with_locks=False)
    result = fly_realization(scene, load_measurable_decomposition("search-and-report"), out, out.name)
    write_result(out, result)
    recording = out / "recording.mcap"
    records = list(read_records(recording)) if recording.is_file() else []
    points = [*_session_points(result), *_document_points(scene, records)]
    console = plain_console()
    for point in points:
        word = {True: "ok", False: "NOT OK", None: "nothing"}[point.holds]
        console.print(f"{word:8} {point.text}", soft_wrap=True)
    console.print(f"what the agent printed: {out / 'agent.log'}", soft_wrap=True)
    if any(point.holds is False for point in points):
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True)
class _Point:
    """One thing that is checked of an agent, and a sentence about it."""

    holds: bool | None
    """None for what an agent may leave out, and is measured by."""
    text: str


# Of the session's counters, those that tell of something lost, each with what to do.
_LOSSES = {
    "air_malformed": "samples could not be read: check the encoding and the attachment (docs/streams.md)",
    "air_lost": "samples have gaps in their sequence numbers",
    "air_dropped": "samples were beyond what is recorded of a topic (docs/streams.md)",
    "air_overflowed": "samples came faster than they can be held",
    "air_unstated": "samples were never stated by an ack",
}


def _session_points(result: SessionResult) -> Iterator[_Point]:
    from bench.contracts import UnmatchedTopics, UnreadTopics

    ended = result.outcome.value == "completed"
    # Indented: no line of what an agent printed is to be taken for one of ours.
    reason = result.reason.replace("\n", "\n    ")
    yield _Point(ended, f"the session ended as {result.outcome} after {result.simulated_s:.0f} s: {reason}")
    if unmatched := result.fact(UnmatchedTopics):
        for sentence in unmatched.sentences:
            yield _Point(False, f"announced, never matched: {sentence}")
    if unread := result.fact(UnreadTopics):
        # Whoever does not read its orders cannot obey; without the mission it flies by what it was built for.
        has_mission = not any(topic.endswith("/mission") for topic in unread.topics)
        text = "(a wrong type or hash is no subscription: rebar schema --keys)"
        yield _Point(
            None if has_mission else False, f"never subscribed to: {', '.join(unread.topics)} {text}"
        )
    for name, text in _LOSSES.items():
        if count := result.counters.get(name, 0):
            yield _Point(False, f"{count} {text}")


def _document_points(scene: SimSpec, records: Sequence[Record]) -> Iterator[_Point]:
    """What came on each topic from the agent, how much of it is a document, and whether the operator was answered."""
    from bench import contracts

    topics = contracts.VehicleTopics(scene.vehicle.name)
    kinds: Mapping[str, type[object]] = {
        topics.status: contracts.AgentStatus,
        topics.tracks: contracts.AgentTracks,
        topics.reports: contracts.TargetReport,
        topics.decisions: contracts.Decision,
        topics.answers: contracts.OrderAnswer,
        topics.consent_requests: contracts.ConsentRequest,
    }
    for topic, kind in kinds.items():
        texts = _texts(records, topic)
        faults = [fault for text in texts if (fault := contracts.document_fault(kind, text))]
        count = f"{topic}: {len(texts)} documents"
        if faults:
            yield _Point(False, f"{count}, {len(faults)} of them not valid, the first because of {faults[0]}")
        else:
            # Without a status nobody knows what it does; the rest an agent may leave out, and fails the measures about it.
            yield _Point(True if texts else False if topic == topics.status else None, count)
    answered = {
        answer.order
        for text in _texts(records, topics.answers)
        if (answer := contracts.parse_document(contracts.OrderAnswer, text))
    }
    missing = [order.id for order in scene.orders if order.id not in answered]
    text = f"orders without an answer: {', '.join(missing)}" if missing else "every order is answered"
    yield _Point(not missing, text)


def _texts(records: Sequence[Record], topic: str) -> list[str]:
    from bench.streams import String, decode

    decoded = (decode(record.type_name, record.data) for record in records if record.topic == topic)
    return [message.data for message in decoded if isinstance(message, String)]
