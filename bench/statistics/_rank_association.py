"""Kendall's tau-b of a rating with failure, within agents and observables, with an interval over design
points.

Pairs of trials are compared only within a stratum (one agent at one observable): agents and observables
differ in how often they fail whatever the rating is. With one stratum the value is the usual tau-b. The
interval is a delete-one-design-point jackknife on Fisher's z with Student's t: Newson, R. (2006), "Confidence
intervals for rank statistics: Somers' D and extensions", The Stata Journal 6(3), 309-334; Arvesen, J. N.
(1969), "Jackknifing U-statistics", Annals of Mathematical Statistics 40(6), 2076-2100.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from bench.arrays import Bools, Counts, Floats

from ._anova import cluster_codes
from ._comparison import SIGNIFICANCE
from ._intervals import CONFIDENCE_LEVEL
from ._rounding import DIFFICULTY_DECIMALS

# With fewer design points no slope or association is tested: by chance alone all would agree. Chosen, not measured.
MIN_DESIGN_POINTS = 5

# The least p is one in a thousand. Chosen, not measured.
SHUFFLES = 999

NEVER_CONSIDERED = "never considered"
ONE_RATING = "one rating only"
NO_MIXED_STRATUM = "no agent both passes and fails"
TOO_FEW = "too few design points"
ONE_POINT_DECIDES = "one design point decides"
PERFECT_ORDER = "in perfect order"


@dataclass(frozen=True, slots=True)
class RankAssociation:
    """Tau-b of the rating with failure; positive where a higher rating fails more often.

    `tau` is None where it is not defined, for the reason in `note`. `low` and `high` (two-sided 95 %) are
    None beside a tau of 1 or -1, and where without one design point there is no tau. `p` is two-sided, from
    shuffles of the ratings among the design points that the same agents flew. It is exact where design points
    are exchangeable, and guards an interval that few design points make too short.
    """

    trials: int
    failed: int
    design_points: int
    ratings: int
    tau: float | None = None
    low: float | None = None
    high: float | None = None
    p: float | None = None
    note: str = ""

    def agrees(self, significance: float = SIGNIFICANCE) -> bool:
        """Whether a higher rating fails more often, beyond chance: by the interval and by p."""
        return self._decided(1.0, self.low, significance)

    def contradicts(self, significance: float = SIGNIFICANCE) -> bool:
        """Whether a higher rating fails less often, beyond chance: by the interval and by p."""
        return self._decided(-1.0, self.high, significance)

    def _decided(self, sign: float, nearest_end: float | None, significance: float) -> bool:
        if self.tau is None or self.p is None or self.p > significance or sign * self.tau <= 0.0:
            return False
        return nearest_end is None or sign * nearest_end > 0.0


def rank_association(
    rating: ArrayLike,
    failed: ArrayLike,
    agents: Sequence[str],
    observables: Sequence[str],
    design_points: Sequence[str],
    *,
    seed: int = 0,
) -> RankAssociation:
    """The association of trials' ratings with their failures. The same arguments give the same p."""
    ratings: Floats = np.asarray(rating, dtype=np.float64).round(DIFFICULTY_DECIMALS)
    fails = np.asarray(failed, dtype=np.bool_)
    association = RankAssociation(
        trials=fails.size,
        failed=int(fails.sum()),
        design_points=len(set(design_points)),
        ratings=len(np.unique(ratings)),
    )
    if association.ratings < 2:
        return _without_tau(association, ONE_RATING if association.ratings else NEVER_CONSIDERED)
    pairs = _Pairs.of(ratings, fails, list(zip(agents, observables, strict=True)), design_points)
    tau = pairs.tau()
    if tau is None:
        return _without_tau(association, NO_MIXED_STRATUM if not pairs.mixed else ONE_RATING)
    if association.design_points < MIN_DESIGN_POINTS:
        return _without_tau(association, TOO_FEW)
    low, high, note = _interval(tau, pairs.taus_without_one())
    p = _shuffled_p(pairs, _blocks(agents, design_points), np.random.default_rng(seed))
    return RankAssociation(
        association.trials,
        association.failed,
        association.design_points,
        association.ratings,
        tau,
        low,
        high,
        p,
        note,
    )


