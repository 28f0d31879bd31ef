"""`rebar compare` on made campaigns: what it says, for people and machines, and what it refuses."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from command_line import Rebar
from made_campaign import AGENTS, STUDY, Made, make_campaign
from test_reporting_page import Page

from bench.reporting import compare_campaigns, factor_effects, load_report_data, render_report
from bench.statistics import FACTOR_COLUMNS

NAIVE, AWARE = AGENTS


@pytest.fixture(scope="module")
def campaign_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two agents on eighteen scenes."""
    return make_campaign(tmp_path_factory.mktemp("compare") / "both", Made(scenes=18))


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same two agents, each with a campaign of its own."""
    home = tmp_path_factory.mktemp("apart")
    return tuple(make_campaign(home / agent, Made(scenes=18, agents=(agent,))) for agent in AGENTS)  # type: ignore[return-value]


def test_two_agents_of_one_campaign(campaign_folder: Path, rebar: Rebar) -> None:
    """The naive agent fails where it should, and nowhere else is anything settled; the numbers are those of the table."""
    document = rebar.json("compare", campaign_folder)
    assert (document["first"], document["second"], document["scenes"]) == (NAIVE, AWARE, 18)
    nodes = {node["node"]: node for node in document["nodes"]}
    assert list(nodes) == list(STUDY)
    assert [name for name in STUDY if nodes[name]["settled"]] == ["KA-18"]
    scores = pl.read_parquet(campaign_folder / "scores.parquet").filter(pl.col("node") == "KA-18")
    rates = [(scores.filter(pl.col("agent") == agent)["confidence"] >= 1.0).mean() for agent in AGENTS]
    assert nodes["KA-18"]["pass_rates"] == pytest.approx(rates)
    assert nodes["KA-18"]["difference"]["estimate"] == pytest.approx(rates[1] - rates[0])  # type: ignore[operator]
    assert nodes["KA-18"]["verdict"].endswith("18 pairs; settled")
    assert nodes["KA-03"]["pairs_needed"] > 18


def test_for_people(campaign_folder: Path, rebar: Rebar) -> None:
    nodes = ("--node", "KA-18", "--node", "KA-20")
    text = rebar.words("compare", campaign_folder, "--agents", AWARE, NAIVE, *nodes)
    assert f"KA-18: {AWARE} passes KA-18 in" in text
    assert "KA-20: " in text
    assert "KA-03" not in text


def random_campaign(folder: Path, seed: int) -> Path:
    """Eight design points of three replicates; runs that fail, are not considered, or do not count."""
    make_campaign(folder, Made(scenes=24))
    random = np.random.default_rng(seed)
    scores = pl.read_parquet(folder / "scores.parquet")
    nodes = scores["node"].unique().sort()
    chance = {(agent, node): random.uniform(0.2, 0.9) for agent in AGENTS for node in nodes}
    rows = []
    spoilt = {name for name in sorted(set(scores["realization"])) if random.random() < 0.1}
    for row in scores.iter_rows(named=True):
        scene = int(row["design_point"][1:])
        passed = random.random() < chance[row["agent"], row["node"]]
        considered = random.random() < 0.9 and row["realization"] not in spoilt
        rows.append(
            row
            | {
                "design_point": f"p{scene // 3:03d}",
                "replicate": scene % 3,
                "outcome": "bench_error" if row["realization"] in spoilt else "completed",
                "confidence": None if not considered else 1.0 if passed else 0.5,
                "achieved": 2 * considered if passed else int(considered),
                "considered": 2 * considered,
                "score": float(random.uniform(0, 100)) if considered and passed else None,
            }
        )
    pl.DataFrame(rows, schema=scores.schema).write_parquet(folder / "scores.parquet")
    return folder


@pytest.mark.parametrize("seed", range(2))
def test_report_and_command_give_the_same_numbers(seed: int, tmp_path: Path, rebar: Rebar) -> None:
    """On a random campaign: every cell of the report's table is that of the command, and both are those in JSON."""
    folder = random_campaign(tmp_path / "random", seed)
    document = rebar.json("compare", folder)
    nodes = {node["node"]: node for node in document["nodes"]}
    printed = [line.split() for line in rebar("compare", folder).splitlines() if line.startswith(" KA-")]
    page = Page(render_report(load_report_data(folder)))
    (table,) = (rows for rows in page.tables_by_class["significance"])
    reported = {row[0]: row for row in table[1:]}
    assert list(reported) == list(nodes) == list(STUDY)
    rates, divergences = printed[: len(STUDY)], printed[len(STUDY) :]
    for name, rate_cells, divergence_cells in zip(STUDY, rates, divergences, strict=True):
        node, row = nodes[name], reported[name]
        assert " ".join(row[:8]).split() == rate_cells
        assert " ".join([name, *row[8:11]]).split() == divergence_cells
        assert row[11] == node["verdict"]
        difference = 100 * node["difference"]["estimate"]
        assert float(row[4].replace("−", "-")) == pytest.approx(difference, abs=0.051)
        assert row[7] == ("< 0.001" if node["p_adjusted"] < 0.001 else f"{node['p_adjusted']:.3f}")
    answer = " ".join(page.text.split("What is not claimed")[0].split())
    for name, node in nodes.items():
        assert (f"passed {name} (" in answer) is node["settled"]
    assert 0 < sum(node["pairs"] for node in nodes.values()) < 24 * len(STUDY)


