"""`rebar agent new`: a folder with an agent that flies at once; `rebar agent check`: what holds of one."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from command_line import Rebar

from bench.agents import load_manifest
from bench.campaign import load_campaign
from bench.cli._agent import _document_points, _session_points
from bench.cli._app import run
from bench.cli._sessions import _fact_lines
from bench.contracts import Outcome, Record, SessionResult, SimTime, UnmatchedTopics, VehicleTopics
from bench.documents import load_document
from bench.recording import read_records
from bench.simspec import load_simspec
from bench.streams import String, decode, encode

PROGRAMS = {
    "python": ("search.py", "rebar_air.py"),
    "node": ("search.js", "rebar_air.js"),
    "c": ("search.c", "rebar_air.h", "Makefile"),
    "rust": ("search.rs", "rebar_air.rs", "Cargo.toml"),
    "ros2": ("search_node.py", "drone.py", "on_pyzeros.py"),
}
TOOLS = {"python": (), "node": ("node",), "c": ("make", "cc"), "rust": ("cargo",), "ros2": ()}
BUILDS = {"c": ["make", "-s"], "rust": ["cargo", "build", "-q", "--release", "--offline"]}


def scaffold(folder: Path, language: str, *options: str) -> None:
    """A new agent, built; skips the test where the language is not installed."""
    for tool in TOOLS[language]:
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    if language == "ros2":
        pytest.importorskip("pyzeros", reason="pyzeros is not installed: pip install pyzeros==0.1.0")
    assert run(["agent", "new", str(folder), "--language", language, *options]) == 0
    if language in BUILDS:
        subprocess.run(BUILDS[language], cwd=folder, check=True)


@pytest.mark.parametrize("language", PROGRAMS)
def test_the_folder_holds_agent_scene_and_campaign(language: str, tmp_path: Path, rebar: Rebar) -> None:
    folder = tmp_path / "scout-2"
    assert str(folder / "scene.yaml") in rebar("agent", "new", folder, "--language", language)
    files = {path.name for path in folder.iterdir()}
    assert files == {"scout-2.yaml", "campaign.yaml", "scene.yaml", "README.md", *PROGRAMS[language]}
    manifest, _ = load_manifest(str(folder / "scout-2.yaml"))
    ros2 = language == "ros2"
    assert (manifest.name, manifest.air) == ("scout-2", "zenoh" if ros2 else "tick")
    assert manifest.pace == (("warp", "realtime") if ros2 else ("lockstep", "realtime", "warp"))
    assert load_simspec(folder / "scene.yaml").pace.mode == manifest.pace[0]
    campaign = load_campaign(folder / "campaign.yaml")
    names = [Path(agent.manifest).name for agent in campaign.agents]
    assert names == ["scout-2.yaml", "reference-bystander-aware"]
    assert len(campaign.design.factors[0].levels or ()) == 2
    assert "manifest: scout-2.yaml" in (folder / "scene.yaml").read_text()
    assert all(name in (folder / "README.md").read_text() for name in files - {"README.md", "scene.yaml"})


@pytest.mark.parametrize("speaks", ["px4", "ardupilot"])
def test_the_scene_has_the_autopilot_that_is_asked_for(speaks: str, tmp_path: Path, rebar: Rebar) -> None:
    rebar("agent", "new", tmp_path / speaks, "--speaks", speaks)
    assert load_simspec(tmp_path / speaks / "scene.yaml").vehicle.autopilot == speaks


def test_nothing_is_overwritten_and_a_name_has_to_be_an_agents(tmp_path: Path, rebar: Rebar) -> None:
    (tmp_path / "scout").mkdir()
    for name, words in (("scout", "this path exists"), ("My Agent", "its name is no agent's")):
        assert words in rebar.refused("agent", "new", tmp_path / name)
    assert list((tmp_path / "scout").iterdir()) == []
    assert not (tmp_path / "My Agent").exists()


@pytest.mark.flight
@pytest.mark.parametrize(
    "language",
    [
        "python",
        "c",
        pytest.param("node", marks=pytest.mark.slow),
        pytest.param("rust", marks=pytest.mark.slow),
    ],
)
def test_the_new_agent_takes_off_at_once_and_twice_alike(language: str, tmp_path: Path) -> None:
    """The short form: it is in the air on the way to the first place, and a scene gives one recording."""
    folder = tmp_path / "scout"
    scaffold(folder, language)
    scene = folder / "scene.yaml"
    text = scene.read_text()
    for words, short in (("altitude_m: 60.0", "altitude_m: 10.0"), ("limit_s: 300.0", "limit_s: 20.0")):
        assert words in text
        text = text.replace(words, short)
    scene.write_text(text)
    results = []
    for name in ("first", "second"):
        assert run(["simulate", str(scene), "--out", str(tmp_path / name)]) == 0
        results.append(load_document(tmp_path / name / "result.json", SessionResult))
    assert results[0].recording_sha256 == results[1].recording_sha256
    assert results[0].outcome is Outcome.TIME_LIMIT
    records = read_records(tmp_path / "first" / "recording.mcap")
    said = (decode(String, record.data) for record in records if record.topic == TOPICS.status)
    phases = [json.loads(message.data)["phase"] for message in said if message]
    assert list(dict.fromkeys(phases)) == ["starting", "taking_off", "transit"]


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("language", "speaks"),
    # Each client once and each autopilot twice or more; all ten pairs held when they were flown. Clear air is easier than
    # fog, so that one client flies it.
    [("python", "ardupilot"), ("node", "px4"), ("c", "ardupilot"), ("rust", "px4"), ("ros2", "px4")],
)
def test_a_new_agent_holds_its_check_and_scores(language: str, speaks: str, tmp_path: Path) -> None:
    folder = tmp_path / "scout"
    scaffold(folder, language, "--speaks", speaks)
    assert run(["agent", "check", str(folder / "scout.yaml"), "--out", str(tmp_path / "check")]) == 0
    out, campaign = tmp_path / "flown", folder / "campaign.yaml"
    scenes = ["1.0", "4.0"] if language == "python" else ["4.0"]
    text = campaign.read_text()
    assert "levels: [1.0, 4.0]" in text
    campaign.write_text(text.replace("levels: [1.0, 4.0]", f"levels: [{', '.join(scenes)}]"))
    assert run(["run", str(campaign), "--agent", str(folder), "--out", str(out)]) == 0
    results = [load_document(path, SessionResult) for path in out.glob("runs/*/result.json")]
    assert len(results) == len(scenes)
    for result in results:
        considered = [item.x for item in result.observations if item.x is not None]
        assert len(considered) == 14
        assert sum(x >= 0.5 for x in considered) >= 12


CHECK_SCENE = load_simspec(Path(__file__).parents[2] / "examples" / "agent_check.yaml")
TOPICS = VehicleTopics(CHECK_SCENE.vehicle.name)


def said(topic: str, *texts: str) -> list[Record]:
    return [Record(SimTime(0), topic, String.TYPE, encode(String(text))) for text in texts]


def test_every_document_is_held_against_its_schema() -> None:
    status = '{"time_s": 1.0, "phase": "transit"}'
    records = [*said(TOPICS.status, status, '{"time_s": 1.0, "phase": "flying"}', "no JSON", status)]
    points = {point.text.partition(":")[0]: point for point in _document_points(CHECK_SCENE, records)}
    assert points[TOPICS.status].holds is False
    assert "4 documents, 2 of them not valid, the first because of phase:" in points[TOPICS.status].text
    assert points[TOPICS.reports].holds is None
    silent = {point.text.partition(":")[0]: point for point in _document_points(CHECK_SCENE, [])}
    assert silent[TOPICS.status].holds is False
    assert silent["orders without an answer"].text.endswith("wait, go-on")


def test_no_field_of_an_agent_becomes_a_line_of_ours() -> None:
    """Names of fields are the agent's words, and are printed."""
    text = json.dumps({"time_s": 1.0, "phase": "transit", "a\nok       all is well\u202e" + "x" * 99: 1})
    (point, *_) = _document_points(CHECK_SCENE, said(TOPICS.status, text))
    assert "\n" not in point.text
    assert "\u202e" not in point.text
    assert len(point.text) < 250


