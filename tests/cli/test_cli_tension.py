"""`rebar tension`: every range that it prints gives that tension, and nothing outside them does."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import Rebar

from bench.campaign import load_campaign, realizations
from bench.cli._app import run
from bench.cli._scores import rated_decomposition
from bench.cli._tension import _factor_ranges, _range_text
from bench.difficulty import features_of, shipped_scale
from bench.realization import place
from bench.scoring import difficulty_of, difficulty_of_values, tension_of
from bench.simspec import SimSpec, factor_values
from decompositions import Decomposition, KeyFactor, Level, load_decomposition

ROOT = Path(__file__).parents[2]
PANEL = str(ROOT / "campaigns" / "panel.yaml")
DECOMPOSITIONS = ("search-and-report", "search-and-report-full", "find-the-missing")
TENSIONS = range(1, 6)
RANGE = re.compile(
    r"(?P<beyond>beyond )?(?P<begin>[-\d.e+]+) (?:(?P<never>or harder; .*)|to (?P<short>short of )?(?P<end>.+))"
)


@dataclass(frozen=True)
class Range:
    """One printed range; `end` is None for the table's end."""

    begin: float
    is_past: bool
    decides: bool
    end: float | None
    is_short: bool

    @classmethod
    def read(cls, text: str) -> Range:
        match = RANGE.fullmatch(text)
        assert match is not None, text
        end = match["end"]
        numbers = None if end in (None, "the table's end") else float(end)
        return cls(
            float(match["begin"]), bool(match["beyond"]), not match["never"], numbers, bool(match["short"])
        )

    def points(self, hardest: float) -> list[float]:
        """The ends and three values between; where an end is not in the range, a value just inside."""
        end = hardest if self.end is None else self.end
        inner = np.linspace(self.begin, end, 5)
        if self.is_past:
            inner[0] += (end - self.begin) * 1e-3
        if self.is_short:
            inner[-1] -= (end - self.begin) * 1e-3
        return [float(value) for value in inner]

    def allows(self, value: float, sign: float) -> bool:
        """Whether a value is at least as hard as the first."""
        return sign * value > sign * self.begin or (value == self.begin and not self.is_past)

    def holds(self, value: float, sign: float) -> bool:
        """Whether a value is in the range."""
        if not self.decides or not self.allows(value, sign):
            return False
        return self.end is None or sign * value < sign * self.end or (value == self.end and not self.is_short)


@cache
def tree_of(name: str) -> Decomposition:
    return rated_decomposition(name)


def tables(tree: Decomposition, node: str | None = None) -> dict[str, list[KeyFactor]]:
    """The tables of each factor under a node, or of all. Another node may rate the same factor the other way."""
    rows: dict[str, list[KeyFactor]] = {}
    for observable in tree.observables if node is None else tree.observables_under(node):
        for row in tree.key_factors(observable):
            rows.setdefault(row.factor, []).append(row)
    return rows


def hardest_of(rows: list[KeyFactor]) -> float:
    rises = rows[0].values[-1] > rows[0].values[0]
    ends = [row.values[-1] for row in rows]
    return max(ends) if rises else min(ends)


def sign_of(rows: list[KeyFactor]) -> float:
    return 1.0 if rows[0].values[-1] > rows[0].values[0] else -1.0


def combinations(rows: dict[str, list[KeyFactor]], ranges: Mapping[str, Range]) -> Iterator[dict[str, float]]:
    """Each deciding factor at each of its points; all others at their easiest and at their hardest."""
    for name, decider in ranges.items():
        for value in decider.points(hardest_of(rows[name])) if decider.decides else ():
            for easiest in (True, False):
                others = {
                    other: bounds.points(hardest_of(rows[other]))[0] if easiest else hardest_of(rows[other])
                    for other, bounds in ranges.items()
                }
                yield {**others, name: value}


@pytest.mark.parametrize("name", DECOMPOSITIONS)
def test_every_range_gives_its_tension_and_nothing_else_does(name: str) -> None:
    """Ends and inner points of every key attribute's ranges, and random values of all factors."""
    tree, random = tree_of(name), np.random.default_rng(4)
    columns = {
        factor: sorted({value for row in rows for value in row.values})
        for factor, rows in tables(tree).items()
    }
    last = {factor: values[-1] for factor, values in columns.items()}

    def sample(values: list[float]) -> float:
        """A column, where ratings jump and tensions end, or a value between the columns."""
        return float(
            random.choice(values) if random.random() < 0.5 else random.uniform(values[0], values[-1])
        )

    samples = [{factor: sample(values) for factor, values in columns.items()} for _ in range(60)]
    rated = [difficulty_of_values(tree, values, "simulated") for values in samples]
    reached = judged = 0
    for node in tree.at_level(Level.KEY_ATTRIBUTE):
        rows = tables(tree, node)
        for wanted in TENSIONS:
            found = list(_factor_ranges(tree, node, wanted))
            ended = any(row["from"] is None for row in found)
            begun = [row for row in found if row["from"] is not None]
            ranges = {row["factor"]: Range.read(_range_text(row, wanted)) for row in begun}
            # Of ten combinations a factor every seventh: over all factors that is each of them many times.
            for values in () if ended else islice(combinations(rows, ranges), 0, None, 7):
                difficulty = difficulty_of_values(tree, {**last, **values}, "simulated").nodes[node]
                assert difficulty.tension == wanted, (node, values)
                reached += 1
            for values, difficulties in zip(samples, rated, strict=True):
                rating = difficulties.of(node)
                is_absent = any(row.is_absent(values[row.factor]) for under in rows.values() for row in under)
                # What the situation holds nothing of decides nothing (ruling 14); the ranges are of all factors.
                if rating is None or is_absent:
                    continue
                judged += 1
                # Easier than a table's first column everything rates 0; the ranges begin at the columns.
                places = [(bounds, values[name], sign_of(rows[name])) for name, bounds in ranges.items()]
                allowed = all(bounds.allows(value, sign) for bounds, value, sign in places)
                held = any(bounds.holds(value, sign) for bounds, value, sign in places)
                printed = not ended and allowed and held
                if printed or wanted > 1:
                    assert (tension_of(rating) == wanted) is printed, (node, wanted, values)
    assert reached >= 50
    assert judged > 200


