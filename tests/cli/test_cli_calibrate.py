"""`rebar calibrate` on made campaigns: a rating whose order is wrong is found, and a fitted scale has it right."""

from __future__ import annotations

import json
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from command_line import Rebar
from made_campaign import made_simspec

from bench.contracts import Observation, Outcome
from bench.difficulty import load_scale
from bench.scoring import ScoredRun, difficulty_of, score_table
from bench.simspec import SimSpec
from decompositions import Decomposition, load_decomposition

# The first two are the panel; the others are none of it.
ABILITIES = {"shaky": 0.1, "steady": -0.1, "rough": 0.05, "solid": -0.05}
PANEL, OTHERS = ("shaky", "steady"), ("rough", "solid")
# Failure rates by column. Fog is the planted table: what it rates hardest fails least.
RATES: dict[str, tuple[float, ...]] = {"OBS-FOG-1": (0.85, 0.6, 0.4, 0.15), "OBS-FOG-2": (0.9, 0.7, 0.3, 0.2)}
RATES |= {"OBS-HIDDEN": (0.15, 0.5, 0.85), "OBS-RAIN": (0.15, 0.85, 0.15, 0.85), "OBS-EYES": (0.5,) * 4}
LEAF = {"measure": "made_up", "threshold": 0.5, "threshold_reason": "Made up.", "considered": "Always."}


def row(
    factor: str, unit: str, ratings: list[float], values: list[float], **fields: object
) -> dict[str, Any]:
    """A key factor table."""
    table = {"factor": factor, "unit": unit, "ratings": ratings, "values": values, "reason": "Made up."}
    return table | fields


def decomposition() -> dict[str, Any]:
    """Tables planted wrong, right, and with two columns out of order; observables about the detector, and about nothing."""
    rain = row("rain_level", "level", [10, 40, 70, 100], [0, 1, 2, 3])
    hidden = row("target_concealment", "1", [20, 50, 80], [0, 0.5, 1])
    nothing = row("no_fly_share", "1", [10, 90], [1, 5], absent=0)
    leaves: dict[str, tuple[dict[str, Any] | str, str]] = {
        "OBS-FOG-1": ("fog", "agent"),
        "OBS-FOG-2": ("fog", "agent"),
        "OBS-HIDDEN": (hidden, "agent"),
        "OBS-RAIN": (rain, "agent"),
        "OBS-EYES": (rain, "perception"),
        "OBS-NEVER": (nothing, "agent"),
    }
    groups = {"FOG": ["OBS-FOG-1", "OBS-FOG-2"], "HIDDEN": ["OBS-HIDDEN"], "RAIN": ["OBS-RAIN"]}
    groups |= {"EYES": ["OBS-EYES"], "NEVER": ["OBS-NEVER"]}
    text = {"title": "Made up", "asks": "Made up?"}
    return {
        "format": "rebar.decomposition/1",
        "name": "made-up",
        "title": "Made up",
        "tables": {"fog": row("fog_level", "level", [10, 40, 70, 100], [0, 1, 2, 3])},
        "key_attributes": [{"id": f"KA-{name}", **text, "children": [f"VAB-{name}"]} for name in groups],
        "vabs": [{"id": f"VAB-{name}", **text, "children": children} for name, children in groups.items()],
        "observables": [
            {"id": name, **text, **LEAF, "key_factors": [factors], "subject": subject}
            for name, (factors, subject) in leaves.items()
        ],
    }


@cache
def base_of(agent: str) -> SimSpec:
    """Reading it takes long."""
    return made_simspec(0, agent)