def test_all_orders_have_to_be_answered() -> None:
    answer = '{"time_s": 46, "order": "%s", "accepted": false}'
    answers = [answer % "wait", answer % "go-on"]
    for count, holds in ((1, False), (2, True)):
        *_, last = _document_points(CHECK_SCENE, said(TOPICS.answers, *answers[:count]))
        assert last.holds is holds


def test_lost_samples_and_an_early_end_do_not_hold() -> None:
    crashed = SessionResult(realization="check", outcome=Outcome.AGENT_CRASHED, reason="it fell\nover")
    end, lost = _session_points(crashed.model_copy(update={"counters": {"air_malformed": 2}}))
    assert (end.holds, lost.holds) == (False, False)
    assert "it fell\n    over" in end.text
    assert lost.text.startswith("2 samples could not be read")


def test_what_never_matched_is_told_by_the_check_and_by_simulate() -> None:
    """Each in a line of its own; what an agent writes into a name is shown with visible escapes."""
    sentences = ("the agent publishes /fmu/in/a, which", "the agent publishes /fmu/in/\x1b[2J, which")
    result = SessionResult(realization="check", outcome=Outcome.COMPLETED, reason="done")
    result = result.with_facts(UnmatchedTopics(sentences=sentences))
    told = [point.text for point in _session_points(result) if point.holds is False]
    shown = [sentence.replace("\x1b", "\\x1b") for sentence in sentences]
    assert told == list(_fact_lines(result)) == [f"announced, never matched: {text}" for text in shown]


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("agent", "code"), [("reference-bystander-aware", 0), ("null-land", 1)])
def test_an_agent_is_checked_by_a_flight(agent: str, code: int, tmp_path: Path, rebar: Rebar) -> None:
    lines = rebar("agent", "check", agent, "--out", tmp_path / "check", code=code).splitlines()
    assert ("NOT OK" in {line[:6] for line in lines}) == bool(code)
    assert any(line.startswith("ok       /vehicle_1/agent/status: ") for line in lines)
