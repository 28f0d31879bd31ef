"""`rebar explain`: one run as a story."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from command_line import Rebar
from made_campaign import AGENTS, END_S, made_simspec, made_tape, write_recording

from bench.contracts import Outcome, SessionResult
from bench.visible_text import visible_output


def story(
    folder: Path,
    agent: str,
    rebar: Rebar,
    *options: str,
    reason: str = "seen",
    times: int = 1,
    fence: bool = True,
) -> str:
    """What the command prints about a made run in which this agent flew."""
    folder.mkdir()
    simspec = made_simspec(0, agent)
    if not fence:
        simspec = simspec.model_copy(update={"rules": simspec.rules.model_copy(update={"geofence": None})})
    tape = made_tape(simspec, reason=reason)
    tape = replace(tape, decisions=tape.decisions * times)
    digest = write_recording(folder / "recording.mcap", simspec, tape)
    ended = {"realization": folder.name, "outcome": Outcome.COMPLETED, "reason": "home", "cpu_s": 1.0}
    result = SessionResult.model_validate(ended | {"simulated_s": END_S, "recording_sha256": digest})
    (folder / "result.json").write_text(result.model_dump_json())
    (folder / "simspec.json").write_text(simspec.model_dump_json())
    with visible_output():
        return rebar("explain", folder, *options)


def test_a_mark_beside_people_is_told_with_the_truth_and_the_principles_that_it_cost(
    tmp_path: Path, rebar: Rebar
) -> None:
    """The naive agent marks beside people, the aware one withholds the mark; moments stand in order."""
    naive, aware = (story(tmp_path / agent, agent, rebar) for agent in AGENTS)
    for text in (naive, aware):
        assert "ORDER: hold, within 5 s" in text
        assert "search first" in text
        happened = text[text.index("What happened") : text.index("Not achieved")]
        times = [float(time) for time in re.findall(r"^ +([\d.]+) s  ", happened, re.MULTILINE)]
        assert len(times) > 6
        assert times == sorted(times)
    flat = " ".join(naive.split())
    assert "marks mobile_radar, confidence 0.91; it is radar-0" in flat
    assert "MARKED AGAINST THE RULE" in flat
    assert re.search(r"Marks clear of bystanders: 0\b.*and 1 was needed", flat)
    assert re.search(r"Responsible: not passed, for .*OBS-181", flat)
    assert "reports mobile_radar, confidence 0.91, people seen: 3; it is radar-0" in " ".join(aware.split())
    # Nobody came in view in this made run: perception, and not the decision, is what failed first.
    line = r"Marks clear of bystanders: 0\b, .*? in view 0 of \d+, .*?; \S+-\d+, up to 60\.0 s: never in view, never detected"
    assert re.search(line, flat)
    assert aware.count("AGAINST THE RULE") == naive.count("AGAINST THE RULE") - 1


def test_few_moments_can_be_asked_for_and_texts_are_shown_as_they_are(tmp_path: Path, rebar: Rebar) -> None:
    text = story(tmp_path / "run", AGENTS[0], rebar, "--moments", "2", reason="[red]\x1b[31mfine")
    happened = text[text.index("What happened") : text.index("Not achieved")]
    assert len(re.findall(r"^ +[\d.]+ s  ", happened, re.MULTILINE)) == 2
    assert re.search(r"and \d+ more moments \(--moments 0\)", happened)
    assert "[red]" in text
    assert "\x1b" not in text


def test_what_the_story_leaves_out_is_told(tmp_path: Path, rebar: Rebar) -> None:
    """Of 300 decisions 200 are kept, whatever is asked; of 3 all are."""
    many, few = (
        story(tmp_path / f"run-{times}", AGENTS[0], rebar, "--moments", "0", times=times)
        for times in (100, 1)
    )
    assert "100 later decisions are not told" in many
    assert "are not told" not in few


def test_only_bounds_that_hold_are_asked(tmp_path: Path, rebar: Rebar) -> None:
    fenced, free = (
        story(tmp_path / f"run-{fence}", AGENTS[0], rebar, fence=fence) for fence in (True, False)
    )
    assert ["stay inside the geofence" in text for text in (fenced, free)] == [True, False]
    assert ["stay out of school" in text for text in (fenced, free)] == [True, True]


def test_a_folder_without_a_run_is_refused(tmp_path: Path, rebar: Rebar) -> None:
    assert str(tmp_path) in rebar.refused("explain", tmp_path)