def scene(number: int, agent: str) -> SimSpec:
    """Four levels of fog and rain and three of concealment, fully crossed over 48 scenes, and again with another heading."""
    base = base_of(agent)
    turn, number = divmod(number, 48)
    home = base.vehicle.home.model_copy(update={"heading_deg": float(turn)})
    weather = {"fog_level": float(number % 4), "rain_level": float(number // 4 % 4)}
    hidden = {"radar": {"concealment": (0.0, 0.5, 1.0)[number // 16]}}
    actors = tuple(group.model_copy(update=hidden.get(group.id, {})) for group in base.actors)
    return base.model_copy(
        update={
            "environment": base.environment.model_copy(update=weather),
            "actors": actors,
            "vehicle": base.vehicle.model_copy(update={"home": home}),
            "rules": base.rules.model_copy(update={"no_fly": ()}),
        }
    )


def columns(number: int) -> dict[str, int]:
    """The column of each observable's table in a scene."""
    fog, rain, hidden = number % 4, number // 4 % 4, number % 48 // 16
    return {"OBS-FOG-1": fog, "OBS-FOG-2": fog, "OBS-HIDDEN": hidden, "OBS-RAIN": rain, "OBS-EYES": rain}


def make(folder: Path, agents: tuple[str, ...], numbers: range = range(48)) -> Path:
    """A campaign's folder as far as calibration reads it."""
    (folder / "simspecs").mkdir(parents=True)
    campaign: dict[str, Any] = {
        "format": "rebar.campaign/1",
        "name": "made-up",
        "decomposition": "decomposition.json",
    }
    campaign["agents"] = [{"manifest": agent} for agent in agents]
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign))
    (folder / "decomposition.json").write_text(json.dumps(decomposition()))
    document = load_decomposition(folder / "decomposition.json")
    runs = [_run(folder, document, number, agent) for number in numbers for agent in agents]
    score_table(document, runs).write_parquet(folder / "scores.parquet")
    return folder


def _run(folder: Path, document: Decomposition, number: int, agent: str) -> ScoredRun:
    name, simspec = f"p{number:03d}-r0-{agent}", scene(number, agent)
    (folder / "simspecs" / f"{name}.json").write_text(simspec.model_dump_json())
    random = np.random.default_rng([number % 48, sum(map(ord, agent))])
    observations = [
        # A null agent fails everything: with it, no order would be left.
        Observation(
            observable=leaf,
            considered=True,
            x=float(
                agent in ABILITIES and random.random() >= rates[columns(number)[leaf]] + ABILITIES[agent]
            ),
        )
        for leaf, rates in RATES.items()
    ]
    observations.append(Observation(observable="OBS-NEVER", considered=False))
    difficulty = difficulty_of(document, simspec)
    return ScoredRun(name, f"p{number:03d}", 0, agent, Outcome.COMPLETED, difficulty, tuple(observations))


@pytest.fixture(scope="module")
def two_agents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two agents and a null agent in one campaign."""
    return make(tmp_path_factory.mktemp("calibrate") / "both", (*PANEL, "null-idle"))


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same two agents, each in a campaign of its own."""
    home = tmp_path_factory.mktemp("apart")
    return make(home / "first", ("shaky",)), make(home / "second", ("steady",))


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two agents outside the panel, in scenes of their own."""
    return make(tmp_path_factory.mktemp("others") / "others", OTHERS, range(48, 96))


def test_the_planted_rating_is_found_and_its_neighbours_are_not(
    two_agents: Path, apart: tuple[Path, Path], rebar: Rebar
) -> None:
    """Failure falls with the rating of fog and rises with that of concealment; what tests no agent is left out. Two
    folders say the same as one: scenes are known by what they are, so runs of one scene share a design point.
    """
    document = rebar.json("calibrate", two_agents)
    assert (document["agents"], document["excluded_agents"]) == (["shaky", "steady"], ["null-idle"])
    assert (document["runs"], document["design_points"]) == (96, 48)
    nodes = {node["node"]: node["rated"] for node in document["nodes"]}
    directions = {name: (node["slope"]["direction"], node["slope"]["state"]) for name, node in nodes.items()}
    assert directions["KA-FOG"] == ("falls", "fitted")
    assert directions["KA-HIDDEN"] == ("rises", "fitted")
    assert directions["KA-NEVER"] == ("open", "never considered")
    assert nodes["KA-HIDDEN"]["slope"]["low"] > 0.0 > nodes["KA-FOG"]["slope"]["high"]
    assert nodes["KA-HIDDEN"]["auc_low"] > 0.5 > nodes["KA-FOG"]["auc_high"]
    assert {ability["agent"] for ability in nodes["KA-HIDDEN"]["slope"]["agents"]} == set(PANEL)
    assert {node["measured"] for node in document["nodes"]} == {None}
    separate = rebar.json("calibrate", *apart)
    # Folders without a journal: nothing is known about either.
    assert (document.pop("completeness"), separate.pop("completeness")) == ([None], [None, None])
    for one in (document, separate):
        del one["campaigns"], one["excluded_agents"]
    assert separate == document


def test_a_scale_fitted_to_a_panel_is_proved_on_others(
    two_agents: Path, others: Path, tmp_path: Path, rebar: Rebar
) -> None:
    """It has the order that the rating has not, says where nothing is claimed, and changes no folder."""
    before = {path: path.read_bytes() for path in two_agents.rglob("*") if path.is_file()}
    out = tmp_path / "scale.yaml"
    document = rebar.json("calibrate", others, "--fit", two_agents, "--out", out)
    assert {path: path.read_bytes() for path in two_agents.rglob("*") if path.is_file()} == before
    nodes = {node["node"]: (node["rated"], node["measured"]) for node in document["nodes"]}
    rated, measured = nodes["KA-FOG"]
    assert document["dependence"] == ""
    assert rated["auc"] < 0.5 < 0.75 < measured["auc"]
    assert measured["reason"] == "29 passes in 96 runs"
    assert nodes["KA-HIDDEN"][1]["reason"] == ""
    assert len(measured["bins"]) == 5
    # A node that nothing exercises has no model.
    assert nodes["KA-NEVER"][1] is None
    decomposed = load_decomposition(two_agents / "decomposition.json")
    scale = load_scale(out, decomposed)
    assert scale.model_dump(mode="json") == document["scale"]
    assert (scale.fitted_to[0].agents, scale.tested_on[0].agents) == (PANEL, OTHERS)
    assert scale.nodes["KA-HIDDEN"].unproved == ""
    assert scale.nodes["KA-FOG"].unproved == "29 passes in 96 runs"
    # Two levels of rain are out of order, which no straight line tells.
    assert scale.nodes["KA-RAIN"].unproved == nodes["KA-RAIN"][1]["reason"] != ""
    assert rebar.json("calibrate", others, "--scale", out)["nodes"] == document["nodes"]


def test_a_panel_is_no_proof_of_its_own_scale(two_agents: Path, tmp_path: Path, rebar: Rebar) -> None:
    """Neither are the panel's scenes, flown by others."""
    file, doubt = tmp_path / "scale.yaml", {"not tested on agents outside the panel"}
    fitted = rebar.json("calibrate", "--fit", two_agents, "--out", file)
    tested = rebar.json("calibrate", two_agents, "--scale", file)
    for document in (fitted, tested):
        assert {node["unproved"] for node in document["scale"]["nodes"].values()} == doubt
    assert tested["dependence"].endswith("it was fitted to runs of shaky, steady.")
    text = rebar.words("calibrate", make(tmp_path / "same-scenes", OTHERS), "--scale", file)
    assert "it was fitted to these scenes." in text
    assert "The scale holds" not in text


def test_a_named_null_agent_counts(two_agents: Path, rebar: Rebar) -> None:
    document = rebar.json("calibrate", two_agents, "--agent", "null-idle", "--agent", "steady")
    assert (document["agents"], document["excluded_agents"]) == (["null-idle", "steady"], ["shaky"])


def test_for_people_at_80_columns(two_agents: Path, others: Path, rebar: Rebar) -> None:
    rated, measured = rebar("calibrate", two_agents), rebar("calibrate", others, "--fit", two_agents)
    no_scale = "No scale of measured difficulty for this decomposition: see --fit"
    no_weight = "KA-RAIN: 47 of 96 failed; no feature has a weight"
    for text, words in ((rated, ("KA-FOG 96 5", no_scale)), (measured, ("The scale holds for", no_weight))):
        assert max(map(len, text.splitlines())) <= 80
        assert "…" not in text
        assert all(part in " ".join(text.split()) for part in words)


def test_what_results_decided_is_no_sample(two_agents: Path, tmp_path: Path, rebar: Rebar) -> None:
    """Of design points that ended early only first replicates count; surrogates get a remark."""
    folder = tmp_path / "early"
    shutil.copytree(two_agents, folder)
    scores = pl.read_parquet(folder / "scores.parquet")
    # Every odd scene becomes the second replicate of the scene before it.
    number = pl.col("design_point").str.slice(1).cast(pl.Int64)
    point = pl.format("p{}", number - number % 2)
    early = scores.with_columns(replicate=number % 2, design_point=point, until_settled=pl.lit(value=True))
    early.write_parquet(folder / "scores.parquet")
    text = (folder / "campaign.yaml").read_text()
    (folder / "campaign.yaml").write_text(f"{text}fidelity: overhead\n")
    document = rebar.json("calibrate", folder)
    assert (document["runs"], document["design_points"]) == (48, 24)
    surrogates, ended = document["notes"]
    assert "flown by surrogates" in surrogates
    assert "only the first replicate of each counts" in ended
    early.with_columns(until_settled=pl.lit(value=False)).write_parquet(folder / "scores.parquet")
    all_runs = rebar.json("calibrate", folder)
    assert (all_runs["runs"], all_runs["design_points"]) == (96, 24)


def test_what_cannot_be_calibrated_is_refused_with_code_2(
    two_agents: Path, apart: tuple[Path, Path], tmp_path: Path, rebar: Rebar
) -> None:
    other, bare, lost = tmp_path / "other", tmp_path / "bare", tmp_path / "lost"
    for copy in (other, bare, lost):
        shutil.copytree(apart[1], copy)
    document = (other / "decomposition.json").read_text()
    (other / "decomposition.json").write_text(document.replace("Made up?", "Made otherwise?"))
    (bare / "scores.parquet").unlink()
    (lost / "simspecs" / "p003-r0-steady.json").unlink()
    same = make(tmp_path / "same", PANEL, range(1))
    mistakes = {
        "needs two agents or more, and there is only 'shaky'": [str(apart[0])],
        "another decomposition": [str(apart[0]), str(other)],
        "holds no scores": [str(apart[0]), str(bare)],
        "p003-r0-steady.json: is missing": [str(apart[0]), str(lost)],
        "named twice": [str(two_agents), str(two_agents / ".." / two_agents.name)],
        "no-folder: is no folder": [
            "--fit",
            str(two_agents),
            "--out",
            str(tmp_path / "no-folder" / "s.yaml"),
        ],
        "'nobody' has no considered run here": [str(two_agents), "--agent", "nobody"],
        "one difficulty": [str(same)],
        "holds no campaign": [str(tmp_path)],
        "nothing to test and nothing to fit": [],
        "--out: writes the scale that --fit fits": [str(two_agents), "--out", str(tmp_path / "new.yaml")],
        "already exists": ["--fit", str(two_agents), "--out", str(bare / "campaign.yaml")],
        "--agent: is for testing folders": ["--fit", str(two_agents), "--agent", "shaky"],
        "no scale to fit": ["--fit", str(same)],
        "--scale: is for testing folders": ["--fit", str(two_agents), "--scale", "scale.yaml"],
    }
    for words, line in mistakes.items():
        shown = rebar.refused("calibrate", *line)
        assert words in shown
        assert "Traceback" not in shown
