"""Whole realizations, flown for real: vehicle, agent, streams, recording, measures.

Nothing here is a fake.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from campaign_fakes import known
from fake_agents import agent_manifest
from host_servers import LOCALHOST, echo, server
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from bench.campaign import load_measurable_decomposition, rescore, write_result
from bench.campaign.execution._flight import fly_here
from bench.contracts import (
    AgentExit,
    CameraFrame,
    Confinement,
    DetectionFrame,
    Outcome,
    ServicesLetIn,
    SessionResult,
    SimTime,
    cast_of,
)
from bench.documents import dump_yaml
from bench.errors import SetupError
from bench.perception import open_detector
from bench.realization import place
from bench.recording import read_metadata, read_simspec, read_tape
from bench.simspec import (
    AgentSpec,
    Budgets,
    Failure,
    Isolation,
    OutsideLink,
    OutsideService,
    Perception,
    SimSpec,
    load_simspec,
)

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"
DECOMPOSITION = load_measurable_decomposition("search-and-report")

Flown = dict[str, tuple[Path, SessionResult]]


def scene(agent: str = "reference-naive") -> SimSpec:
    """The example situation, as an agent of that name flies it."""
    return place(load_simspec(EXAMPLE)).model_copy(update={"agent": AgentSpec(manifest=agent)})


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """The example flown once by each reference agent."""
    runs = {}
    for agent in ("reference-naive", "reference-bystander-aware"):
        folder = tmp_path_factory.mktemp(agent)
        runs[agent] = folder, fly_here(scene(agent), DECOMPOSITION, folder, agent)
    return runs


def test_both_agents_complete_the_mission_and_differ_where_bystanders_matter_alone(flown: Flown) -> None:
    """Found, reported, home: the mission itself is within the reach of both. What was marked near bystanders, and what
    was declared of them, sets the two apart; achievements elsewhere are alike.
    """
    passed = {}
    for agent, (_, result) in flown.items():
        assert result.outcome is Outcome.COMPLETED, result.reason
        assert all(observation.considered for observation in result.observations)
        x = {observation.observable: observation.x or 0.0 for observation in result.observations}
        assert x["OBS-201"] == 1.0
        observables = DECOMPOSITION.observables
        passed[agent] = {name for name, value in x.items() if value >= observables[name].threshold}
    apart = passed["reference-naive"] ^ passed["reference-bystander-aware"]
    assert apart == set(DECOMPOSITION.observables_under("KA-18"))
    assert apart <= passed["reference-bystander-aware"]


def test_scoring_the_recording_alone_gives_the_same(flown: Flown) -> None:
    """With result.json gone, the recording says how the session ended and what was observed, to the last digit."""
    for folder, result in flown.values():
        assert not (folder / "result.json").exists()
        again = rescore(folder, DECOMPOSITION)
        assert again.observations == result.observations
        assert (again.outcome, again.recording_sha256) == (result.outcome, result.recording_sha256)


def test_the_same_flight_in_another_process_is_the_same_file(flown: Flown, tmp_path: Path) -> None:
    """Same SimSpec and seed in lockstep: the recording is the same, bit for bit, in a process of its own."""
    code = (
        "import sys; from pathlib import Path; from bench.campaign.execution._flight import fly_here; from bench.campaign import load_measurable_decomposition; from bench.simspec import load_simspec;"
        "folder = Path(sys.argv[2]);"
        "print(fly_here(load_simspec(sys.argv[1]), load_measurable_decomposition('search-and-report'), folder, 'again').recording_sha256)"
    )
    folder, first = flown["reference-naive"]
    process = subprocess.run(
        [sys.executable, "-c", code, str(folder / "simspec.json"), str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": "7"},
    )
    assert process.stdout.strip() == first.recording_sha256


def test_how_a_session_was_launched_is_in_its_result_and_not_in_its_recording(tmp_path: Path) -> None:
    """Confinement, the folder of the manifest, ground stations that look on, and budgets: the
    recordings are the same file, and what has been flown still makes another one.
    """
    manifest = (
        "name: idle\npace: [lockstep]\nzenoh: false\ncommand: ['{python}', -m, agent_adapters.null, idle]\n"
    )
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.yaml").write_text(manifest)
    example = load_simspec(EXAMPLE)
    short = example.mission.model_copy(update={"time_limit_s": 2.0})
    placed = place(example.model_copy(update={"mission": short}))
    link = OutsideLink(name="tower", kind="udp_out", host="127.0.0.1", port=14999)

    def sha256(folder: str, isolation: Isolation | None = None, **update: object) -> str:
        agent = AgentSpec(manifest=str(tmp_path / folder / "mine.yaml"), isolation=isolation)
        spec = placed.model_copy(update={"agent": agent, **update})
        result = fly_here(spec, DECOMPOSITION, tmp_path / "run", "launched")
        assert result.outcome is Outcome.TIME_LIMIT, result.reason
        confinement = known(result.fact(Confinement))
        assert confinement.isolation != "none" or isolation == "none"
        assert read_simspec(tmp_path / "run" / "recording.mcap").agent.label == "mine"
        assert result.recording_sha256 is not None
        return result.recording_sha256

    vehicle = placed.vehicle.model_copy(update={"outside_links": (link,)})
    digests = {
        "plain": sha256("one"),
        "isolation auto": sha256("one", "auto"),
        "isolation none": sha256("one", "none"),
        "another folder": sha256("two"),
        "a ground station": sha256("one", vehicle=vehicle),
        "another budget": sha256("one", budgets=Budgets(wall_s=299.0, reply_s=9.0)),
    }
    assert set(digests.values()) == {digests["plain"]}, digests
    assert sha256("one", description="another situation") != digests["plain"]


def test_a_stranger_reads_the_recording_and_the_agents_side_tells_no_truth(flown: Flown) -> None:
    """A reader that we did not write decodes every message, and finds what the agent said beside what was true. Names of
    actors and groups, which only truth knows, are nowhere among the bytes that the agent was sent.
    """
    folder, _ = flown["reference-naive"]
    names = [b"civilians-", b"neighbours-", b"radar-1", b"truck-1"]
    topics = set()
    with (folder / "recording.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            assert decoded is not None
            topics.add(channel.topic)
            if not channel.topic.startswith(("/truth", "/session")):
                assert not any(name in message.data for name in names), channel.topic
    assert topics >= {
        *("/clock", "/tf", "/vehicle_1/detections", "/truth/odometry"),
        *("/vehicle_1/agent/reports", "/mavlink/onboard/to_agent"),
    }


END_S = 50.0


def detected_share(frames: Sequence[CameraFrame], results: Sequence[DetectionFrame]) -> float:
    """Detections per sighting in the first part of a flight."""
    sightings = sum(len(frame.sightings) for frame in frames if frame.exposed.s <= END_S)
    detections = sum(len(frame.detections) for frame in results if frame.exposed.s <= END_S)
    assert sightings > 300
    return detections / sightings


def seen_as(spec: SimSpec, frames: Sequence[CameraFrame]) -> Sequence[DetectionFrame]:
    """What the detector of a situation makes of these frames."""
    detector = open_detector(spec, cast_of(spec))
    for frame in frames:
        detector.process(frame)
    return detector.due(frames[-1].exposed.after(60.0))


def harder(fog_level: float = 0.0, concealment: float = 0.0) -> SimSpec:
    """The situation in fog, with everybody concealed."""
    spec = scene()
    environment = spec.environment.model_copy(update={"fog_level": fog_level})
    hidden = tuple(group.model_copy(update={"concealment": concealment}) for group in spec.actors)
    return spec.model_copy(update={"environment": environment, "actors": hidden})


def test_what_is_harder_or_easier_to_see_shows_in_the_data(flown: Flown, tmp_path: Path) -> None:
    """A flight in fog, with people concealed and half of the pixels, has the detections of the detector that its SimSpec
    opens. What such detectors make of what a flight saw are fewer detections for each of the three, and more without errors.
    A lost rotor ends the session after a part: of a short time limit the agent is told, and would search less.
    """
    spec = harder(fog_level=3.0, concealment=0.3)
    camera = spec.vehicle.camera
    half = camera.model_copy(update={"width_px": camera.width_px // 2, "height_px": camera.height_px // 2})
    loss = Failure(at_s=END_S, kind="motor_off", instance=1)
    vehicle = spec.vehicle.model_copy(update={"camera": half, "failures": (loss,)})
    spec = spec.model_copy(update={"vehicle": vehicle})
    result = fly_here(spec, DECOMPOSITION, tmp_path, "part")
    assert result.outcome is Outcome.VEHICLE_CRASHED, result.reason
    whole, part = (read_tape(folder / "recording.mcap") for folder in (flown["reference-naive"][0], tmp_path))

    def found(results: Sequence[DetectionFrame]) -> list[tuple[SimTime, str, str]]:
        return [
            (result.exposed, one.class_label, one.track) for result in results for one in result.detections
        ]

    kept = {*found(part.detections)}

    def apart(other: SimSpec) -> float:
        made = seen_as(other.model_copy(update={"vehicle": vehicle}), part.frames)
        return len({*found(made)} ^ kept) / len(kept)

    # A recording rounds what was seen, and its last results are still to come.
    assert apart(spec) < 0.05 < min(apart(harder(fog_level=3.0)), apart(harder(concealment=0.3)))
    plain = scene()
    usual = detected_share(whole.frames, seen_as(plain, whole.frames))
    for other, frames in (
        (harder(fog_level=9.0), whole.frames),
        (harder(concealment=1.0), whole.frames),
        (plain, part.frames),
    ):
        assert detected_share(frames, seen_as(other, frames)) < 0.9 * usual
    perfect = plain.model_copy(update={"perception": Perception(mode="perfect")})
    assert detected_share(whole.frames, seen_as(perfect, whole.frames)) > usual


def test_what_cannot_be_placed_or_found_is_a_result(tmp_path: Path) -> None:
    """Impossible placement and an unknown agent end as outcomes with a sentence, not as exceptions."""
    spec = load_simspec(EXAMPLE)
    crowd = tuple(
        g.model_copy(update={"count": 5000, "density_per_km2": None}) if g.id == "neighbours" else g
        for g in spec.actors
    )
    result = fly_here(spec.model_copy(update={"actors": crowd}), DECOMPOSITION, tmp_path / "a", "a")
    assert result.outcome is Outcome.PLACEMENT_INFEASIBLE
    assert "neighbours" in result.reason
    unknown = spec.model_copy(update={"agent": AgentSpec(manifest="nobody")})
    result = fly_here(unknown, DECOMPOSITION, tmp_path / "b", "b")
    assert result.outcome is Outcome.SETUP_INVALID
    assert "reference-naive" in result.reason


def test_an_agent_that_crashes_is_scored_on_what_was(tmp_path: Path) -> None:
    """A crash is the agent's own: the mission counts as considered and failed, and the recording is whole. Services that
    were let in stand in the result alone.
    """
    manifest = tmp_path / "crash.yaml"
    manifest.write_text(dump_yaml(agent_manifest("crash")))
    with server(echo) as first, server(echo) as second:
        services = tuple(
            OutsideService(name=name, host=LOCALHOST, port=port)
            for name, port in (("llm", first), ("map", second))
        )
        agent = AgentSpec(manifest=str(manifest), services=services)
        spec = scene().model_copy(update={"agent": agent})
        result = fly_here(spec, DECOMPOSITION, tmp_path / "run", "crash")
    assert (result.outcome, result.fact(AgentExit)) == (Outcome.AGENT_CRASHED, AgentExit(code=3))
    let_in = known(result.fact(ServicesLetIn))
    assert [(use.name, use.connections) for use in let_in.uses] == [("llm", 0), ("map", 0)]
    assert "services" not in read_metadata(tmp_path / "run" / "recording.mcap")["rebar.session"]
    by_id = {observation.observable: observation for observation in result.observations}
    assert by_id["OBS-201"].considered
    assert by_id["OBS-201"].x == 0.0
    assert rescore(tmp_path / "run", DECOMPOSITION).observations == result.observations


def test_a_recording_that_was_changed_is_not_scored_under_its_old_result(tmp_path: Path) -> None:
    """Cut off or edited, it is another recording than the result speaks of. Without that result a whole one speaks for
    itself, and a damaged one is refused.
    """
    manifest = tmp_path / "crash.yaml"
    manifest.write_text(dump_yaml(agent_manifest("crash")))
    run = tmp_path / "run"
    write_result(run, fly_here(scene(str(manifest)), DECOMPOSITION, run, "crash"))
    assert rescore(run, DECOMPOSITION).outcome is Outcome.AGENT_CRASHED
    recording = run / "recording.mcap"
    whole = recording.read_bytes()
    recording.write_bytes(whole[:-100])
    with pytest.raises(SetupError, match=r"is scored as it is if you delete result\.json"):
        rescore(run, DECOMPOSITION)
    in_campaign = tmp_path / "campaign" / "runs" / "run"
    shutil.copytree(run, in_campaign)
    (tmp_path / "campaign" / "journal.sqlite").touch()
    # Where the digest of the recording stands elsewhere too, that would lead to the next refusal.
    with pytest.raises(SetupError, match="copy, or delete it to fly the session again with `rebar run`"):
        rescore(in_campaign, DECOMPOSITION)
    (run / "result.json").unlink()
    with pytest.raises(SetupError, match=r"recording\.mcap: damaged: the index is missing"):
        rescore(run, DECOMPOSITION)
    recording.write_bytes(whole)
    assert rescore(run, DECOMPOSITION).realization == "run"
