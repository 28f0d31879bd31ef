"""What a finished campaign suggests to fly next: a campaign's file with its reasons beside it, for a person to review.

Rules, and no more than rules: a factor goes where nothing follows it and the runs would have shown it if something did, a range of
numbers shrinks to where passing is open, replicates rise where little is known. What was chosen by its results is flown with
another seed, so that it is not judged by them again.
"""

from __future__ import annotations

import math
import os
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import yaml

from bench.documents import read_document, validate_document
from bench.errors import Fault, SetupError
from bench.realization import INACTIVE, Design, DesignFactor, FactorLevel, FullFactorial, Method, Sobol
from bench.reporting import ReportData, factors_that_matter, load_report_data, points_of, quality_of
from bench.statistics import difference_bounds, difficulty_response, factor_columns

from .._document import Campaign
from ..results._finish import read_campaign_folder

NO_EFFECT_P = 0.2
"""A factor goes only where no adjusted p lies below this ..."""
NO_EFFECT_SHARE = 0.01
"""... no share of variance explained above this ..."""
HIDDEN = 0.25
"""... and no difference in confidence between two of its levels as large as this is left open (95 %, each node of each agent)."""
EFFECT_P = 0.05
OPEN = (0.1, 0.9)
"""Chances of passing between which a value of a factor is worth flying."""
WORTH_NARROWING = 0.8
"""A range is narrowed where less than this share of it would be left."""
WIDE = 0.2
"""Width of a 95 % interval of confidence above which more runs are asked for."""
MOST_TIMES = 4
"""Replicates rise at most so many times at once."""
SCREENING = ("one_by_one", "fractional_factorial", "plackett_burman", "definitive_screening")
LEAST_VALUES = 3
"""A factor that was flown at fewer values is not narrowed: between two, only the curve's own shape says where passing turns."""
MOST_WHOLE = 64
"""A full factorial of more points is not proposed after a screening."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """The next campaign, and why: `changes` in sentences (none: the campaign has nothing left to say), `text` the whole file."""

    campaign: Campaign
    changes: tuple[str, ...]
    text: str


def propose_next(folder: Path, beside: Path | None = None) -> Proposal:
    """The next campaign after the one that lies in `folder`, as a file for the folder `beside`, the working folder when absent.

    Raises SetupError when the folder is no campaign, is not finished, or varies nothing.
    """
    place, campaign, _ = read_campaign_folder(folder)
    data = load_report_data(folder)
    _check_finished(folder, campaign, data)
    evidence = _Evidence.of(data, campaign.design)
    factors = [_next_factor(factor, campaign.design, evidence) for factor in campaign.design.factors]
    if not any(one.factor for one in factors):  # without any factor there would be no design
        factors = [
            _Next(one.factor or old, ("nothing follows it, nor any other factor",)) for one, old in _with(factors, campaign)
        ]
    design, reasons = _next_design(campaign.design, [one.factor for one in factors if one.factor], data)
    decomposition = place.decomposition if (folder / campaign.decomposition).is_file() else None
    following = campaign.model_copy(
        update={
            "name": _next_name(campaign.name),
            "design": design,
            "decomposition": os.path.relpath(decomposition, beside or Path.cwd()) if decomposition else campaign.decomposition,
        }
    )
    changes = [f"{old.name}: {one.why[0]}" for one, old in _with(factors, campaign) if one.factor != old]
    changes += [reasons[name] for name in ("method", "replicates", "take") if name in reasons]
    text = _text(following, campaign, factors, reasons)
    read_document(text, Campaign)  # what is proposed can be run
    return Proposal(following, tuple(changes), text)


def _with(factors: Sequence[_Next], campaign: Campaign) -> Iterator[tuple[_Next, DesignFactor]]:
    return zip(factors, campaign.design.factors, strict=True)


def _check_finished(folder: Path, campaign: Campaign, data: ReportData) -> None:
    waiting = sum(run.outcome is None for run in data.runs)
    faults = []
    if not campaign.design.factors:
        faults.append(Fault(str(folder), "varies no factor, so nothing follows for the next design", "give its design factors"))
    if waiting:
        faults.append(Fault(str(folder), f"has {waiting} realizations without a result", "`rebar run` flies them first"))
    elif not data.scores.height:
        faults.append(Fault(str(folder), "has no scores", "`rebar score` makes them"))
    if faults:
        raise SetupError(faults)


@dataclass(frozen=True, slots=True)
class _Evidence:
    """Tests of every factor, and the runs with their levels: `runs` has agent, node, design_point, confidence and passed.

    `hidden` has for each factor what the runs leave open of it, the widest node and agent first; `blurred` the interactions of two that
    cannot be told from its main effect.
    """

    frame: pl.DataFrame
    runs: pl.DataFrame
    levels: Mapping[str, Mapping[str, FactorLevel]]
    hidden: Mapping[str, Sequence[_Hidden]]
    blurred: Mapping[str, Sequence[str]]

    @classmethod
    def of(cls, data: ReportData, design: Design) -> _Evidence:
        levels = {point.id: point.levels for point in points_of(data) or ()}
        rows = data.scores.filter(pl.col("node").is_in(data.study), pl.col("design_point").is_in(list(levels)))
        passed = rows.drop_nulls("confidence").sort("realization").with_columns(passed=pl.col("confidence") >= 1.0)
        runs = passed.select("agent", "node", "design_point", "confidence", "passed")
        quality = quality_of(data)
        blurred = {terms[0]: terms[1:] for one in (quality.aliased if quality else ()) if (terms := one.split(" = "))}
        return cls(factors_that_matter(data).frame, runs, levels, _hidden(runs, levels, design), blurred)

    def rows(self, factor: str) -> list[dict[str, Any]]:
        """Tests of a factor and of its interactions, by analysis of variance and by regression, but for those that came to nothing."""
        mine = self.frame.filter(pl.col("test").is_in(["anova", "logistic"])).iter_rows(named=True)
        return [row for row in mine if factor in row["factor"].split(" x ") and not math.isnan(row["p"] or 0.0)]

    def untested(self, factor: str) -> str:
        """Why not every test of this factor could be made; empty where each was, or had nothing to explain."""
        alone = [row for row in self.rows(factor) if row["factor"] == factor]
        missed = next((row for row in alone if row["p"] is None), None)
        if missed is not None:
            return str(missed["note"] or "it could not be tested")
        if not alone:
            notes = self.frame.filter(pl.col("factor") == "all")["note"].unique().sort().to_list()
            return "; ".join(one for one in notes if one) or "it was not tested"
        return ""

    def followed(self, factor: str, below: float) -> list[dict[str, Any]]:
        return [row for row in self.rows(factor) if row["p_adjusted"] is not None and row["p_adjusted"] < below]

    def explained(self, factor: str) -> Mapping[str, Any] | None:
        """The row in which a factor, or an interaction of it, explains the largest share of variance; None where none does."""
        shares = [row for row in self.rows(factor) if row["effect"] == "omega2" and row["effect_size"] is not None]
        return max(shares, key=lambda row: float(row["effect_size"]), default=None)

    def values(self, factor: str) -> int:
        """At how many values it was flown."""
        return len({levels[factor] for levels in self.levels.values()})

    def open_between(self, factor: str, *, band: bool) -> tuple[float, float] | None:
        """The values of a factor of numbers at which passing is open, over all nodes and agents that follow it.

        By the curve, or by its 95 % band: what is cut off is not flown again, and would not be missed.
        """
        followed = {
            (row["agent"], row["node"]) for row in self.followed(factor, EFFECT_P) if row["of"] in ("confidence", "passes")
        }
        found = [span for agent, node in sorted(followed) if (span := self._open(factor, agent, node, band)) is not None]
        return (min(low for low, _ in found), max(high for _, high in found)) if found else None

    def _open(self, factor: str, agent: str, node: str, band: bool) -> tuple[float, float] | None:
        active = [point for point, levels in self.levels.items() if not isinstance(levels[factor], str)]
        mine = self.runs.filter(pl.col("agent") == agent, pl.col("node") == node, pl.col("design_point").is_in(active))
        x = np.array([float(self.levels[point][factor]) for point in mine["design_point"]])
        passed = mine["passed"].to_numpy().astype(np.float64)
        # The curve is of difficulty, which passing falls with; where passing rises with the factor, its negative stands in.
        turn = -1.0 if float(((x - x.mean()) * (passed - passed.mean())).sum()) > 0.0 else 1.0
        curve = difficulty_response(turn * x, passed, mine["design_point"].to_list())
        low, high = (curve.low, curve.high) if band else (curve.probability, curve.probability)
        within = (high >= OPEN[0]) & (low <= OPEN[1])
        if not within.any():
            return None
        values = turn * curve.difficulty[within]
        return float(values.min()), float(values.max())


@dataclass(frozen=True, slots=True)
class _Hidden:
    """The largest difference that a factor may make to confidence in one node of one agent, as far as its runs tell."""

    agent: str
    node: str
    runs: int
    most: float | None
    """None where the points do not carry the factor beside the others."""

    def told(self) -> str:
        return f"{100 * (self.most or 0.0):.0f} points in {self.node} of {self.agent}"


def _hidden(runs: pl.DataFrame, levels: Mapping[str, Mapping[str, FactorLevel]], design: Design) -> dict[str, list[_Hidden]]:
    """By factor, those that are not carried first, then the widest. What follows by a formula is part of what it follows from."""
    switched = {one.name for one in design.factors if one.when}
    found: dict[str, list[_Hidden]] = {one.name: [] for one in design.factors if one.formula is None}
    active = {
        point: {name: None if name in switched and of[name] == INACTIVE else of[name] for name in found}
        for point, of in levels.items()
    }
    for (agent, node), mine in runs.group_by("agent", "node", maintain_order=True):
        points = mine["design_point"].to_list()
        bounds = difference_bounds(mine["confidence"].to_list(), factor_columns([active[one] for one in points]), points)
        for name, most in bounds.items():
            found[name].append(_Hidden(str(agent), str(node), len(points), most))
    return {name: sorted(each, key=lambda one: -math.inf if one.most is None else -one.most) for name, each in found.items()}


@dataclass(frozen=True, slots=True)
class _Next:
    """A factor as it goes on, None where it goes, and why; the change comes first."""

    factor: DesignFactor | None
    why: tuple[str, ...]


def _next_factor(factor: DesignFactor, design: Design, evidence: _Evidence) -> _Next:
    if factor.formula is not None:
        return _Next(factor, ("follows from others",))
    followed = evidence.followed(factor.name, NO_EFFECT_P)
    blurred = evidence.blurred.get(factor.name, ())
    notes = (f"these points cannot tell it from {', '.join(blurred)}",) if blurred else ()
    missing = evidence.untested(factor.name)
    if missing and not followed:
        return _Next(factor, (f"stays, for it could not be tested everywhere: {missing}", *notes))
    explained = evidence.explained(factor.name)
    if not followed and (explained is None or explained["effect_size"] < NO_EFFECT_SHARE):
        return _without_effect(factor, design, evidence.hidden[factor.name], notes)
    why = tuple(_said(row) for row in sorted(followed, key=lambda row: row["p_adjusted"])[:3])
    if not why and explained is not None:
        why = (
            f"stays: {explained['factor']} explains {explained['effect_size']:.0%} of the variance of {explained['of']} in "
            f"{explained['node']} of {explained['agent']}, though no test is sure of it",
        )
    narrowed = _narrowed(factor, evidence)
    return _Next(narrowed.factor, (*narrowed.why, *why, *notes)) if narrowed else _Next(factor, (*why, *notes))


def _without_effect(factor: DesignFactor, design: Design, hidden: Sequence[_Hidden], notes: tuple[str, ...]) -> _Next:
    """No test found anything: that is worth something where the tests would have."""
    widest = hidden[0]
    if widest.most is None:
        why = (
            f"stays: the runs considered in {widest.node} of {widest.agent} cannot tell it from the other factors, or are too few"
        )
        return _Next(factor, (why, *notes))
    if widest.most > HIDDEN:
        runs = math.ceil(widest.runs * (widest.most / HIDDEN) ** 2)
        why = (
            f"stays: no test is sure that anything follows it, but {widest.runs} runs do not rule out a difference of "
            f"{widest.told()} between its levels (95 %); about {runs} would rule out {100 * HIDDEN:.0f}"
        )
        return _Next(factor, (why, *notes))
    if user := _user(factor.name, design):
        return _Next(factor, (f"nothing follows it, but {user} needs it", *notes))
    fields = ", ".join([*factor.sets, *dict.fromkeys(path for patch in factor.patches.values() for path in patch)])
    why = (
        f"goes: nothing that was tested follows it (no adjusted p below {NO_EFFECT_P:g}), and a difference of more than "
        f"{widest.told()}, the least sure one, is ruled out between its levels (95 %); {fields} stays as the base has it"
    )
    return _Next(None, (why, *notes))


def _said(row: Mapping[str, Any]) -> str:
    p = row["p_adjusted"]
    return f"{row['of']} of {row['node']} of {row['agent']} may follow {row['factor']} ({row['test']}, adjusted p {'< 0.001' if p < 0.001 else f'{p:.3f}'})"


def _user(name: str, design: Design) -> str:
    """What else in the design rests on a factor; empty where nothing does."""
    texts = {f"factor {one.name}": one.formula or one.when for one in design.factors} | {"forbid": " ".join(design.forbid)}
    word = re.compile(rf"(?<![A-Za-z0-9_-]){re.escape(name)}(?![A-Za-z0-9_-])")
    used = next((user for user, text in texts.items() if text and word.search(text)), "")
    return used or ("fidelity" if any(getattr(method, "fidelity", None) == name for method in design.methods) else "")


def _narrowed(factor: DesignFactor, evidence: _Evidence) -> _Next | None:
    """The factor on less of its range, or with what would be cut off if that were sure, and why; None where its range stays."""
    bounds = _bounds(factor) if evidence.values(factor.name) >= LEAST_VALUES else None
    if bounds is None:
        return None
    whole, chance = f"{bounds[0]:g} ... {bounds[1]:g}", f"between {OPEN[0]:.0%} and {OPEN[1]:.0%}"
    changed = _within(factor, bounds, evidence.open_between(factor.name, band=True))
    if changed is not None:
        new = "{:g} ... {:g}".format(*(_bounds(changed) or bounds))
        said = f"from {whole} to {new}: there the chance of passing may lie {chance} (95 % band of a logistic curve)"
        return _Next(changed, (said,))
    by_curve = _within(factor, bounds, evidence.open_between(factor.name, band=False))
    if by_curve is None:
        return None
    new = "{:g} ... {:g}".format(*(_bounds(by_curve) or bounds))
    return _Next(
        factor, (f"stays {whole}: a logistic curve puts the chance of passing {chance} at {new}, but its 95 % band is wider",)
    )


def _within(factor: DesignFactor, bounds: tuple[float, float], span: tuple[float, float] | None) -> DesignFactor | None:
    """The factor on this span; None where that is no less than most of it, or too little."""
    if span is None:
        return None
    low, high = max(bounds[0], span[0]), min(bounds[1], span[1])
    return None if high - low > WORTH_NARROWING * (bounds[1] - bounds[0]) else _on(factor, low, high)


def _bounds(factor: DesignFactor) -> tuple[float, float] | None:
    """The ends of a factor of numbers; None where it is none, or its levels stand for more than their number."""
    if factor.patches:
        return None
    if factor.range is not None:
        return factor.range.low, factor.range.high
    numbers = [float(one) for one in factor.levels if isinstance(one, int | float) and not isinstance(one, bool)]
    return (min(numbers), max(numbers)) if len(numbers) == len(factor.levels) > 1 else None


def _on(factor: DesignFactor, low: float, high: float) -> DesignFactor | None:
    """A factor between two values, with as many levels as it had; None where too few are left."""
    whole = factor.range.integer if factor.range is not None else all(isinstance(one, int) for one in factor.levels)
    low, high = (math.floor(low), math.ceil(high)) if whole else (_short(low), _short(high))
    if high <= low:
        return None
    if factor.range is not None:
        counted = min(factor.range.steps, int(high - low) + 1) if factor.range.steps and whole else factor.range.steps
        return factor.model_copy(
            update={"range": factor.range.model_copy(update={"low": float(low), "high": float(high), "steps": counted})}
        )
    steps = [low + (high - low) * step / (len(factor.levels) - 1) for step in range(len(factor.levels))]
    levels = tuple(dict.fromkeys(round(one) if whole else _short(one) for one in steps))
    return factor.model_copy(update={"levels": levels}) if len(levels) > 1 and all(a < b for a, b in pairwise(levels)) else None


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def _next_design(old: Design, factors: Sequence[DesignFactor], data: ReportData) -> tuple[Design, dict[str, str]]:
    """The design over these factors, and reasons by field."""
    reasons = {"seed": "another one, so that what was chosen by its results is not judged by them again"}
    method, why = _next_method(old, factors)
    if why:
        reasons["method"] = why
    points = (
        method.points if isinstance(method, Sobol) else len(_design(old, factors, method).points()) if not _rated(method) else 0
    )
    replicates, take = old.replicates, method.take if isinstance(method, FullFactorial) else None
    runs, why = _runs_wanted(data)
    per_replicate = points or sum(1 for _ in {run.design_point for run in data.runs})
    wanted = min(math.ceil(runs / per_replicate), MOST_TIMES * old.replicates)
    if wanted > replicates:
        reasons["replicates"] = f"replicates from {replicates} to {wanted}: {why}"
        replicates = wanted
    if take is not None:
        pairs = per_replicate * replicates
        new_take = min(pairs, max(take, runs))
        if new_take != take:
            reasons["take"] = f"take from {take} to {new_take}: {why if new_take > take else 'there are no more pairs'}"
            method = method.model_copy(update={"take": new_take})
    return _design(old, factors, method, replicates=replicates, seed=(old.seed + 1) % 2**63), reasons


def _rated(method: Method) -> bool:
    return method.kind == "stratified"


def _next_method(old: Design, factors: Sequence[DesignFactor]) -> tuple[Method, str]:
    """The old method where it still serves, else one that takes these factors; and why it is another."""
    method = old.method
    if method.kind in SCREENING:
        whole = _size(factors)
        if whole is not None and whole <= MOST_WHOLE:
            return (
                FullFactorial(),
                f"method from {method.kind} to full_factorial: screening is done, and {whole} points are all there are",
            )
        return Sobol(points=32), f"method from {method.kind} to sobol: screening is done, and more points can be added to it"
    if isinstance(method, FullFactorial) and method.take is not None:
        method = method.model_copy(update={"take": None})
    try:
        _design(old, factors, method)
    except SetupError as error:
        return Sobol(points=32), f"method from {method.kind} to sobol: {error.faults[0].what}"
    return old.method, ""


def _size(factors: Sequence[DesignFactor]) -> int | None:
    """Points of the full factorial; None where a range has no steps."""
    free = [one for one in factors if one.formula is None]
    if any(one.range is not None and one.range.steps is None for one in free):
        return None
    return math.prod(len(one.counted()) for one in free)


def _design(old: Design, factors: Sequence[DesignFactor], method: Method, **others: int) -> Design:
    document = {"factors": list(factors), "forbid": old.forbid, "method": method, "replicates": 1, "seed": old.seed, **others}
    return validate_document(document, Design)


def _runs_wanted(data: ReportData) -> tuple[int, str]:
    """Runs of an agent that would narrow the widest interval of confidence to WIDE, which it does with their root; and why."""
    found = [
        (tally.confidence_high - tally.confidence_low, tally)
        for agent in data.agents
        for node in data.study
        if (tally := data.tally(agent, node)) is not None
        and tally.confidence_low is not None
        and tally.confidence_high is not None
    ]
    if not found:
        return 0, ""
    width, widest = max(found, key=lambda one: one[0])
    if width <= WIDE or not widest.considered:
        return 0, ""
    runs = math.ceil(widest.runs * (width / WIDE) ** 2)
    told = f"the 95 % interval of confidence in {widest.node} of {widest.agent} is {100 * width:.0f} points wide over {widest.considered} runs"
    return runs, f"{told}; about {runs} runs would make it {100 * WIDE:.0f}"


def _next_name(name: str) -> str:
    match = re.fullmatch(r"(.*)-next(?:-(\d+))?", name)
    head, number = (match[1], int(match[2] or 1) + 1) if match else (name, 1)
    tail = "-next" if number == 1 else f"-next-{number}"
    return head[: 63 - len(tail)] + tail


def _text(following: Campaign, old: Campaign, factors: Sequence[_Next], reasons: Mapping[str, str]) -> str:
    """The file: what is read and changed first, the base SimSpec last."""
    whole = following.model_dump(mode="json")
    design, base = _stated(whole.pop("design")), whole.pop("base")
    whole["agents"] = [_stated(agent) for agent in whole["agents"]]
    whole["budgets"] = _stated(whole["budgets"])
    head = _comment(
        f"Proposed from the results of {old.name}: a draft to be reviewed, changed and then run. Lines like this one say why; "
        "docs/designs.md says by which rules."
    )
    parts = [head, _yaml(_stated(whole)), "design:\n"]
    for name in ("seed", "replicates", "method", "forbid"):
        if name in design:
            said = [reasons[one] for one in ((name, "take") if name == "method" else (name,)) if one in reasons]
            stated = _stated(design[name]) if name == "method" else design[name]
            parts += [_comment(one, 2) for one in said] + [textwrap.indent(_yaml({name: stated}), "  ")]
    parts.append("  factors:\n")
    shown = iter(design["factors"])
    for one, factor in _with(factors, old):
        parts += [_comment(f"{factor.name}: {why}", 4) for why in one.why]
        parts += [textwrap.indent(_yaml([_stated(next(shown))]), "    ")] if one.factor else []
    return "".join([*parts, _comment("The situation, as it was."), _yaml({"base": base})])


def _stated(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Without fields that are absent, empty or off, which say nothing."""
    whole = {name: _stated(value) if name == "range" else value for name, value in fields.items() if value is not None}
    return {name: value for name, value in whole.items() if value is not False and value not in ([], {}, "")}


def _yaml(value: object) -> str:
    return str(yaml.safe_dump(value, sort_keys=False, allow_unicode=True, width=120))


def _comment(text: str, indent: int = 0) -> str:
    margin = " " * indent + "# "
    return textwrap.fill(text, width=118, initial_indent=margin, subsequent_indent=margin) + "\n"