def _without_tau(association: RankAssociation, note: str) -> RankAssociation:
    return RankAssociation(
        association.trials, association.failed, association.design_points, association.ratings, note=note
    )


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Counts of pairs between cells; a cell is a design point at a rating.

    `failures` and `passes` count trials as (strata, cells). `failure_pass[c, d]` counts pairs of a failure in
    c with a pass in d, and `all_pairs[c, d]` pairs of any trials, both within strata. `point` is the design
    point of each cell. With these, tau-b without a design point is a matter of leaving out rows and columns.
    """

    rating: Floats
    point: Counts
    failures: Floats
    passes: Floats
    failure_pass: Floats
    all_pairs: Floats

    @classmethod
    def of(
        cls, rating: Floats, failed: Bools, strata: Sequence[tuple[str, str]], design_points: Sequence[str]
    ) -> _Pairs:
        points = cluster_codes(design_points)
        cells, cell = np.unique(np.column_stack([points, rating]), axis=0, return_inverse=True)
        codes = {name: number for number, name in enumerate(dict.fromkeys(strata))}
        stratum = np.array([codes[name] for name in strata], dtype=np.int64)
        failures, passes = np.zeros((2, len(codes), len(cells)))
        np.add.at(failures, (stratum, cell.ravel()), failed)
        np.add.at(passes, (stratum, cell.ravel()), ~failed)
        totals = failures + passes
        return cls(
            rating=cells[:, 1],
            point=cells[:, 0].astype(np.int64),
            failures=failures,
            passes=passes,
            failure_pass=failures.T @ passes,
            all_pairs=totals.T @ totals,
        )

    @property
    def mixed(self) -> bool:
        """Whether any stratum has a pass and a failure."""
        return bool(self.failure_pass.sum() > 0.0)

    def inside(self) -> Floats:
        """Which cells each design point has, as (cells, design points)."""
        return np.asarray(self.point[:, None] == np.arange(int(self.point.max()) + 1), dtype=np.float64)

    def tau(self) -> float | None:
        concordance, untied_ratings, untied_results = (float(part.sum()) for part in self._parts())
        scale = untied_ratings * untied_results
        return float(np.clip(concordance / np.sqrt(scale), -1.0, 1.0)) if scale > 0.0 else None

    def taus_without_one(self) -> Floats:
        """Tau-b without each design point in turn, NaN where it is not defined."""
        inside = self.inside()

        def without(part: Floats) -> Floats:
            columns = part @ inside
            # Pairs with a trial of the point in first or second place; those with both are in both counts.
            touched = columns.sum(axis=0) + (part.T @ inside).sum(axis=0) - (inside * columns).sum(axis=0)
            return np.asarray(part.sum() - touched)

        concordance, untied_ratings, untied_results = map(without, self._parts())
        # Counts are whole or half numbers, so anything below a quarter is the rounding of a zero.
        scale = np.where(
            (untied_ratings > 0.25) & (untied_results > 0.25), untied_ratings * untied_results, np.nan
        )
        return np.asarray(np.clip(concordance / np.sqrt(scale), -1.0, 1.0))

    def _parts(self) -> tuple[Floats, Floats, Floats]:
        order = np.sign(self.rating[:, None] - self.rating[None, :])
        return order * self.failure_pass, 0.5 * np.abs(order) * self.all_pairs, self.failure_pass


def _interval(tau: float, without_one: Floats) -> tuple[float | None, float | None, str]:
    if abs(tau) > 1.0 - 1e-12:
        return None, None, PERFECT_ORDER
    if not (np.abs(without_one) < 1.0 - 1e-12).all():
        return None, None, ONE_POINT_DECIDES
    count = len(without_one)
    z = np.arctanh(without_one)
    error = np.sqrt((count - 1) / count * float(((z - z.mean()) ** 2).sum()))
    reach = float(stats.t.ppf(0.5 + CONFIDENCE_LEVEL / 2.0, count - 1)) * error
    centre = np.arctanh(tau)
    return float(np.tanh(centre - reach)), float(np.tanh(centre + reach)), ""


def _blocks(agents: Sequence[str], design_points: Sequence[str]) -> list[NDArray[np.int64]]:
    """The design points, as numbers, that the same agents flew.

    Ratings of other design points are not exchanged: campaigns of different agents may differ in design.
    """
    flown: dict[str, set[str]] = {}
    for agent, point in zip(agents, design_points, strict=True):
        flown.setdefault(point, set()).add(agent)
    blocks: dict[frozenset[str], list[int]] = {}
    for number, names in enumerate(flown.values()):
        blocks.setdefault(frozenset(names), []).append(number)
    return [np.array(numbers, dtype=np.int64) for numbers in blocks.values()]


def _shuffled_p(pairs: _Pairs, blocks: Sequence[NDArray[np.int64]], rng: np.random.Generator) -> float:
    inside = pairs.inside()
    # A design point whose replicates differ in rating is moved as a whole, at its mean.
    mean = (inside * pairs.rating[:, None]).sum(axis=0) / inside.sum(axis=0)
    levels, level = np.unique(mean.round(DIFFICULTY_DECIMALS), return_inverse=True)
    failures, passes = pairs.failures @ inside, pairs.passes @ inside
    at_level = np.eye(len(levels))

    def concordance(level_of_point: NDArray[np.intp]) -> float:
        """Pairs whose higher rating failed, less those whose lower rating did."""
        failed, passed = failures @ at_level[level_of_point], passes @ at_level[level_of_point]
        below = (np.cumsum(counts, axis=1) - counts for counts in (passed, failed))
        passed_below, failed_below = below
        return float((failed * passed_below - passed * failed_below).sum())

    # Counts are whole numbers: half of one is a slack that no rounding crosses.
    observed = abs(concordance(level)) - 0.5
    reached = 0
    for _ in range(SHUFFLES):
        shuffled = level.copy()
        for block in blocks:
            shuffled[block] = level[rng.permutation(block)]
        reached += abs(concordance(shuffled)) >= observed
    return (1 + reached) / (1 + SHUFFLES)
