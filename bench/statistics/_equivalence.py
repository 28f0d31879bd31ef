"""What a factor may still do where no test found it: the difference that runs do not rule out.

A test that finds nothing speaks of the runs as much as of the factor. Here each difference between two levels gets a one-sided bound
of its own; that all of them are below a limit is then as sure as the least sure one (Berger, R. L. (1982), "Multiparameter hypothesis
testing and acceptance sampling", Technometrics 24(4), 295-300), so nothing is adjusted for their number.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ._anova import cluster_codes, clustered_errors, scaled_residuals
from ._terms import FactorColumn, design_matrix, terms_of


def difference_bounds(
    shares: Sequence[float], factors: Sequence[FactorColumn], points: Sequence[str], confidence: float = 0.95
) -> dict[str, float | None]:
    """For each factor the largest difference in the mean share between two of its levels that the runs do not rule out.

    Shares lie in [0, 1]; of a factor that enters as a straight line the ends are its levels. Main effects stand beside each
    other. Errors are clustered by design point (CR2), but no bound is below that of independent runs: replicates are not less alike
    than strangers, and where design points are few they can look so. No bound is below what as many straight passes at a level leave open. None where the design points do not carry the factor: it has one level, goes with others, or they are too few.
    """
    y, clusters = np.asarray(shares, dtype=np.float64), cluster_codes(points)
    terms = terms_of(factors, int(clusters.max()) + 1 if len(y) else 0, interactions=False)
    found: dict[str, float | None] = {one.name: None for one in factors}
    x, places = design_matrix(terms.kept, len(y))
    left = int(clusters.max()) + 1 - x.shape[1] if len(y) else 0
    scaled = scaled_residuals(y, x, clusters) if left > 0 else None
    if scaled is None:
        return found
    weights = np.asarray(np.linalg.pinv(x).T, dtype=np.float64)
    effects, runs_left = weights.T @ y, len(y) - x.shape[1]
    residual, errors = y - x @ effects, clustered_errors(scaled, clusters, weights)
    clustered = errors.T @ errors * float(stats.t.ppf(confidence, left)) ** 2
    alone = weights.T @ weights * float(residual @ residual) / runs_left * float(stats.t.ppf(confidence, runs_left)) ** 2
    shared = {name for kept, others in terms.shared.items() for name in (kept, *others)}
    for factor in factors:
        if factor.name in places and factor.name not in shared:
            apart, at = _contrasts(factor), places[factor.name]
            reach = np.sqrt(np.maximum(*(np.einsum("ij,jk,ik->i", apart, one[at, at], apart) for one in (clustered, alone))))
            bound = float((np.abs(apart @ effects[at]) + reach).max())
            found[factor.name] = min(1.0, max(bound, 1.0 - (1.0 - confidence) ** (1.0 / _runs_per_level(factor))))
    return found


def _contrasts(factor: FactorColumn) -> NDArray[np.float64]:
    """(differences, degrees of freedom): each two levels, or the two ends of a straight line."""
    columns = factor.contrasts()[factor.active]
    if factor.is_line:
        return np.array([[np.ptp(columns)]])
    first = [columns[int(np.flatnonzero(factor.codes() == code)[0])] for code in range(len(factor.levels))]
    return np.array([one - other for one, other in itertools.combinations(first, 2)])


def _runs_per_level(factor: FactorColumn) -> int:
    """Runs at the level that has the fewest; a third of them at an end of a straight line."""
    return max(1, int(factor.active.sum()) // 3) if factor.is_line else int(np.bincount(factor.codes()).min())
