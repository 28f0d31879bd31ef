"""`rebar compare` on one campaign flown with two sources of perception, under several autopilots, or at two paces."""

from __future__ import annotations

import json
from dataclasses import astuple
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import yaml
from command_line import Rebar
from made_campaign import AGENTS, OBSERVABLES, STUDY, Made, make_campaign

from bench.reporting import Comparison, compare_campaigns, write_report
from bench.simspec import SimSpec

PERCEPTION_OBSERVABLE, MARKING_OBSERVABLE = OBSERVABLES["KA-05"][0], OBSERVABLES["KA-18"][1]
SCENES = 12


def changed(folder: Path, pattern: str, **parts: dict[str, object]) -> None:
    """Other fields of these parts of the campaign's SimSpecs."""
    for path in (folder / "simspecs").glob(pattern):
        document = json.loads(path.read_text())
        for part, fields in parts.items():
            document[part] |= fields
        path.write_text(SimSpec.model_validate(document).model_dump_json())


def flown_with(
    folder: Path, source: str, failed: dict[str, set[int]], detector: str | None = None, **vehicle: object
) -> Path:
    """The made campaign with a source of perception; observables fail in these scenes and pass in all others."""
    make_campaign(folder, Made(scenes=SCENES, agents=AGENTS[1:]))
    changed(folder, "*.json", perception={"source": source, "detector": detector}, vehicle=vehicle)
    scene = pl.col("design_point").str.slice(1).cast(pl.Int64)
    scores = pl.read_parquet(folder / "scores.parquet")
    for name, scenes in failed.items():
        is_here = pl.col("node") == name
        passed = (~scene.is_in(sorted(scenes))).cast(pl.Float64)
        considered = pl.when(is_here).then(1).otherwise(pl.col("considered"))
        scores = scores.with_columns(
            confidence=pl.when(is_here).then(passed).otherwise(pl.col("confidence")),
            considered=considered.cast(scores["considered"].dtype),
        )
    scores.write_parquet(folder / "scores.parquet")
    return folder


def carried_by(folder: Path, autopilot: Any, failed: dict[str, set[int]], mode: str = "lockstep") -> Path:
    """The made campaign under an autopilot, in a session of which the host may take longer."""
    flown_with(folder, "simulated", failed, autopilot=autopilot)
    budgets: dict[str, object] = {"wall_s": 300.0 if autopilot == "px4" else 900.0}
    changed(folder, "*.json", pace={"mode": mode}, budgets=budgets)
    return folder


def counts_of(comparison: Comparison) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Scenes that both passed, the first or the second alone, or neither: of perception and of marking."""
    counts = {node.node: astuple(node.counts) for node in comparison.nodes}
    return counts[PERCEPTION_OBSERVABLE], counts[MARKING_OBSERVABLE]


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One observable fails by perception (with simulated alone), another by reasoning (with both)."""
    home, marking = tmp_path_factory.mktemp("sources"), {MARKING_OBSERVABLE: {6, 7, 8}}
    return (
        flown_with(home / "simulated", "simulated", {PERCEPTION_OBSERVABLE: {0, 1, 2, 3, 4}} | marking),
        flown_with(home / "truth", "truth", {PERCEPTION_OBSERVABLE: {4}} | marking),
    )


def test_failing_perception_is_told_from_failing_reasoning(sources: tuple[Path, Path], rebar: Rebar) -> None:
    """Scene by scene: what fails with one source alone, and what with both; people and machines get the counts."""
    comparison = compare_campaigns(sources)
    assert comparison.perceptions == ("simulated, degraded", "truth")
    assert comparison.scenes == SCENES
    names = {node.node for node in comparison.nodes}
    assert names == {*STUDY, *(name for ka in STUDY for name in OBSERVABLES[ka])}
    assert counts_of(comparison) == ((7, 0, 4, 1), (9, 0, 0, 3))
    lines = rebar("compare", *sources).splitlines()
    assert "scenes passed by perception (first: simulated, degraded; second: truth):" in lines
    assert [PERCEPTION_OBSERVABLE, "7", "0", "4", "1"] in [line.split() for line in lines]
    document = rebar.json("compare", *sources, "--node", PERCEPTION_OBSERVABLE)
    assert document["perceptions"] == ["simulated, degraded", "truth"]
    assert [node["node"] for node in document["nodes"]] == [PERCEPTION_OBSERVABLE]


def test_equal_scenes_are_compared_as_before(sources: tuple[Path, Path], tmp_path: Path) -> None:
    """Two campaigns with one perception pair in full: the nodes under study alone, and no perceptions."""
    repeated = flown_with(tmp_path / "again", "truth", {PERCEPTION_OBSERVABLE: {1}})
    comparison = compare_campaigns((sources[1], repeated))
    assert comparison.perceptions is None
    assert [node.node for node in comparison.nodes] == list(STUDY)


