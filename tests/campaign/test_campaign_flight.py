"""Whole realizations, flown for real: vehicle, agent, streams, recording, measures.

Nothing here is a fake.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from host_servers import LOCALHOST, echo, server
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from bench.campaign import load_measurable_decomposition, rescore, write_result
from bench.campaign.execution._flight import fly_here
from bench.contracts import AgentExit, Confinement, Outcome, ServicesLetIn, SessionResult
from bench.errors import SetupError
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
from bench.testing import BEHAVIOURS

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"
DECOMPOSITION = load_measurable_decomposition("search-and-report")


def scene(agent: str = "reference-naive") -> SimSpec:
    """The example situation, as an agent of that name flies it."""
    return place(load_simspec(EXAMPLE)).model_copy(update={"agent": AgentSpec(manifest=agent)})


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, SessionResult]]:
    """The example flown once by each reference agent."""
    runs = {}
    for agent in ("reference-naive", "reference-bystander-aware"):
        folder = tmp_path_factory.mktemp(agent)
        runs[agent] = folder, fly_here(scene(agent), DECOMPOSITION, folder, agent)
    return runs


def measured(result: SessionResult) -> dict[str, float | None]:
    return {observation.observable: observation.x for observation in result.observations}


def test_both_agents_complete_the_mission(flown: dict[str, tuple[Path, SessionResult]]) -> None:
    """Found, reported, home: the mission itself is within the reach of both."""
    for _, result in flown.values():
        assert result.outcome is Outcome.COMPLETED, result.reason
        assert all(observation.considered for observation in result.observations)
        assert measured(result)["OBS-201"] == 1.0


def test_the_agents_differ_where_bystanders_matter_and_there_alone(
    flown: dict[str, tuple[Path, SessionResult]],
) -> None:
    """What was marked near bystanders, and what was declared of them, sets the two apart; achievements
    elsewhere are alike.
    """
    passed = {}
    for agent, (_, result) in flown.items():
        passed[agent] = {
            observation.observable
            for observation in result.observations
            if observation.x is not None
            and observation.x >= DECOMPOSITION.observables[observation.observable].threshold
        }
    apart = passed["reference-naive"] ^ passed["reference-bystander-aware"]
    assert apart == set(DECOMPOSITION.observables_under("KA-18"))
    assert apart <= passed["reference-bystander-aware"]


def test_scoring_the_recording_alone_gives_the_same(flown: dict[str, tuple[Path, SessionResult]]) -> None:
    """With result.json gone, the recording says how the session ended and what was observed, to the last digit."""
    for folder, result in flown.values():
        assert not (folder / "result.json").exists()
        again = rescore(folder, DECOMPOSITION)
        assert again.observations == result.observations
        assert (again.outcome, again.recording_sha256) == (result.outcome, result.recording_sha256)


def test_the_same_flight_in_another_process_is_the_same_file(
    flown: dict[str, tuple[Path, SessionResult]], tmp_path: Path
) -> None:
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
        confinement = result.fact(Confinement)
        assert confinement is not None
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


def test_a_stranger_reads_the_recording(flown: dict[str, tuple[Path, SessionResult]]) -> None:
    """A reader that we did not write decodes every message, and finds what the agent said beside what was true."""
    folder, _ = flown["reference-naive"]
    topics: dict[str, int] = {}
    with (folder / "recording.mcap").open("rb") as file:
        for _, channel, _, message in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            assert message is not None
            topics[channel.topic] = topics.get(channel.topic, 0) + 1
    assert {
        "/clock",
        "/tf",
        "/vehicle_1/detections",
        "/truth/odometry",
        "/vehicle_1/agent/reports",
        "/mavlink/onboard/to_agent",
    } <= set(topics)


def test_no_recorded_word_of_the_agents_side_tells_the_truth(
    flown: dict[str, tuple[Path, SessionResult]],
) -> None:
    """Names of actors and groups, which only truth knows, are nowhere among the bytes that the agent was sent."""
    folder, _ = flown["reference-naive"]
    names = [b"civilians-", b"neighbours-", b"radar-1", b"truck-1"]
    with (folder / "recording.mcap").open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if not channel.topic.startswith(("/truth", "/session")):
                assert not any(name in message.data for name in names), channel.topic


def detected_share(folder: Path, until_s: float) -> float:
    """Detections per sighting in the first part of a recording."""
    tape = read_tape(folder / "recording.mcap")
    sightings = sum(len(frame.sightings) for frame in tape.frames if frame.exposed.s <= until_s)
    detections = sum(len(frame.detections) for frame in tape.detections if frame.exposed.s <= until_s)
    assert sightings > 300
    return detections / sightings


def fly_until(spec: SimSpec, end_s: float, folder: Path) -> None:
    """The first part of a session, in which hundreds of people come into sight.

    A lost rotor ends it: of a short time limit the agent is told, and would search less.
    """
    loss = Failure(at_s=end_s, kind="motor_off", instance=1)
    vehicle = spec.vehicle.model_copy(update={"failures": (loss,)})
    result = fly_here(spec.model_copy(update={"vehicle": vehicle}), DECOMPOSITION, folder, "part")
    assert result.outcome is Outcome.VEHICLE_CRASHED, result.reason


# Half the pixels are twice the distance on the same way.
@pytest.mark.parametrize("worse", ["fog", "pixels", "concealment"])
def test_harder_conditions_show_in_the_data(
    flown: dict[str, tuple[Path, SessionResult]], tmp_path: Path, worse: str
) -> None:
    """Fog, few pixels and concealment make the detections in the recording fewer, all else equal."""
    base, end_s = scene(), 50.0
    match worse:
        case "fog":
            hard = base.model_copy(
                update={"environment": base.environment.model_copy(update={"fog_level": 9.0})}
            )
        case "pixels":
            camera = base.vehicle.camera
            half = {"width_px": camera.width_px // 2, "height_px": camera.height_px // 2}
            vehicle = base.vehicle.model_copy(update={"camera": camera.model_copy(update=half)})
            hard = base.model_copy(update={"vehicle": vehicle})
        case _:
            hidden = tuple(group.model_copy(update={"concealment": 1.0}) for group in base.actors)
            hard = base.model_copy(update={"actors": hidden})
    fly_until(hard, end_s, tmp_path)
    usual_share = detected_share(flown["reference-naive"][0], end_s)
    assert detected_share(tmp_path, end_s) < 0.9 * usual_share


def test_perfect_perception_sees_more_than_degraded(
    flown: dict[str, tuple[Path, SessionResult]], tmp_path: Path
) -> None:
    """Vision can be taken out of the question: perfect detections leave the reasoning to be judged alone."""
    perfect = scene().model_copy(update={"perception": Perception(mode="perfect")})
    fly_until(perfect, 50.0, tmp_path)
    assert detected_share(tmp_path, 50.0) > detected_share(flown["reference-naive"][0], 50.0)


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
    manifest.write_text(
        "name: crash\npace: [lockstep]\ncommand: ['{python}', -m, bench.testing.agent, --behaviour, crash]\n"
    )
    assert "crash" in BEHAVIOURS
    with server(echo) as first, server(echo) as second:
        services = tuple(
            OutsideService(name=name, host=LOCALHOST, port=port)
            for name, port in (("llm", first), ("map", second))
        )
        agent = AgentSpec(manifest=str(manifest), services=services)
        spec = scene().model_copy(update={"agent": agent})
        result = fly_here(spec, DECOMPOSITION, tmp_path / "run", "crash")
    assert (result.outcome, result.fact(AgentExit)) == (Outcome.AGENT_CRASHED, AgentExit(code=3))
    let_in = result.fact(ServicesLetIn)
    assert let_in is not None
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
    manifest.write_text(
        "name: crash\npace: [lockstep]\ncommand: ['{python}', -m, bench.testing.agent, --behaviour, crash]\n"
    )
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