def test_one_agent_of_each_campaign(campaign_folder: Path, apart: tuple[Path, Path], rebar: Rebar) -> None:
    merged, separate = rebar.json("compare", campaign_folder), rebar.json("compare", *map(str, apart))
    # Folders without a journal: nothing is known about either.
    assert (merged.pop("completeness"), separate.pop("completeness")) == ([None], [None, None])
    assert merged == separate


def test_scenes_are_matched_by_content_and_not_by_name(apart: tuple[Path, Path], tmp_path: Path) -> None:
    """A second campaign that numbers its points otherwise has the same pairs; a scene that was changed is none."""
    other = tmp_path / "renamed"
    shutil.copytree(apart[1], other)
    scores = pl.read_parquet(other / "scores.parquet")
    renamed = scores.with_columns(design_point=pl.concat_str(pl.lit("q"), "design_point"))
    renamed.write_parquet(other / "scores.parquet")
    assert compare_campaigns([apart[0], other]) == compare_campaigns(apart)
    path = other / "simspecs" / f"p000-r0-{AWARE}.json"
    path.write_text(path.read_text().replace('"root":1000', '"root":999'))
    changed = compare_campaigns([apart[0], other])
    assert changed.scenes == 17
    assert changed.nodes[0].counts.pairs == 17