def test_every_source_and_every_detector_can_be_compared(sources: tuple[Path, Path], tmp_path: Path) -> None:
    small = flown_with(tmp_path / "small", "detector", {PERCEPTION_OBSERVABLE: set(range(10))})
    other = flown_with(tmp_path / "other", "detector", {PERCEPTION_OBSERVABLE: {0, 1}}, "other")
    by_agent = flown_with(tmp_path / "own", "agent", {MARKING_OBSERVABLE: {1}})
    pairs = ((small, sources[1]), (small, other), (by_agent, other))
    assert [compare_campaigns(pair).perceptions for pair in pairs] == [
        ("detector small", "truth"),
        ("detector small", "detector other"),
        ("agent", "detector other"),
    ]
    assert counts_of(compare_campaigns((small, other)))[0] == (2, 0, 8, 2)


@pytest.fixture(scope="module")
def autopilots(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """The imitated autopilot, the firmware, and a board."""
    home = tmp_path_factory.mktemp("autopilots")
    firmware = {"kind": "px4", "firmware": "/opt/px4"}
    board = {"kind": "px4-board", "options": {"device": "/dev/ttyACM0"}}
    failed: tuple[dict[str, set[int]], ...] = tuple(
        {PERCEPTION_OBSERVABLE: perception, MARKING_OBSERVABLE: marking}
        for perception, marking in (({1}, set()), ({1, 2, 3}, {4}), (set(), {4}))
    )
    return (
        carried_by(home / "imitated", "px4", failed[0]),
        carried_by(home / "firmware", firmware, failed[1]),
        carried_by(home / "board", board, failed[2], mode="realtime"),
    )


def test_what_imitation_changes_is_told_by_scene(autopilots: tuple[Path, Path, Path], rebar: Rebar) -> None:
    imitated, firmware, board = autopilots
    comparison = compare_campaigns((imitated, firmware))
    assert comparison.autopilots == ("px4, lockstep", "px4 (real), lockstep")
    assert comparison.perceptions is None
    assert comparison.scenes == SCENES
    assert counts_of(comparison) == ((SCENES - 3, 2, 0, 1), (SCENES - 1, 1, 0, 0))
    on_board = compare_campaigns((firmware, board))
    assert on_board.autopilots == ("px4 (real), lockstep", "px4-board (real), realtime")
    assert counts_of(on_board) == ((SCENES - 3, 0, 3, 0), (SCENES - 1, 0, 0, 1))
    text = rebar.words("compare", imitated, firmware)
    assert "scenes passed by autopilot (first: px4, lockstep; second: px4 (real), lockstep):" in text
    document = rebar.json("compare", imitated, firmware)
    assert document["autopilots"] == ["px4, lockstep", "px4 (real), lockstep"]


def test_two_that_differ_in_more_share_no_scene(
    autopilots: tuple[Path, Path, Path], tmp_path: Path, rebar: Rebar
) -> None:
    other = flown_with(tmp_path / "other", "truth", {}, autopilot="ardupilot")
    assert "not the same scenes, so nothing is paired" in rebar.words("compare", autopilots[0], other)


def paced(folder: Path, paces: dict[str, str]) -> Path:
    """The made campaign, its agents with paces of their own."""
    make_campaign(folder, Made(scenes=3))
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    for agent in campaign["agents"]:
        agent["pace"] = paces[agent["manifest"]]
        changed(folder, f"*-{agent['manifest']}.json", pace={"mode": agent["pace"]})
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign))
    return folder


def test_two_agents_of_one_campaign_at_two_paces(tmp_path: Path, rebar: Rebar) -> None:
    first, second = AGENTS
    different = paced(tmp_path / "different", {first: "lockstep", second: "warp"})
    note = f"{first} flew at the pace lockstep, {second} at warp: what differs may be the pace"
    assert note in rebar.words("compare", different)
    assert rebar.json("compare", different)["paces"] == ["lockstep", "warp"]
    page = write_report(different).read_text()
    assert note in page
    assert f"the runs of {first} at lockstep, the runs of {second} at warp" in page
    same = paced(tmp_path / "same", {first: "warp", second: "warp"})
    assert rebar.json("compare", same)["paces"] is None


def test_two_campaigns_at_two_paces(tmp_path: Path, rebar: Rebar) -> None:
    """The scenes are paired, and the autopilot, which is the same, is not named for the difference."""
    folders = [carried_by(tmp_path / mode, "px4", {}, mode) for mode in ("realtime", "warp")]
    document = rebar.json("compare", *folders)
    assert (document["scenes"], document["autopilots"]) == (SCENES, None)
    assert document["paces"] == ["realtime", "warp"]
    assert "realtime flew at the pace realtime, warp at warp" in rebar.words("compare", *folders)
