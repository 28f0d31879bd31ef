"""How passes depend on factors: logistic regression with odds ratios.

Where factors separate passes from failures the likelihood has no maximum, and its odds ratios grow to
infinity. This is detected before fitting (a linear programme: Konis, K. (2007), "Linear programming
algorithms for detecting separated data in binary logistic regression models", DPhil thesis, Oxford), and
Firth's penalised likelihood is used instead (Heinze, G. and Schemper, M. (2002), "A solution to the problem
of separation in logistic regression", Statistics in Medicine 21, 2409-2419), with its likelihood ratio tests
and profile intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, stats

from bench.arrays import Counts, Floats

from ._anova import cluster_codes
from ._firth import DistinctRows, information, maximize, probability
from ._terms import FactorColumn, OmittedTerm, Term, design_matrix, terms_of

FIRTH = "Firth's penalised likelihood"
LIKELIHOOD = "maximum likelihood"
CLUSTERED_LIKELIHOOD = "maximum likelihood, errors by design point"
# Odds ratios above this, or below its inverse, are not reported: no campaign has the runs to know them.
# Chosen, not measured.
MAX_ODDS_RATIO = 1000.0
# Log odds from one point of a profile to the next; half of it finds the same bounds.
PROFILE_STEP = 1.0
# Other starts where a profile seems to end, and their spread in log odds. Of 42 bounds of fits with 11 to 23 columns for
# 24 runs, 7 were too near without them, and 1 with them, against 9 starts everywhere.
NUDGES, NUDGE = 4, 1.5
# Fewer events of the rarer outcome for each parameter get a remark: a rule of thumb of logistic regression is
# 5 to 10.
MIN_EVENTS_PER_PARAMETER = 5


@dataclass(frozen=True, slots=True)
class OddsRatio:
    """Odds of passing at `level` relative to those at `base`, other factors being equal, with a 95 % interval.

    A bound or an estimate beyond MAX_ODDS_RATIO is None: runs cannot tell it.
    """

    factor: str
    base: str
    level: str
    estimate: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class FactorTest:
    """Whether a factor has an effect on passing, over all of its levels."""

    factor: str
    df: int
    p: float | None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Logistic:
    """Passes regressed on factors, main effects only.

    `note` holds warnings, or the reason why there is no fit.
    """

    n: int
    passed: int
    method: str
    odds: tuple[OddsRatio, ...]
    tests: tuple[FactorTest, ...]
    left_out: tuple[OmittedTerm, ...]
    note: str = ""


def logistic(passed: Sequence[bool], factors: Sequence[FactorColumn], points: Sequence[str]) -> Logistic:
    """Regress passes on factors: a numeric one as a line from its lowest to its highest level, another
    against its first level.

    Never raises for terms that the data cannot carry: they are listed in `left_out`, or `note` gives the
    reason.
    """
    y = np.asarray(passed, dtype=np.float64)
    passes, count = int(y.sum()), len(set(points))
    varying = [factor for factor in factors if len(factor.levels) > 1]
    constant = tuple(
        OmittedTerm(factor.name, "has one level only") for factor in factors if len(factor.levels) < 2
    )
    terms = terms_of(varying, count, interactions=False)
    left_out = (*constant, *terms.left_out)
    carried = {term.name for term in terms.carried}
    included = [(factor, _treatment_contrasts(factor)) for factor in varying if factor.name in carried]
    empty = Logistic(len(y), passes, "none", (), (), left_out)
    if passes in (0, len(y)):
        return replace(empty, note="every run passed" if passes else "no run passed")
    if not included:
        return replace(empty, note="no factor varies")
    x, places = design_matrix([term for _, term in included], len(y))
    if count <= x.shape[1]:
        return replace(empty, note=f"{count} design points are too few for {x.shape[1]} parameters")
    fit = fit_logistic(y, x, cluster_codes(points), is_separated=separated(y, x))
    tests = tuple(
        FactorTest(factor.name, term.df, fit.p(places[term.name]), terms.note(factor.name))
        for factor, term in included
    )
    odds = tuple(ratio for factor, term in included for ratio in _odds(factor, fit, places[term.name]))
    return Logistic(len(y), passes, fit.method, odds, tests, left_out, "; ".join(_remarks(fit, y, x, count)))


def separated(y: Floats, x: Floats) -> bool:
    """Whether a combination of columns has every pass on one side and every failure on the other, or on the border."""
    signed = x * np.where(y > 0.5, 1.0, -1.0)[:, None]
    solution = optimize.linprog(
        -signed.sum(axis=0),
        A_ub=-signed,
        b_ub=np.zeros(len(y)),
        bounds=[(-1.0, 1.0)] * x.shape[1],
        method="highs",
    )
    return solution.fun is not None and bool(solution.fun < -1e-7)


@dataclass(frozen=True, slots=True)
class LikelihoodFit:
    """A maximum-likelihood fit with its covariance; `residual_df` is infinite unless errors are by design point."""

    method: str
    beta: Floats
    covariance: Floats
    residual_df: float

    def p(self, place: slice) -> float | None:
        part = self.beta[place]
        statistic = float(part @ np.linalg.pinv(self.covariance[place, place]) @ part)
        # Wald's chi squared is the limit of F for infinite degrees of freedom, which scipy's F does not take.
        if np.isinf(self.residual_df):
            return float(stats.chi2.sf(statistic, len(part)))
        return float(stats.f.sf(statistic / len(part), len(part), self.residual_df))

    def interval(self, column: int) -> tuple[float, float]:
        reach = float(stats.t.ppf(0.975, self.residual_df) * np.sqrt(self.covariance[column, column]))
        return float(self.beta[column]) - reach, float(self.beta[column]) + reach


@dataclass(frozen=True, slots=True)
class FirthFit:
    """A penalised fit; its tests and intervals come from the profile of the penalised likelihood, not from a normal.

    A `design_effect` of 1 takes rows as independent; with one of k, k rows count as one.
    """

    method: str
    beta: Floats
    likelihood: float
    rows: DistinctRows
    design_effect: float

    def p(self, place: slice) -> float | None:
        free = np.ones(len(self.beta), dtype=bool)
        free[place] = False
        start = np.where(free, self.beta, 0.0)
        drop = 2 * (self.likelihood - maximize(self.rows, start, free, self.design_effect)[1])
        return float(stats.chi2.sf(max(0.0, drop) / self.design_effect, int((~free).sum())))

    def interval(self, column: int) -> tuple[float, float]:
        return self._bound(column, -1.0), self._bound(column, 1.0)

    def _bound(self, column: int, direction: float) -> float:
        """Where the profile of the penalised likelihood, followed outward from the estimate, falls below the edge of
        the interval; infinite beyond MAX_ODDS_RATIO.
        """
        edge = self.likelihood - self.design_effect * float(stats.chi2.ppf(0.95, 1)) / 2
        rng = np.random.default_rng(0)
        # Bounds beyond MAX_ODDS_RATIO are not reported, so the search stops there.
        last = float(np.log(MAX_ODDS_RATIO)) - direction * float(self.beta[column])
        inner, inner_beta, change = 0.0, self.beta, np.zeros_like(self.beta)
        while inner < last:
            outer = min(inner + PROFILE_STEP, last)
            fixed = float(self.beta[column]) + direction * outer
            outer_beta, likelihood = self._profile(column, fixed, [inner_beta + change * (outer - inner)])
            if likelihood <= edge:
                # With few runs for many factors the likelihood has several maxima, and a higher one than that
                # which leads here from the estimate may still be above the edge.
                nudged = [inner_beta + rng.normal(0.0, NUDGE, len(self.beta)) for _ in range(NUDGES)]
                other_beta, other = self._profile(column, fixed, [self.beta, *nudged])
                if other > likelihood:
                    outer_beta, likelihood = other_beta, other
            change = (outer_beta - inner_beta) / (outer - inner)
            if likelihood <= edge:
                return self._crossing(column, edge, inner_beta, outer_beta)
            inner, inner_beta = outer, outer_beta
        return direction * np.inf

    def _crossing(self, column: int, edge: float, inner_beta: Floats, outer_beta: Floats) -> float:
        """Where the profile meets the edge between a point of it above the edge and one that is not."""

        def above(share: float) -> float:
            between = inner_beta + share * (outer_beta - inner_beta)
            return self._profile(column, float(between[column]), [between, outer_beta])[1] - edge

        share = float(optimize.brentq(above, 0.0, 1.0, xtol=1e-9))
        return float(inner_beta[column] + share * (outer_beta[column] - inner_beta[column]))

    def _profile(self, column: int, fixed: float, starts: Sequence[Floats]) -> tuple[Floats, float]:
        """The highest of the maxima that these starts lead to, with the coefficient of `column` fixed."""
        free = np.ones(len(self.beta), dtype=bool)
        free[column] = False
        maxima = [
            maximize(self.rows, np.where(free, start, fixed), free, self.design_effect) for start in starts
        ]
        return max(maxima, key=lambda maximum: maximum[1])


def fit_logistic(
    y: Floats, x: Floats, clusters: Counts, *, is_separated: bool, design_effect: float = 1.0
) -> LikelihoodFit | FirthFit:
    """Fit y (0 or 1) to the columns of x by maximum likelihood, with errors by cluster where clusters have
    several rows; by Firth's penalised likelihood where there is no maximum, with this `design_effect`.
    """
    free = np.ones(x.shape[1], dtype=bool)
    rows = DistinctRows.of(y, x)
    if not is_separated:
        # Without its penalty the penalised likelihood is the likelihood.
        beta, _ = maximize(rows, np.zeros(x.shape[1]), free, design_effect=0.0)
        fit = _with_covariance(beta, y, x, clusters)
        if np.isfinite(fit.covariance).all() and np.diag(fit.covariance).min() > 0.0:
            return fit
    beta, likelihood = maximize(rows, np.zeros(x.shape[1]), free, design_effect)
    return FirthFit(FIRTH, beta, likelihood, rows, design_effect)


def _with_covariance(beta: Floats, y: Floats, x: Floats, clusters: Counts) -> LikelihoodFit:
    """A fit with the inverse of its information or, where clusters have several rows, with the sandwich by cluster.

    The sandwich has the usual correction for few clusters (Cameron, A. C. and Miller, D. L. (2015), "A practitioner's
    guide to cluster-robust inference", Journal of Human Resources 50, 317-372, equation 11 and the factor below it).
    """
    bread = np.asarray(np.linalg.pinv(information(x, beta), hermitian=True), dtype=np.float64)
    points, (runs, columns) = int(clusters.max()) + 1, x.shape
    if points == runs:
        return LikelihoodFit(LIKELIHOOD, beta, bread, np.inf)
    slopes = np.zeros((points, columns))
    np.add.at(slopes, clusters, x * (y - probability(x @ beta))[:, None])
    correction = points / (points - 1) * (runs - 1) / (runs - columns)
    covariance = correction * bread @ slopes.T @ slopes @ bread
    return LikelihoodFit(CLUSTERED_LIKELIHOOD, beta, covariance, points - columns)


def _treatment_contrasts(factor: FactorColumn) -> Term:
    if factor.numeric:
        numbers = factor.numbers()
        columns = ((numbers - numbers.min()) / np.ptp(numbers))[:, None]
    else:
        columns = np.eye(len(factor.levels))[factor.codes()][:, 1:]
    return Term((factor.name,), factor.spread_out(columns))


def _odds(factor: FactorColumn, fit: LikelihoodFit | FirthFit, columns: slice) -> list[OddsRatio]:
    base, levels = str(factor.levels[0]), (factor.levels[-1:] if factor.numeric else factor.levels[1:])
    ratios = []
    for column, level in zip(range(columns.start, columns.stop), levels, strict=True):
        low, high = fit.interval(column)
        estimate, low_ratio, high_ratio = map(_odds_ratio, (float(fit.beta[column]), low, high))
        ratios.append(OddsRatio(factor.name, base, str(level), estimate, low_ratio, high_ratio))
    return ratios


def _odds_ratio(log_odds: float) -> float | None:
    return float(np.exp(log_odds)) if abs(log_odds) <= np.log(MAX_ODDS_RATIO) else None


def _remarks(fit: LikelihoodFit | FirthFit, y: Floats, x: Floats, points: int) -> list[str]:
    remarks = []
    if isinstance(fit, FirthFit):
        remarks.append("factors separate passes from failures, so odds are penalised (Firth)")
        if points < len(y):
            remarks.append("runs of one design point are taken as independent")
    rarer = int(min(y.sum(), len(y) - y.sum()))
    if rarer < MIN_EVENTS_PER_PARAMETER * (x.shape[1] - 1):
        singular, plural = ("pass", "passes") if y.sum() <= len(y) / 2 else ("failure", "failures")
        remarks.append(f"only {rarer} {singular if rarer == 1 else plural} for {x.shape[1] - 1} parameters")
    return remarks