BASE = """
name: tension
world: {area: {corners: [{east_m: -500, north_m: -500}, {east_m: 500, north_m: -500}, {east_m: 500, north_m: 500}, {east_m: -500, north_m: 500}]}}
mission: {altitude_m: %(uav_altitude_m)r, time_limit_s: %(time_limit_s)r}
actors:
  - {id: radar, asset: radar-vehicle, role: adversary, count: 1, concealment: %(target_concealment)r}
  - id: people
    asset: civilian
    role: bystander
    density_per_km2: %(bystander_density_per_km2)r
    placement: {mean_distance: {of: radar, mean_m: %(bystander_proximity_m)r}}
intelligence: [{id: told, about: radar, uncertainty_m: %(intelligence_uncertainty_m)r}]
"""


@pytest.mark.parametrize("wanted", TENSIONS)
@pytest.mark.parametrize("node", tree_of("search-and-report").at_level(Level.KEY_ATTRIBUTE))
def test_what_is_told_holds_in_a_simspec(node: str, wanted: int, capsys: pytest.CaptureFixture[str]) -> None:
    tree = tree_of("search-and-report")
    exit_code = run(["tension", node, str(wanted)])
    printed = capsys.readouterr().out
    lines = re.findall(r"^  (\w+) \[.*?\]: (.+)$", printed, re.MULTILINE)
    assert lines
    if exit_code:
        assert "No situation within the tables has this tension" in " ".join(printed.split())
        return
    ranges = {factor: Range.read(text) for factor, text in lines}
    hardest = {factor: hardest_of(rows) for factor, rows in tables(tree).items()}
    tried = 0
    for values in combinations(tables(tree, node), ranges):
        simspec = SimSpec.model_validate(yaml.safe_load(BASE % {**hardest, **values}))
        assert factor_values(simspec)["bystander_proximity_m"] is not None
        assert difficulty_of(tree, simspec).nodes[node].tension == wanted, values
        tried += 1
    assert tried >= 10


def test_a_tension_that_no_table_reaches_is_said(rebar: Rebar) -> None:
    """Concealment is rated from 30 to 80."""
    for wanted, reason in (("1", "no factor rates so low"), ("5", "end before it")):
        assert reason in rebar.words("tension", "KA-05", wanted, code=1)


def test_detections_of_the_bench_give_no_tension(rebar: Rebar) -> None:
    """Concealment stands under KA-09 for the configured sensor alone, and counts there in no SimSpec."""
    printed = rebar("tension", "KA-09", "2")
    assert "uav_altitude_m" in printed
    assert "target_concealment" not in printed


def test_a_mean_of_ratings_has_no_ranges(tmp_path: Path, rebar: Rebar) -> None:
    """One factor alone decides nothing then."""
    source = ROOT / "decompositions" / "data" / "search_and_report.yaml"
    document = yaml.safe_load(source.read_text())
    document["policies"] = {**document.get("policies", {}), "factor_rule": "mean"}
    file = tmp_path / "mean.yaml"
    file.write_text(yaml.safe_dump(document))
    assert "factor_rule: mean" in rebar.refused("tension", "KA-03", "2", "--decomposition", file)


@pytest.mark.parametrize(("node", "wanted", "form"), [("KA-20", 3, "--json"), ("KA-24", 4, "text")])
def test_situations_of_a_measured_tension_are_drawn_from_a_campaign(
    node: str, wanted: int, form: str, tmp_path: Path, rebar: Rebar
) -> None:
    out = tmp_path / "drawn.yaml"
    line = ["tension", node, str(wanted), "--campaign", PANEL, "--points", "2", "--out", str(out)]
    printed = rebar(*line, *([form] if form == "--json" else ()))
    campaign = load_campaign(out)
    assert campaign.study == (node,)
    scale = shipped_scale(load_decomposition(campaign.decomposition))
    assert scale is not None
    plans = {plan.design_point: plan for plan in realizations(campaign)}
    assert len(plans) == 2
    situations = {}
    for name, plan in plans.items():
        measured = scale.measure(node, features_of(place(plan.situation)))
        assert measured.tension == wanted
        situations[name] = measured.difficulty
    if form == "--json":
        assert json.loads(printed) == {"node": node, "tension": wanted, "situations": situations}
    else:
        assert f"2 situations of tension {wanted} for {node} by measured difficulty, in" in printed
        assert printed.splitlines()[-2:] == [f"  {name}: {value:.0f}" for name, value in situations.items()]
    # What is there stays, and neither option stands alone.
    assert run(line) == 2
    assert run(line[:-2]) == 2


def test_a_node_without_a_proved_scale_has_no_measured_tension(tmp_path: Path, rebar: Rebar) -> None:
    out = tmp_path / "drawn.yaml"
    assert "was not shown to predict KA-03" in rebar.refused(
        "tension", "KA-03", "3", "--campaign", PANEL, "--out", out
    )
    assert not out.exists()
