"""`rebar compare` on one campaign flown with two sources of perception."""

from __future__ import annotations

import json
import sys
from dataclasses import astuple
from pathlib import Path

import polars as pl
import pytest
from command_line import json_of

from bench.cli._app import run
from bench.reporting import compare_campaigns
from bench.simspec import SimSpec

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import AGENTS, OBSERVABLES, STUDY, Made, make_campaign

AGENT = AGENTS[1]
PERCEPTION_OBSERVABLE, MARKING_OBSERVABLE = OBSERVABLES["KA-05"][0], OBSERVABLES["KA-18"][1]
SCENES = 12


def flown_with(folder: Path, source: str, failed: dict[str, set[int]], detector: str | None = None) -> Path:
    """The made campaign with a source of perception; observables fail in these scenes and pass in all others."""
    make_campaign(folder, Made(scenes=SCENES, agents=(AGENT,)))
    for path in (folder / "simspecs").glob("*.json"):
        document = json.loads(path.read_text())
        document["perception"] |= {"source": source, "detector": detector}
        path.write_text(SimSpec.model_validate(document).model_dump_json())
    scene = pl.col("design_point").str.slice(1).cast(pl.Int64)
    scores = pl.read_parquet(folder / "scores.parquet")
    for name, scenes in failed.items():
        chosen = pl.col("node") == name
        passed = (~scene.is_in(sorted(scenes))).cast(pl.Float64)
        scores = scores.with_columns(
            confidence=pl.when(chosen).then(passed).otherwise(pl.col("confidence")),
            considered=pl.when(chosen)
            .then(1)
            .otherwise(pl.col("considered"))
            .cast(scores["considered"].dtype),
        )
    scores.write_parquet(folder / "scores.parquet")
    return folder


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One observable fails by perception (with simulated alone), another by reasoning (with both)."""
    home = tmp_path_factory.mktemp("sources")
    return (
        flown_with(
            home / "simulated",
            "simulated",
            {PERCEPTION_OBSERVABLE: {0, 1, 2, 3, 4}, MARKING_OBSERVABLE: {6, 7, 8}},
        ),
        flown_with(home / "truth", "truth", {PERCEPTION_OBSERVABLE: {4}, MARKING_OBSERVABLE: {6, 7, 8}}),
    )


def test_failures_of_perception_are_told_from_failures_of_reasoning(sources: tuple[Path, Path]) -> None:
    """Scene by scene: what fails with one source alone, and what with both."""
    comparison = compare_campaigns(sources)
    assert comparison.perceptions == ("simulated, degraded", "truth")
    assert comparison.scenes == SCENES
    counts = {node.node: node.counts for node in comparison.nodes}
    assert set(counts) == {*STUDY, *(name for ka in STUDY for name in OBSERVABLES[ka])}
    perception_counts, marking_counts = counts[PERCEPTION_OBSERVABLE], counts[MARKING_OBSERVABLE]
    assert astuple(perception_counts) == (7, 0, 4, 1)
    assert astuple(marking_counts) == (9, 0, 0, 3)


def test_people_and_machines_get_the_counts(
    sources: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [str(path) for path in sources]
    assert run(["compare", *paths]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "scenes passed by perception (first: simulated, degraded; second: truth):" in lines
    assert [PERCEPTION_OBSERVABLE, "7", "0", "4", "1"] in [line.split() for line in lines]
    document = json_of(["compare", *paths, "--node", PERCEPTION_OBSERVABLE, "--json"], capsys)
    assert document["perceptions"] == ["simulated, degraded", "truth"]
    assert [node["node"] for node in document["nodes"]] == [PERCEPTION_OBSERVABLE]


def test_equal_scenes_are_compared_as_before(sources: tuple[Path, Path], tmp_path: Path) -> None:
    """Two campaigns with one perception pair in full: the nodes under study alone, and no perceptions."""
    repeated = flown_with(tmp_path / "again", "truth", {PERCEPTION_OBSERVABLE: {1}})
    comparison = compare_campaigns((sources[1], repeated))
    assert comparison.perceptions is None
    assert [node.node for node in comparison.nodes] == list(STUDY)


def test_every_source_and_every_detector_can_be_compared(sources: tuple[Path, Path], tmp_path: Path) -> None:
    """Pixels against the truth, two detectors with one another, and an agent's own perception."""
    small = flown_with(tmp_path / "small", "detector", {PERCEPTION_OBSERVABLE: set(range(10))})
    other = flown_with(tmp_path / "other", "detector", {PERCEPTION_OBSERVABLE: {0, 1}}, detector="other")
    by_agent = flown_with(tmp_path / "own", "agent", {MARKING_OBSERVABLE: {1}})
    named = {
        (first, second): compare_campaigns((first, second)).perceptions
        for first, second in ((small, sources[1]), (small, other), (by_agent, other))
    }
    assert list(named.values()) == [
        ("detector small", "truth"),
        ("detector small", "detector other"),
        ("agent", "detector other"),
    ]
    counts = {node.node: node.counts for node in compare_campaigns((small, other)).nodes}
    perception_counts = counts[PERCEPTION_OBSERVABLE]
    assert astuple(perception_counts) == (2, 0, 8, 2)
