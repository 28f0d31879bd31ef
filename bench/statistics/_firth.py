"""The maximum of Firth's penalised likelihood of a logistic regression, which is finite where passes and failures are
separated too.

Firth, D. (1993), "Bias reduction of maximum likelihood estimates", Biometrika 80(1), 27-38.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Floats

# With more distinct rows the curvature leaves out the squared hat matrix, whose share falls with the number of rows and whose
# size is its square: steps are a little worse, the maximum is the same.
MAX_HAT_ROWS = 1000


@dataclass(frozen=True, slots=True)
class DistinctRows:
    """The runs of a regression by distinct rows of its columns: how many runs have each, and how many of them passed.

    Replicates share their row, so a fit costs what its design points cost, however many runs there are.
    """

    x: Floats
    count: Floats
    passes: Floats

    @staticmethod
    def of(y: Floats, x: Floats) -> DistinctRows:
        """Group runs: y (runs,) is 0 or 1, x (runs, columns)."""
        rows, group, count = np.unique(x, axis=0, return_inverse=True, return_counts=True)
        passes = np.bincount(group.ravel(), weights=y).astype(np.float64)
        return DistinctRows(rows, count.astype(np.float64), passes)


def maximize(
    rows: DistinctRows, start: Floats, free: Bools, design_effect: float = 1.0
) -> tuple[Floats, float]:
    """The maximum of Firth's penalised likelihood over the free coefficients, by Newton steps with step halving."""
    beta, value = start.copy(), _penalized_likelihood(rows, start, design_effect)
    for _ in range(200):
        slope, curvature, information = _derivatives(rows, beta, design_effect)
        step = np.zeros_like(beta)
        step[free] = _ascent(slope[free], curvature[np.ix_(free, free)], information[np.ix_(free, free)])
        step *= min(1.0, 5.0 / max(float(np.abs(step).max()), 1e-300))
        for _ in range(30):
            if (new := _penalized_likelihood(rows, beta + step, design_effect)) >= value - 1e-13:
                break
            step /= 2
        beta, gain, value = beta + step, new - value, new
        if float(np.abs(step).max()) < 1e-9 or (
            abs(gain) < 1e-13 and float(np.abs(slope[free]).max(initial=0.0)) < 1e-7
        ):
            break
    return beta, value


def _ascent(slope: Floats, curvature: Floats, information: Floats) -> Floats:
    """Newton's step, or Fisher's scoring where the penalised likelihood is not concave."""
    try:
        np.linalg.cholesky(curvature)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(information) @ slope, dtype=np.float64)
    return np.asarray(np.linalg.solve(curvature, slope), dtype=np.float64)


def _inverse(information: Floats) -> Floats:
    try:
        scales = np.linalg.cholesky(information).diagonal()
    except np.linalg.LinAlgError:
        scales = np.zeros(1)
    # The squares of these scales bound the condition from below; beyond 1e12 rounding would decide.
    if scales.min() <= 1e-6 * scales.max():
        return np.asarray(np.linalg.pinv(information, hermitian=True), dtype=np.float64)
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def _derivatives(rows: DistinctRows, beta: Floats, design_effect: float) -> tuple[Floats, Floats, Floats]:
    """Slope of the penalised likelihood, its curvature (second derivatives with their sign turned), and the
    information, which is the curvature without the penalty.

    With W the diagonal of `weight`, H the hat matrix of W^(1/2) X and T the diagonal of `skew`, which is
    1 - 2 p, the penalty k/2 log|X'WX| has the slope k/2 X'T diag(H) and the curvature
    k X'(diag(H) (W - T^2 / 2) + T (H * H) T / 2) X, * by elements. Each sum over runs is one over distinct rows, which
    count as often as they occur.
    """
    x, count = rows.x, rows.count
    chance = probability(x @ beta)
    weight, skew = chance * (1 - chance), 1 - 2 * chance
    root = x * np.sqrt(weight)[:, None]
    information = (root * count[:, None]).T @ root
    half = root @ _inverse(information)
    leverage = (half * root).sum(axis=1)
    slope = x.T @ (rows.passes - count * chance + design_effect * count * leverage * skew / 2)
    diagonal = count * (weight + design_effect * leverage * (weight - skew**2 / 2))
    curvature = (x * diagonal[:, None]).T @ x
    if len(count) <= MAX_HAT_ROWS:
        skewed = x * (count * skew)[:, None]
        curvature += design_effect / 2 * skewed.T @ (half @ root.T) ** 2 @ skewed
    return slope, curvature, information


def _penalized_likelihood(rows: DistinctRows, beta: Floats, design_effect: float) -> float:
    """Where k rows count as one, their likelihood is divided by k; multiplied by k, so that rows keep their
    weight, that is a penalty of k times its usual size.
    """
    line = rows.x @ beta
    chance = probability(line)
    weight = rows.count * chance * (1 - chance)
    sign, size = np.linalg.slogdet((rows.x * weight[:, None]).T @ rows.x)
    if sign <= 0:
        return -np.inf
    return float(
        (rows.passes * line - rows.count * np.logaddexp(0.0, line)).sum() + 0.5 * design_effect * size
    )


def information(x: Floats, beta: Floats) -> Floats:
    """Fisher's information (columns, columns) of a logistic regression on x (runs, columns)."""
    chance = probability(x @ beta)
    return np.asarray((x * (chance * (1 - chance))[:, None]).T @ x, dtype=np.float64)


def variances(combinations: Floats, covariance: Floats) -> Floats:
    """(n,) variances of linear combinations (n, coefficients) of estimates with this covariance."""
    return np.asarray(np.einsum("ij,jk,ik->i", combinations, covariance, combinations), dtype=np.float64)


def probability(line: Floats) -> Floats:
    """Chances of passing at these logits; beyond 500 no float tells them from 0 or 1."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(line, -500.0, 500.0))))
