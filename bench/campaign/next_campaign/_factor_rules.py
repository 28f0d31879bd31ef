"""The rules for each factor of the next campaign: it is removed, narrowed, or stays, with the reasons."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from bench.realization import Design, DesignFactor

from ._factor_evidence import UNDECIDED_PASS_RATES, FactorEvidence, OpenDifference

# Removing a factor that matters costs more than flying one that does not, so a factor is removed only if all
# three hold.
NO_EFFECT_P = 0.2
"""No adjusted p is below this."""

NO_EFFECT_SHARE = 0.01
"""No test explains a larger share of variance."""

MAX_OPEN_DIFFERENCE = 0.25
"""No larger difference in confidence between two levels is left open, at 95 %, in any node of any agent."""

NARROWING_SHARE = 0.8
"""A range is narrowed only if less than this share of it would be left. Chosen, not measured."""

MIN_VALUES = 3
"""A factor flown at fewer values is not narrowed: between two, only the curve's shape would say where passing turns."""


@dataclass(frozen=True, slots=True)
class FactorProposal:
    """A factor of the next campaign, None if it is removed, with the reasons.

    The first reason is about the change.
    """

    factor: DesignFactor | None
    reasons: tuple[str, ...]


def propose_factor(factor: DesignFactor, design: Design, evidence: FactorEvidence) -> FactorProposal:
    """What becomes of a factor after a campaign with this design and this evidence."""
    if factor.formula is not None:
        return FactorProposal(factor, ("follows from other factors",))
    if factor.chooses_base:
        return FactorProposal(
            factor, ("stays: which situations a campaign is about is for a person to decide",)
        )
    effects = evidence.effects(factor.name, NO_EFFECT_P)
    aliases = evidence.aliases.get(factor.name, ())
    notes = (f"these design points cannot separate it from {', '.join(aliases)}",) if aliases else ()
    untested = evidence.untested(factor.name)
    if untested and not effects:
        return FactorProposal(factor, (f"stays: it could not be tested everywhere: {untested}", *notes))
    largest = evidence.largest_share(factor.name)
    if not effects and (largest is None or largest["effect_size"] < NO_EFFECT_SHARE):
        return _without_effect(factor, design, evidence.open_differences[factor.name], notes)
    reasons = tuple(_effect_text(row) for row in sorted(effects, key=lambda row: row["p_adjusted"])[:3])
    if not reasons and largest is not None:
        reasons = (
            f"stays: {largest['factor']} explains {largest['effect_size']:.0%} of the variance of {largest['of']} in "
            f"{largest['node']} of {largest['agent']}, although no test is significant",
        )
    narrowed = _narrowed(factor, evidence)
    if narrowed is None:
        return FactorProposal(factor, (*reasons, *notes))
    return FactorProposal(narrowed.factor, (*narrowed.reasons, *reasons, *notes))


def _without_effect(
    factor: DesignFactor, design: Design, open_differences: Sequence[OpenDifference], notes: tuple[str, ...]
) -> FactorProposal:
    """A factor for which no test found an effect. That is evidence only if the tests could have found one."""
    largest = open_differences[0]
    if largest.difference is None:
        reason = (
            f"stays: the runs considered in {largest.node} of {largest.agent} cannot separate it from the other factors, "
            "or are too few"
        )
        return FactorProposal(factor, (reason, *notes))
    if largest.difference > MAX_OPEN_DIFFERENCE:
        # The width of an interval falls with the root of the number of runs.
        runs = math.ceil(largest.runs * (largest.difference / MAX_OPEN_DIFFERENCE) ** 2)
        reason = (
            f"stays: no test shows an effect, but {largest.runs} runs do not rule out a difference of "
            f"{largest.text()} between its levels (95 %); about {runs} would rule out {100 * MAX_OPEN_DIFFERENCE:.0f}"
        )
        return FactorProposal(factor, (reason, *notes))
    if user := _user(factor.name, design):
        return FactorProposal(factor, (f"stays: no test shows an effect, but {user} needs it", *notes))
    fields = ", ".join(
        [*factor.sets, *dict.fromkeys(path for patch in factor.patches.values() for path in patch)]
    )
    reason = (
        f"removed: no test shows an effect (no adjusted p below {NO_EFFECT_P:g}), and a difference of more than "
        f"{largest.text()}, the least certain one, is ruled out between its levels (95 %); {fields} keeps the value of the base"
    )
    return FactorProposal(None, (reason, *notes))


