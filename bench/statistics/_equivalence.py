"""Equivalence bounds: the largest effect of a factor that the runs do not rule out.

A test that finds nothing may say as much about the number of runs as about the factor. Here each difference
between two levels gets its own one-sided bound. The claim that all of them are below a limit is as sure as
the least sure one (Berger, R. L. (1982), "Multiparameter hypothesis testing and acceptance sampling",
Technometrics 24(4), 295-300), so their number needs no adjustment.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy import stats

from bench.arrays import Floats

from ._anova import cluster_codes, clustered_errors, scaled_residuals
from ._firth import variances
from ._terms import FactorColumn, design_matrix, terms_of


def difference_bounds(
    shares: Sequence[float], factors: Sequence[FactorColumn], points: Sequence[str], confidence: float = 0.95
) -> dict[str, float | None]:
    """For each factor the largest difference in the mean share between two of its levels that the runs do not rule out.

    Shares lie in [0, 1]; for a factor that enters as a straight line its two ends are compared. The model has
    main effects only. Errors are clustered by design point (CR2). No bound is below that of independent runs,
    because replicates of few design points can look less alike than strangers by chance, and none is below
    what as many straight passes at a level leave open. None where the design points do not carry the factor:
    it has one level, is aliased with others, or the points are too few.
    """
    y, clusters = np.asarray(shares, dtype=np.float64), cluster_codes(points)
    terms = terms_of(factors, int(clusters.max()) + 1 if len(y) else 0, interactions=False)
    bounds: dict[str, float | None] = dict.fromkeys(factor.name for factor in factors)
    x, columns = design_matrix(terms.carried, len(y))
    residual_df = int(clusters.max()) + 1 - x.shape[1] if len(y) else 0
    scaled = scaled_residuals(y, x, clusters) if residual_df > 0 else None
    if scaled is None:
        return bounds
    weights = np.asarray(np.linalg.pinv(x).T, dtype=np.float64)
    effects, runs_left = weights.T @ y, len(y) - x.shape[1]
    residual, errors = y - x @ effects, clustered_errors(scaled, clusters, weights)
    clustered = errors.T @ errors * float(stats.t.ppf(confidence, residual_df)) ** 2
    variance = float(residual @ residual) / runs_left
    unclustered = weights.T @ weights * variance * float(stats.t.ppf(confidence, runs_left)) ** 2
    aliased = {name for term, others in terms.shared.items() for name in (term, *others)}
    for factor in factors:
        if factor.name in columns and factor.name not in aliased:
            contrasts, part = _contrasts(factor), columns[factor.name]
            squares = [variances(contrasts, squared[part, part]) for squared in (clustered, unclustered)]
            half_width = np.sqrt(np.maximum(*squares))
            bound = float((np.abs(contrasts @ effects[part]) + half_width).max())
            least = 1.0 - (1.0 - confidence) ** (1.0 / _runs_per_level(factor))
            bounds[factor.name] = min(1.0, max(bound, least))
    return bounds


def _contrasts(factor: FactorColumn) -> Floats:
    """Contrasts as (differences, degrees of freedom): every two levels, or the two ends of a straight line."""
    columns = factor.contrasts()[factor.active]
    if factor.is_line:
        return np.array([[np.ptp(columns)]])
    _, first = np.unique(factor.codes(), return_index=True)
    return np.array([one - other for one, other in itertools.combinations(columns[first], 2)])


def _runs_per_level(factor: FactorColumn) -> int:
    """Runs at the level that has the fewest; a third of all active runs stands for an end of a straight line."""
    return max(1, int(factor.active.sum()) // 3) if factor.is_line else int(np.bincount(factor.codes()).min())
