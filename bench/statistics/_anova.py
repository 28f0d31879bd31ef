"""Analysis of variance of one node's scores (or confidences) over the factors of a design.

Sums of squares are of type II: each term is tested beside all others that do not contain it. Designs of campaigns are
balanced or nearly so (a `take` leaves cells short), for which type II has more power than type III and does not depend on how
levels are coded; type III would test a main effect as if its interactions were there without it.

Where replicates share a design point, the test is a Wald test with errors clustered by design point, with the small-sample
correction CR2 and Hotelling's reference distribution on as many degrees of freedom as the design points leave. Over seeds without
an effect it errs in 4 to 8 of 100, where plain cluster errors (CR1) find far more and the jackknife (CR3) hardly any.
CR2: Bell, R. M. and McCaffrey, D. F. (2002), Survey Methodology 28(2), 169-181; Pustejovsky, J. E. and Tipton, E. (2018),
Journal of Business and Economic Statistics 36(4), 672-683. Omega squared: Olejnik, S. and Algina, J. (2003), Psychological
Methods 8(4), 434-447.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ._terms import FactorColumn, FactorIndependence, OmittedTerm, Term, Terms, design_matrix, independence, terms_of

NEGLIGIBLE_SHARE = 1e-20
"""Share of the total sum of squares below which a residual is rounding."""
CLUSTERED = "OLS type II, errors by design point (CR2)"
PLAIN = "OLS type II"
MAX_SHAPIRO_VALUES = 5000


@dataclass(frozen=True, slots=True)
class Effect:
    """One term: `eta2` is its share of the total sum of squares, `omega2` the same less what chance brings (never below 0).

    `f` and `p` are None where there is nothing to test against; `note` says why, or what the term cannot be told from.
    """

    term: str
    df: int
    sum_sq: float
    f: float | None
    p: float | None
    eta2: float
    omega2: float | None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Anova:
    """One node's analysis, with the checks of what it assumes beside it.

    `normal_p` (Shapiro-Wilk) and `equal_spread_p` (Breusch-Pagan) are of the residuals; None where they cannot be had. A small
    one means that the p values are rough. `note` says why there are no effects, and is empty otherwise.
    """

    n: int
    points: int
    method: str
    r2: float | None
    effects: tuple[Effect, ...]
    left_out: tuple[OmittedTerm, ...]
    independence: FactorIndependence
    normal_p: float | None = None
    equal_spread_p: float | None = None
    note: str = ""


def anova(values: Sequence[float], factors: Sequence[FactorColumn], points: Sequence[str], *, interactions: bool = True) -> Anova:
    """Which factors the values follow. `points` names each run's design point; runs of one are not taken as independent.

    Never raises for what a design cannot carry: that is named under `left_out`.
    """
    y = np.asarray(values, dtype=np.float64)
    clusters = cluster_codes(points)
    count = int(clusters.max()) + 1 if len(clusters) else 0
    terms = terms_of(factors, count, interactions=interactions)
    method = CLUSTERED if count < len(y) else PLAIN
    empty = Anova(len(y), count, method, None, (), terms.left_out, independence(factors))
    parameters = 1 + sum(term.df for term in terms.kept)
    if not len(y):
        return _without_effects(empty, "no run has a value")
    if not terms.kept:
        return _without_effects(empty, "no factor varies")
    if count <= parameters:
        return _without_effects(empty, f"{count} design points are too few for {parameters} parameters")
    if float(np.ptp(y)) <= 1e-12 * max(1.0, float(np.abs(y).max())):
        return _without_effects(empty, "every value is the same")
    return _with_effects(y, clusters, count, terms, empty)


def _without_effects(empty: Anova, note: str) -> Anova:
    return Anova(empty.n, empty.points, empty.method, None, (), empty.left_out, empty.independence, note=note)


def _with_effects(y: NDArray[np.float64], clusters: NDArray[np.int64], count: int, terms: Terms, empty: Anova) -> Anova:
    whole, _ = design_matrix(terms.kept, len(y))
    residual = y - whole @ _coefficients(whole, y)
    total, rest = float(((y - y.mean()) ** 2).sum()), float((residual**2).sum())
    exact = rest <= NEGLIGIBLE_SHARE * total
    spread = None if exact else rest / (len(y) - whole.shape[1])
    scaled = None if exact or count == len(y) else scaled_residuals(y, whole, clusters)
    tester = _EffectTester(y, clusters, terms, count - whole.shape[1], total, spread, count < len(y), scaled)
    return Anova(
        n=empty.n,
        points=empty.points,
        method=empty.method,
        r2=1.0 - rest / total,
        effects=tuple(tester.effect(term) for term in terms.kept),
        left_out=empty.left_out,
        independence=empty.independence,
        normal_p=None if exact else _normality_p(residual),
        equal_spread_p=None if exact else _equal_spread_p(residual, whole),
        note="the factors determine every value; nothing is left to test against" if exact else "",
    )


@dataclass(frozen=True, slots=True)
class _EffectTester:
    """Tests one term after another against the same runs. `spread` is None where the factors determine every value."""

    y: NDArray[np.float64]
    clusters: NDArray[np.int64]
    terms: Terms
    points_left: int
    total: float
    spread: float | None
    shared: bool
    scaled: NDArray[np.float64] | None

    def effect(self, term: Term) -> Effect:
        beside = [one for one in self.terms.kept if not set(term.factors) <= set(one.factors)]
        with_it, places = design_matrix([*beside, term], len(self.y))
        without, _ = design_matrix(beside, len(self.y))
        sum_sq = max(0.0, _residual_ss(without, self.y) - _residual_ss(with_it, self.y))
        note = self.terms.note(term.name)
        if self.spread is None:
            return Effect(term.name, term.df, sum_sq, None, None, sum_sq / self.total, None, note)
        f, p = self._clustered(term, with_it, places[term.name]) if self.shared else self._plain(term, sum_sq, self.spread)
        if p is None:
            note = "; ".join(filter(None, (note, "too few design points to test it")))
        omega2 = max(0.0, (sum_sq - term.df * self.spread) / (self.total + self.spread))
        return Effect(term.name, term.df, sum_sq, f, p, sum_sq / self.total, omega2, note)

    def _plain(self, term: Term, sum_sq: float, spread: float) -> tuple[float, float]:
        f = sum_sq / term.df / spread
        return f, float(stats.f.sf(f, term.df, self.points_left))

    def _clustered(self, term: Term, x: NDArray[np.float64], place: slice) -> tuple[float | None, float | None]:
        left = self.points_left - term.df + 1
        if self.scaled is None or left < 1:
            return None, None
        weights = np.asarray(np.linalg.pinv(x)[place].T, dtype=np.float64)
        errors, part = clustered_errors(self.scaled, self.clusters, weights), weights.T @ self.y
        f = float(part @ np.linalg.pinv(errors.T @ errors) @ part) / term.df * left / self.points_left
        return f, float(stats.f.sf(f, term.df, left))


def scaled_residuals(y: NDArray[np.float64], x: NDArray[np.float64], clusters: NDArray[np.int64]) -> NDArray[np.float64] | None:
    """Residuals of the regression on `x`, scaled up by what each run's cluster took of them (CR2).

    None where some cluster alone determines a coefficient.
    """
    residual = y - x @ _coefficients(x, y)
    bread = np.linalg.pinv(x.T @ x)
    scaled = np.empty_like(residual)
    for cluster in range(int(clusters.max()) + 1):
        mine = clusters == cluster
        kept, turn = np.linalg.eigh(np.eye(int(mine.sum())) - x[mine] @ bread @ x[mine].T)
        if kept[0] < 1e-9:
            return None
        scaled[mine] = turn @ ((turn.T @ residual[mine]) / np.sqrt(kept))
    return scaled


def clustered_errors(
    scaled: NDArray[np.float64], clusters: NDArray[np.int64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What each cluster adds to the error of the estimates `weights.T @ y`: one row a cluster, whose crossproduct is CR2.

    With clusters of one run each and the regression's own weights that is MacKinnon and White's HC2.
    """
    errors = np.zeros((int(clusters.max()) + 1, weights.shape[1]))
    np.add.at(errors, clusters, weights * scaled[:, None])
    return errors