def test_the_same_agent_in_two_campaigns_is_named_by_folder(campaign_folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "copy"
    shutil.copytree(campaign_folder, other)
    comparison = compare_campaigns([campaign_folder, other], [NAIVE, NAIVE])
    assert (comparison.first, comparison.second) == ("both", "copy")
    assert all(node.difference is not None and node.difference.estimate == 0.0 for node in comparison.nodes)
    assert all(node.divergence is not None and node.divergence.value == 0.0 for node in comparison.nodes)


def test_other_scenes_are_compared_without_pairs(campaign_folder: Path, tmp_path: Path, rebar: Rebar) -> None:
    """The second iteration fails KA-18 never where the first does often, and is the same everywhere else."""
    second = tmp_path / "second"
    make_campaign(second, Made(scenes=14, agents=(NAIVE,)))
    for path in (second / "simspecs").glob("*.json"):
        path.write_text(path.read_text().replace('"root":10', '"root":77'))
    scores = pl.read_parquet(second / "scores.parquet")
    improved = pl.col("node") == "KA-18"
    scores.with_columns(
        pl.when(improved).then(1.0).otherwise("confidence").alias("confidence"),
        pl.when(improved).then(90.0).otherwise("score").alias("score"),
    ).write_parquet(second / "scores.parquet")
    line = [str(campaign_folder), str(second)]
    document = rebar.json("compare", *line)
    assert (document["first"], document["second"], document["scenes"]) == ("both", "second", 0)
    assert document["nodes"] == []
    nodes = {node["node"]: node for node in document["unpaired"]}
    assert list(nodes) == list(STUDY)
    assert [name for name in STUDY if nodes[name]["settled"]] == ["KA-18"]
    ka18 = nodes["KA-18"]
    assert (ka18["points"], ka18["passed"][1], ka18["considered"]) == ([18, 14], 14, [18, 14])
    assert ka18["results"]["score above 80 to 100"][1] == 14
    assert [sum(counts) for counts in zip(*ka18["results"].values(), strict=True)] == [18, 14]
    assert [ka18["divergence"][name] for name in ("paired", "first", "second")] == [False, 18, 14]
    assert ka18["verdict"] == "both and second differ; 18 and 14 runs; not the same scenes"
    assert nodes["KA-03"]["verdict"] == "no difference is shown; 18 and 14 runs; not the same scenes"

    shown = rebar("compare", *line)
    assert max(map(len, shown.splitlines())) <= 80
    words = " ".join(shown.split())
    assert "both and second: not the same scenes, so nothing is paired" in words
    assert "KA-18: both and second differ; 18 and 14 runs; not the same scenes" in words
    passed = f"{ka18['passed'][0]} of 18 14 of 14 {ka18['divergence']['value']:.2f}"
    assert f"KA-18 {passed}" in words
    assert "KA-18 score above 80 to 100" in words
    assert "pairs" not in words


def test_what_cannot_be_compared_is_refused_with_code_2(
    campaign_folder: Path, apart: tuple[Path, Path], tmp_path: Path, rebar: Rebar
) -> None:
    other, bare, moved = tmp_path / "other", tmp_path / "bare", tmp_path / "moved"
    shutil.copytree(apart[1], other)
    document = (other / "decomposition.json").read_text()
    (other / "decomposition.json").write_text(document.replace("Made up.", "Made otherwise."))
    shutil.copytree(campaign_folder, bare)
    (bare / "scores.parquet").unlink()
    shutil.copytree(apart[1], moved)
    for path in (moved / "simspecs").glob("*.json"):
        path.write_text(path.read_text().replace('"root":10', '"root":77'))
    mistakes = {
        "different decompositions": [str(apart[0]), str(other)],
        "there is no node 'KA-99'": [str(campaign_folder), "--node", "KA-99"],
        "is not in": [str(campaign_folder), "--agents", NAIVE, "nobody"],
        "the same agent": [str(campaign_folder), "--agents", NAIVE, NAIVE],
        "not plain which two": [str(apart[0])],
        "name one folder or two": [str(campaign_folder)] * 3,
        "holds no scores": [str(bare)],
        "no scene in common": [str(apart[0]), str(moved)],
        "holds no campaign": [str(tmp_path)],
    }
    for words, line in mistakes.items():
        shown = rebar.refused("compare", *line)
        assert words in shown
        assert "Traceback" not in shown


def test_factors_are_asked_about_where_ten_runs_failed(campaign_folder: Path) -> None:
    data = load_report_data(campaign_folder)
    for failed, is_asked in ((9, False), (10, True)):
        counts: dict[str, Any] = {"considered": 18, "passed": 18 - failed}
        tallies = {key: replace(tally, **counts) for key, tally in data.tallies.items()}
        matter = factor_effects(replace(data, tallies=tallies))
        assert bool(matter.tables) is is_asked
        assert bool(matter.too_few) is not is_asked
        assert ("Fewer than 10 runs" in matter.note) is not is_asked


def test_the_report_finds_the_factor_that_was_planted(campaign_folder: Path) -> None:
    """Confidence is spoilt wherever one factor is at its upper level: found, for that agent and node and no other."""
    data = load_report_data(campaign_folder)
    points = {point: number for number, point in enumerate(sorted(set(data.scores["design_point"])))}
    # Six design points of the design, three replicates each; concealment is the factor that changes fastest.
    named = {point: (f"p{number % 6 + 1:03d}", number // 6 + 1) for point, number in points.items()}
    hidden = pl.col("design_point").is_in(["p002", "p004", "p006"])
    spoilt = hidden & (pl.col("agent") == NAIVE) & (pl.col("node") == "KA-20")
    base = pl.col("realization").hash(1) % 7 / 100.0
    scores = data.scores.with_columns(
        pl.col("design_point").replace_strict({k: v[0] for k, v in named.items()}),
        pl.col("design_point").replace_strict({k: v[1] for k, v in named.items()}).alias("replicate"),
    ).with_columns((pl.when(spoilt).then(0.2).otherwise(0.9) + base).alias("confidence"))

    # So many failed that one may ask.
    tallies = {key: replace(tally, considered=18, passed=8) for key, tally in data.tallies.items()}
    matter = factor_effects(replace(data, scores=scores, tallies=tallies))
    significant = [
        (table.agent, table.node, row.factor)
        for table, row in matter.significant_effects
        if "confidence" in row.significant_tests
    ]
    assert significant == [(NAIVE, "KA-20", "concealment")]
    assert matter.frame.columns == list(FACTOR_COLUMNS)
    assert matter.independence is not None
    assert matter.independence.max_v == pytest.approx(0.0, abs=1e-9)


def test_without_a_design_the_report_says_so(campaign_folder: Path) -> None:
    data = load_report_data(campaign_folder)
    assert factor_effects(replace(data, campaign={})).note == "The campaign's design varies no factor."
    assert "varies no factor" in render_report(replace(data, campaign={}))
    odd = {"design": {"factors": [{"name": "fog"}]}}
    assert "cannot be read" in factor_effects(replace(data, campaign=odd)).note
