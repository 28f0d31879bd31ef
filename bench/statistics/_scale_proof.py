"""Whether a scale of difficulty predicts: does it order the failing runs of an agent above its passing ones?

The area under the curve (AUC) is over pairs of runs of the same agent: 0.5 is chance. Hanley, J. A. and McNeil,
B. J. (1982), "The meaning and use of the area under a receiver operating characteristic (ROC) curve", Radiology
143, 29-36. Its interval is a bootstrap over design points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from bench.arrays import Bools, Counts, Floats

from ._anova import cluster_codes
from ._difficulty_slope import DifficultySlope, difficulty_slope
from ._intervals import clopper_pearson
from ._item_response import fit_abilities

MIN_OUTCOMES = 30
"""Failures, and passes, below which nothing is shown."""
MIN_AUC = 0.75
MAX_GAP = 0.10
"""Between predicted and observed failure in a bin."""
BINS = 5
RESAMPLES = 500


@dataclass(frozen=True, slots=True)
class Bin:
    """A fifth of the trials by predicted failure."""

    trials: int
    predicted: float
    observed: float

    @property
    def gap(self) -> float:
        return abs(self.predicted - self.observed)

    def is_off(self) -> bool:
        """Whether the 95 % interval of what was observed lies beyond the allowed gap."""
        low, high = clopper_pearson(round(self.observed * self.trials), self.trials)
        return bool(low > self.predicted + MAX_GAP or high < self.predicted - MAX_GAP)


@dataclass(frozen=True, slots=True)
class ScaleProof:
    """One node's scale against outcomes. `auc` and its ends are None where no agent both passes and fails.

    `reason` says why nothing is claimed on this scale; empty where the scale holds.
    """

    trials: int
    failures: int
    auc: float | None
    auc_low: float | None
    auc_high: float | None
    slope: DifficultySlope
    bins: tuple[Bin, ...]

    @property
    def reason(self) -> str:
        passes = self.trials - self.failures
        if self.failures < MIN_OUTCOMES:
            return f"{self.failures} failures in {self.trials} runs"
        if passes < MIN_OUTCOMES:
            return f"{passes} passes in {self.trials} runs"
        if self.slope.low is None or self.slope.low <= 0.0:
            return "failure was not shown to rise with it"
        if self.auc is None or self.auc < MIN_AUC:
            return f"AUC below {MIN_AUC:g}"
        if any(part.is_off() for part in self.bins):
            return f"predicted failure is off by more than {MAX_GAP:.0%}"
        return ""


def prove_scale(
    difficulty: Floats,
    log_odds: Floats,
    failed: Bools,
    agents: Sequence[str],
    points: Sequence[str],
    *,
    seed: int = 0,
) -> ScaleProof:
    """Test the difficulties of trials, and the log odds of failure that they stand for, against outcomes."""
    agent, point = cluster_codes(agents), cluster_codes(points)
    auc = within_agent_auc(difficulty, failed, agent)
    rng = np.random.default_rng(seed)
    members = [np.flatnonzero(point == number) for number in range(int(point.max(initial=-1)) + 1)]
    resampled = [
        value
        for _ in range(RESAMPLES if auc is not None else 0)
        if (rows := np.concatenate([members[k] for k in rng.integers(len(members), size=len(members))])).size
        and (value := within_agent_auc(difficulty[rows], failed[rows], agent[rows])) is not None
    ]
    low, high = np.quantile(resampled, [0.025, 0.975]) if resampled else (None, None)
    return ScaleProof(
        len(failed),
        int(failed.sum()),
        auc,
        None if low is None else float(low),
        None if high is None else float(high),
        difficulty_slope(difficulty, failed, agents, points),
        _bins(log_odds, failed, agent) if len(failed) else (),
    )


def within_agent_auc(difficulty: Floats, failed: Bools, agents: Counts) -> float | None:
    """Share of pairs of a failed and a passed trial of one agent in which the failed one is harder; ties are a half.

    None where no agent has such a pair.
    """
    right = pairs = 0.0
    for agent in np.unique(agents):
        hard, easy = difficulty[(agents == agent) & failed], difficulty[(agents == agent) & ~failed]
        difference = hard[:, None] - easy[None, :]
        right += float((difference > 0.0).sum()) + 0.5 * float((difference == 0.0).sum())
        pairs += difference.size
    return right / pairs if pairs else None


def _bins(log_odds: Floats, failed: Bools, agents: Counts) -> tuple[Bin, ...]:
    ability = fit_abilities(failed.astype(np.float64), agents, log_odds)
    predicted = expit(ability[agents] + log_odds)
    parts = np.array_split(np.argsort(predicted, kind="stable"), BINS)
    return tuple(
        Bin(len(rows), float(predicted[rows].mean()), float(failed[rows].mean()))
        for rows in parts
        if len(rows)
    )