def _normality_p(residual: NDArray[np.float64]) -> float | None:
    """Shapiro-Wilk, which is defined from 3 values and accurate to 5000; the first so many are taken."""
    return float(stats.shapiro(residual[:MAX_SHAPIRO_VALUES]).pvalue) if len(residual) >= 3 else None


def _equal_spread_p(residual: NDArray[np.float64], x: NDArray[np.float64]) -> float | None:
    """Breusch-Pagan after Koenker; None where every residual is as large as the others, so that there is nothing to explain."""
    squares = residual**2
    if np.ptp(squares) <= 1e-12 * float(squares.max(initial=0.0)):
        return None
    share = 1.0 - _residual_ss(x, squares) / float(((squares - squares.mean()) ** 2).sum())
    return float(stats.chi2.sf(len(x) * max(0.0, share), x.shape[1] - 1))


def cluster_codes(points: Sequence[str]) -> NDArray[np.int64]:
    """Each run's design point as a number from 0, in the order of first appearance."""
    place = {point: number for number, point in enumerate(dict.fromkeys(points))}
    return np.array([place[point] for point in points], dtype=np.int64)


def _coefficients(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.lstsq(x, y, rcond=None)[0], dtype=np.float64)


def _residual_ss(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    return float(((y - x @ _coefficients(x, y)) ** 2).sum())
