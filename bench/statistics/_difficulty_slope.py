"""Whether failure becomes likelier with rated difficulty, over several agents.

A Rasch model in which the difficulty of an item is rated and not estimated: the log odds of failure are an
intercept for each agent (its ability) and a common slope on the rating. Fitted for each key attribute by
itself, the slope is the discrimination of a two-parameter logistic model. Rasch, G. (1960), "Probabilistic
models for some intelligence and attainment tests"; Fischer, G. H. (1973), "The linear logistic test model as
an instrument in educational research", Acta Psychologica 37, 359-374.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from bench.arrays import Bools, Counts, Floats

from . import DIFFICULTY_DECIMALS
from ._anova import cluster_codes
from ._comparison import SIGNIFICANCE
from ._regression import FIRTH, FirthFit, fit_logistic
from ._shuffles import MIN_DESIGN_POINTS, shuffled_p

POINTS_PER_STEP = 10.0
"""Slopes are for this many points of difficulty: an odds ratio for a single point is too close to 1 to read."""

SEPARATED_METHOD = f"{FIRTH}, a design point counts as one run"


class SlopeState(StrEnum):
    """How a fit came out; only the first two have a slope. "One difficulty only" may be one for each agent."""

    FITTED = "fitted"
    # The penalty and not the data keeps the slope finite.
    SEPARATED = "separated"
    NEVER_CONSIDERED = "never considered"
    ONE_DIFFICULTY = "one difficulty only"
    NO_MIXED_AGENT = "no agent both passes and fails"
    TOO_FEW = "too few design points"


class Direction(StrEnum):
    """What the 95 % interval of a slope shows."""

    RISES = "rises"
    FALLS = "falls"
    OPEN = "open"


@dataclass(frozen=True, slots=True)
class AgentAbility:
    """One agent in a fit.

    `even_chance_at` is the difficulty at which it fails every second trial, which may lie outside 0 to 100.
    None where the agent is not in the fit, because it passes or fails every trial or flew one difficulty, and
    where failure does not rise with difficulty.
    """

    agent: str
    trials: int
    failed: int
    even_chance_at: float | None


@dataclass(frozen=True, slots=True)
class DifficultySlope:
    """The slope of failure on rated difficulty, as log odds for 10 points.

    `slope`, `low` and `high` (two-sided 95 %) are None without a fit; `low` or `high` alone is None where
    the interval has no end on that side. `trials` and `design_points` are those in the fit, without agents
    that pass or fail every trial or flew one difficulty: whatever the slope is, their ability can explain
    their results.
    `difficulties` counts those of all agents.
    """

    state: SlopeState
    method: str
    trials: int
    design_points: int
    difficulties: int
    agents: tuple[AgentAbility, ...]
    slope: float | None = None
    low: float | None = None
    high: float | None = None
    p: float | None = None

    @property
    def direction(self) -> Direction:
        """Whether failure rises or falls with difficulty, by the interval and by p; open without a slope."""
        if self.p is None or self.p > SIGNIFICANCE:
            return Direction.OPEN
        if self.low is not None and self.low > 0.0:
            return Direction.RISES
        if self.high is not None and self.high < 0.0:
            return Direction.FALLS
        return Direction.OPEN


def difficulty_slope(
    difficulty: ArrayLike, failed: ArrayLike, agents: Sequence[str], design_points: Sequence[str]
) -> DifficultySlope:
    """Fit failures to the rated difficulty of trials, with an ability for each agent.

    Errors are by design point, over all agents that flew it, with a t quantile. Where difficulty separates
    the passes from the failures, the fit is Firth's, its likelihood is divided by the mean number of trials
    of a design point, as if these agreed wholly, and p is from shuffles of difficulties among design points
    (`shuffled_p`).
    """
    hard: Floats = np.asarray(difficulty, dtype=np.float64).round(DIFFICULTY_DECIMALS)
    fails = np.asarray(failed, dtype=np.bool_)
    names = tuple(dict.fromkeys(agents))
    code = cluster_codes(agents)
    trials = np.bincount(code, minlength=len(names))
    failures = np.bincount(code, weights=fails, minlength=len(names)).astype(np.int64)
    mixed = (failures > 0) & (failures < trials)
    varied = np.array(
        [len(np.unique(hard[code == number])) > 1 for number in range(len(names))], dtype=np.bool_
    )
    in_fit = (mixed & varied)[code]
    points = [point for point, used_trial in zip(design_points, in_fit, strict=True) if used_trial]
    used = np.flatnonzero(mixed & varied)
    empty = DifficultySlope(
        state=_state(hard, bool(mixed.any()), len(used), len(set(points))),
        method="none",
        trials=int(in_fit.sum()),
        design_points=len(set(points)),
        difficulties=len(np.unique(hard)),
        agents=tuple(
            AgentAbility(name, int(count), int(failed), None)
            for name, count, failed in zip(names, trials, failures, strict=True)
        ),
    )
    if empty.state is not SlopeState.FITTED:
        return empty
    # Centred, so that abilities and slope are nearly uncorrelated and Newton's steps stay short.
    centre = float(hard[in_fit].mean())
    x = np.column_stack([code[in_fit][:, None] == used, (hard[in_fit] - centre) / POINTS_PER_STEP]).astype(
        np.float64
    )
    return _fitted(empty, fails[in_fit], x, cluster_codes(points), [names[place] for place in used], centre)


def _fitted(
    empty: DifficultySlope,
    fails: Bools,
    x: Floats,
    clusters: Counts,
    agents: Sequence[str],
    centre: float,
) -> DifficultySlope:
    column = x.shape[1] - 1
    fit = fit_logistic(
        fails.astype(np.float64),
        x,
        clusters,
        is_separated=_separated(fails, x),
        design_effect=len(fails) / empty.design_points,
    )
    is_separated = isinstance(fit, FirthFit)
    # Few design points can be separated by chance, which likelihood ratios of so few do not show.
    p = (
        shuffled_p(x[:, -1], fails, x[:, :-1].argmax(axis=1), clusters)
        if is_separated
        else fit.p(slice(column, column + 1))
    )
    slope = float(fit.beta[column])
    low, high = fit.interval(column)
    if is_separated:
        # The steeper the slope, the likelier such results, so only the penalty could end the interval.
        low, high = (low, np.inf) if slope > 0.0 else (-np.inf, high)
    even = {
        agent: centre - POINTS_PER_STEP * float(intercept) / slope
        for agent, intercept in zip(agents, fit.beta[:column], strict=True)
        if slope > 0.0
    }
    return replace(
        empty,
        state=SlopeState.SEPARATED if is_separated else SlopeState.FITTED,
        method=SEPARATED_METHOD if is_separated else fit.method,
        agents=tuple(replace(ability, even_chance_at=even.get(ability.agent)) for ability in empty.agents),
        slope=slope,
        low=low if np.isfinite(low) else None,
        high=high if np.isfinite(high) else None,
        p=p,
    )


def _separated(fails: Bools, x: Floats) -> bool:
    """Whether each agent has a difficulty that parts its passes from its failures, all in one direction.

    The same as `separated` of these columns, whose linear programme takes 20 s of CPU for 100,000 trials.
    """
    hard = x[:, -1]
    gaps = []
    for agent in x[:, :-1].astype(np.bool_).T:
        passed, failed = hard[agent & ~fails], hard[agent & fails]
        gaps.append((passed.max() <= failed.min(), failed.max() <= passed.min()))
    return any(all(parted) for parted in zip(*gaps, strict=True))


def _state(hard: Floats, any_mixed: bool, agents_in_fit: int, design_points: int) -> SlopeState:
    if not hard.size:
        return SlopeState.NEVER_CONSIDERED
    if len(np.unique(hard)) < 2:
        return SlopeState.ONE_DIFFICULTY
    if not any_mixed:
        return SlopeState.NO_MIXED_AGENT
    if not agents_in_fit:
        return SlopeState.ONE_DIFFICULTY
    # The t quantile of the interval needs more design points than parameters.
    if design_points < max(MIN_DESIGN_POINTS, agents_in_fit + 3):
        return SlopeState.TOO_FEW
    return SlopeState.FITTED