def _effect_text(row: Mapping[str, Any]) -> str:
    p = "< 0.001" if row["p_adjusted"] < 0.001 else f"{row['p_adjusted']:.3f}"
    return f"{row['of']} of {row['node']} of {row['agent']} may follow {row['factor']} ({row['test']}, adjusted p {p})"


def _user(name: str, design: Design) -> str:
    """What else in the design uses a factor. Empty if nothing does."""
    texts = {f"factor {factor.name}": factor.formula or factor.when for factor in design.factors}
    texts["forbid"] = " ".join(design.forbid)
    # Names of factors may contain a hyphen, at which \b would end the word.
    word = re.compile(rf"(?<![A-Za-z0-9_-]){re.escape(name)}(?![A-Za-z0-9_-])")
    used = next((user for user, text in texts.items() if text and word.search(text)), "")
    return used or (
        "fidelity" if any(getattr(method, "fidelity", None) == name for method in design.methods) else ""
    )


def _narrowed(factor: DesignFactor, evidence: FactorEvidence) -> FactorProposal | None:
    """The factor on less of its range, or with a note on what the curve alone would cut off.

    None if neither applies.
    """
    bounds = _bounds(factor) if evidence.value_count(factor.name) >= MIN_VALUES else None
    if bounds is None:
        return None
    whole = f"{bounds[0]:g} ... {bounds[1]:g}"
    rates = f"between {UNDECIDED_PASS_RATES[0]:.0%} and {UNDECIDED_PASS_RATES[1]:.0%}"
    by_band = _within(factor, bounds, evidence.undecided_range(factor.name, by_band=True))
    if by_band is not None:
        narrowed = "{:g} ... {:g}".format(*(_bounds(by_band) or bounds))
        reason = (
            f"from {whole} to {narrowed}: the pass rate may be {rates} there (95 % band of a logistic curve)"
        )
        return FactorProposal(by_band, (reason,))
    by_curve = _within(factor, bounds, evidence.undecided_range(factor.name, by_band=False))
    if by_curve is None:
        return None
    narrowed = "{:g} ... {:g}".format(*(_bounds(by_curve) or bounds))
    reason = f"stays {whole}: a logistic curve puts the pass rate {rates} at {narrowed}, but its 95 % band is wider"
    return FactorProposal(factor, (reason,))


def _within(
    factor: DesignFactor, bounds: tuple[float, float], undecided: tuple[float, float] | None
) -> DesignFactor | None:
    """The factor on the undecided part of its range.

    None if that is most of the range, or too little for a factor.
    """
    if undecided is None:
        return None
    low, high = max(bounds[0], undecided[0]), min(bounds[1], undecided[1])
    return None if high - low > NARROWING_SHARE * (bounds[1] - bounds[0]) else _between(factor, low, high)


def _bounds(factor: DesignFactor) -> tuple[float, float] | None:
    """Lowest and highest value of a numeric factor.

    None for other factors, and if its levels stand for patches.
    """
    if factor.patches:
        return None
    if factor.range is not None:
        return factor.range.low, factor.range.high
    # A boolean is an int to Python, and no quantity.
    numbers = [
        float(level)
        for level in factor.levels
        if isinstance(level, int | float) and not isinstance(level, bool)
    ]
    return (min(numbers), max(numbers)) if len(numbers) == len(factor.levels) > 1 else None


def _between(factor: DesignFactor, low: float, high: float) -> DesignFactor | None:
    """A factor between two values, with as many levels as before. None if too few are left."""
    integer = (
        factor.range.integer
        if factor.range is not None
        else all(isinstance(level, int) for level in factor.levels)
    )
    low, high = (math.floor(low), math.ceil(high)) if integer else (_rounded(low), _rounded(high))
    if high <= low:
        return None
    if factor.range is not None:
        steps = factor.range.steps
        # No more steps than there are whole numbers between the ends.
        counted = min(steps, int(high - low) + 1) if steps and integer else steps
        return factor.model_copy(
            update={
                "range": factor.range.model_copy(
                    update={"low": float(low), "high": float(high), "steps": counted}
                )
            }
        )
    values = [low + (high - low) * step / (len(factor.levels) - 1) for step in range(len(factor.levels))]
    levels = tuple(dict.fromkeys(round(value) if integer else _rounded(value) for value in values))
    return (
        factor.model_copy(update={"levels": levels})
        if len(levels) > 1 and all(a < b for a, b in pairwise(levels))
        else None
    )


def _rounded(value: float) -> float:
    """Four digits, as a person would write into a campaign."""
    return float(f"{value:.4g}")
