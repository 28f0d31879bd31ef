"""Analysis of variance of one node's scores (or confidences) over the factors of a design.

Sums of squares are of type II: each term is tested beside all others that do not contain it. Designs of
campaigns are balanced or nearly so (a `take` leaves cells short), for which type II has more power than type
III and does not depend on how levels are coded; type III would test a main effect in a model that keeps its
interactions without it.

Where replicates share a design point, the test is a Wald test with errors clustered by design point, with the
small-sample correction CR2 and Hotelling's reference distribution on as many degrees of freedom as the design
points leave. Over seeds without an effect it errs in 4 to 8 of 100; plain cluster errors (CR1) find far more
and the jackknife (CR3) hardly any. CR2: Bell, R. M. and McCaffrey, D. F. (2002), Survey Methodology 28(2),
169-181; Pustejovsky, J. E. and Tipton, E. (2018), Journal of Business and Economic Statistics 36(4), 672-683.
Omega squared: Olejnik, S. and Algina, J. (2003), Psychological Methods 8(4), 434-447.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from bench.arrays import Counts, Floats

from ._terms import (
    FactorColumn,
    FactorIndependence,
    OmittedTerm,
    Term,
    Terms,
    design_matrix,
    independence,
    terms_of,
)

# Below this share of the total sum of squares a residual is rounding: float64 carries squares to about 1e-32.
NEGLIGIBLE_SHARE = 1e-20
MAX_WHOLE_CLUSTER = 100
"""Runs of one design point up to which its whole matrix is decomposed, as published results were. Chosen."""
CLUSTERED = "OLS type II, errors by design point (CR2)"
PLAIN = "OLS type II"
# scipy documents its p value of Shapiro-Wilk as accurate up to 5000 values.
MAX_SHAPIRO_VALUES = 5000


@dataclass(frozen=True, slots=True)
class Effect:
    """One term: `omega2` is its share of the total sum of squares minus the share due to chance, at least 0.

    `f` and `p` are None where nothing is left to test against; `note` says why, or names the terms that it is
    aliased with.
    """

    term: str
    df: int
    sum_sq: float
    f: float | None
    p: float | None
    omega2: float | None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Anova:
    """The analysis of one node, with checks of its assumptions.

    `normal_p` (Shapiro-Wilk) and `equal_spread_p` (Breusch-Pagan) test the residuals; None where they cannot
    be computed. A small one means that the p values are rough. `note` says why there are no effects and is
    empty otherwise.
    """

    n: int
    points: int
    method: str
    effects: tuple[Effect, ...]
    left_out: tuple[OmittedTerm, ...]
    independence: FactorIndependence
    normal_p: float | None = None
    equal_spread_p: float | None = None
    note: str = ""


def anova(
    values: Sequence[float] | Floats,
    factors: Sequence[FactorColumn],
    points: Sequence[str],
    *,
    interactions: bool = True,
) -> Anova:
    """Test which factors the values follow. `points` names the design point of each run; runs that share one
    are not independent.

    Never raises for terms that the design cannot carry: they are listed in `left_out`.
    """
    y = np.asarray(values, dtype=np.float64)
    clusters = cluster_codes(points)
    count = int(clusters.max()) + 1 if len(clusters) else 0
    terms = terms_of(factors, count, interactions=interactions)
    method = CLUSTERED if count < len(y) else PLAIN
    empty = Anova(len(y), count, method, (), terms.left_out, independence(factors))
    parameters = 1 + sum(term.df for term in terms.carried)
    if not len(y):
        return replace(empty, note="no run has a value")
    if not terms.carried:
        return replace(empty, note="no factor varies")
    if count <= parameters:
        return replace(empty, note=f"{count} design points are too few for {parameters} parameters")
    if float(np.ptp(y)) <= 1e-12 * max(1.0, float(np.abs(y).max())):
        return replace(empty, note="every value is the same")
    return _with_effects(y, clusters, count, terms, empty)


def _with_effects(y: Floats, clusters: Counts, count: int, terms: Terms, empty: Anova) -> Anova:
    full, _ = design_matrix(terms.carried, len(y))
    residual = y - full @ _coefficients(full, y)
    total, residual_ss = float(((y - y.mean()) ** 2).sum()), float((residual**2).sum())
    exact = residual_ss <= NEGLIGIBLE_SHARE * total
    variance = None if exact else residual_ss / (len(y) - full.shape[1])
    residuals_cr2 = None if exact or count == len(y) else scaled_residuals(y, full, clusters)
    tester = _EffectTester(
        y, clusters, terms, count - full.shape[1], total, variance, count < len(y), residuals_cr2
    )
    return replace(
        empty,
        effects=tuple(tester.effect(term) for term in terms.carried),
        normal_p=None if exact else _normality_p(residual),
        equal_spread_p=None if exact else _equal_spread_p(residual, full),
        note="the factors determine every value; nothing is left to test against" if exact else "",
    )


@dataclass(frozen=True, slots=True)
class _EffectTester:
    """Tests one term after another on the same runs.

    `variance` is None where the factors determine every value.
    """

    y: Floats
    clusters: Counts
    terms: Terms
    points_left: int
    total: float
    variance: float | None
    clustered: bool
    residuals_cr2: Floats | None

    def effect(self, term: Term) -> Effect:
        # Type II: the other terms are those that do not contain this one.
        remaining_terms = [
            other for other in self.terms.carried if not set(term.factors) <= set(other.factors)
        ]
        full, columns = design_matrix([*remaining_terms, term], len(self.y))
        reduced, _ = design_matrix(remaining_terms, len(self.y))
        sum_sq = max(0.0, _residual_ss(reduced, self.y) - _residual_ss(full, self.y))
        note = self.terms.note(term.name)
        if self.variance is None:
            return Effect(term.name, term.df, sum_sq, None, None, None, note)
        f, p = (
            self._clustered(term, full, columns[term.name])
            if self.clustered
            else self._plain(term, sum_sq, self.variance)
        )
        if p is None:
            note = "; ".join(filter(None, (note, "too few design points to test it")))
        omega2 = max(0.0, (sum_sq - term.df * self.variance) / (self.total + self.variance))
        return Effect(term.name, term.df, sum_sq, f, p, omega2, note)

    def _plain(self, term: Term, sum_sq: float, variance: float) -> tuple[float, float]:
        f = sum_sq / term.df / variance
        return f, float(stats.f.sf(f, term.df, self.points_left))

    def _clustered(self, term: Term, x: Floats, columns: slice) -> tuple[float | None, float | None]:
        denominator_df = self.points_left - term.df + 1
        if self.residuals_cr2 is None or denominator_df < 1:
            return None, None
        weights = np.asarray(np.linalg.pinv(x)[columns].T, dtype=np.float64)
        errors, estimates = clustered_errors(self.residuals_cr2, self.clusters, weights), weights.T @ self.y
        f = (
            float(estimates @ np.linalg.pinv(errors.T @ errors) @ estimates)
            / term.df
            * denominator_df
            / self.points_left
        )
        return f, float(stats.f.sf(f, term.df, denominator_df))


def scaled_residuals(y: Floats, x: Floats, clusters: Counts) -> Floats | None:
    """Residuals of the regression on `x`, scaled up to undo the leverage of each run's cluster (CR2).

    None where a single cluster determines a coefficient.
    """
    residual = y - x @ _coefficients(x, y)
    bread = np.asarray(np.linalg.pinv(x.T @ x), dtype=np.float64)
    scaled = np.empty_like(residual)
    for cluster in range(int(clusters.max()) + 1):
        members = clusters == cluster
        part = _scaled_cluster(residual[members], x[members], bread)
        if part is None:
            return None
        scaled[members] = part
    return scaled


def _scaled_cluster(residual: Floats, x: Floats, bread: Floats) -> Floats | None:
    """The residuals of one cluster times (1 - X B X') to the power -1/2; None where that is singular.

    Of a large cluster only the span of X is looked at: whatever is orthogonal to it stays as it is. The time then grows with
    the number of runs, and not with its cube.
    """
    if len(x) <= MAX_WHOLE_CLUSTER:
        eigenvalues, eigenvectors = np.linalg.eigh(np.eye(len(x)) - x @ bread @ x.T)
    else:
        basis, triangle = np.linalg.qr(x)
        eigenvalues, rotation = np.linalg.eigh(np.eye(x.shape[1]) - triangle @ bread @ triangle.T)
        eigenvectors = basis @ rotation
    # A zero eigenvalue means leverage 1: the residuals of this cluster are zero whatever happened in it.
    if eigenvalues[0] < 1e-9:
        return None
    inside = eigenvectors.T @ residual
    scaled = eigenvectors @ (inside / np.sqrt(eigenvalues))
    if len(x) > MAX_WHOLE_CLUSTER:
        scaled += residual - eigenvectors @ inside
    return np.asarray(scaled, dtype=np.float64)


def clustered_errors(scaled: Floats, clusters: Counts, weights: Floats) -> Floats:
    """The contribution of each cluster to the error of the estimates `weights.T @ y`: one row a cluster; the
    crossproduct is CR2.

    With clusters of one run each and the weights of the regression this is MacKinnon and White's HC2.
    """
    errors = np.zeros((int(clusters.max()) + 1, weights.shape[1]))
    np.add.at(errors, clusters, weights * scaled[:, None])
    return errors


def _normality_p(residual: Floats) -> float | None:
    """Shapiro-Wilk over the first MAX_SHAPIRO_VALUES residuals; None below 3, where it is not defined."""
    return float(stats.shapiro(residual[:MAX_SHAPIRO_VALUES]).pvalue) if len(residual) >= 3 else None


def _equal_spread_p(residual: Floats, x: Floats) -> float | None:
    """Breusch-Pagan after Koenker; None where all residuals have the same size."""
    squares = residual**2
    if np.ptp(squares) <= 1e-12 * float(squares.max(initial=0.0)):
        return None
    share = 1.0 - _residual_ss(x, squares) / float(((squares - squares.mean()) ** 2).sum())
    return float(stats.chi2.sf(len(x) * max(0.0, share), x.shape[1] - 1))


def cluster_codes(points: Sequence[str]) -> Counts:
    """The design point of each run as a number from 0, in the order of first appearance."""
    codes = {point: number for number, point in enumerate(dict.fromkeys(points))}
    return np.array([codes[point] for point in points], dtype=np.int64)


def _coefficients(x: Floats, y: Floats) -> Floats:
    return np.asarray(np.linalg.lstsq(x, y, rcond=None)[0], dtype=np.float64)


def _residual_ss(x: Floats, y: Floats) -> float:
    return float(((y - x @ _coefficients(x, y)) ** 2).sum())
