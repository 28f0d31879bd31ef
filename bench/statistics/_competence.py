"""Competence: the difficulty up to which an agent passes, which failing can never raise (docs/rulings.md 17).

A trial is a run in which a node is considered. It passes when every considered descendant observable is
achieved, and its difficulty is the node's configured one. Isotonic fit: Ayer, Brunk, Ewing, Reid and
Silverman (1955), Annals of Mathematical Statistics 26(4), 641-647.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from scipy import stats

from bench.arrays import Bools, Counts, Floats

from . import DIFFICULTY_DECIMALS
from ._intervals import CONFIDENCE_LEVEL
from ._shuffles import MIN_DESIGN_POINTS

# Fractions, not floats: a pass rate of exactly nine tenths must reach the share of nine tenths.
COMPETENCE_SHARES = {"50": (1, 2), "90": (9, 10)}


# Bounds the work of the lower bound; above it neighbouring difficulties are merged. Chosen, not measured.
MAX_DIFFICULTY_CLASSES = 32

# Stakes of the bets and their weights: 5 and 33 straight passes reach the shares of 50 and 90 %, where exact tests
# of one group of runs need 5 and 29.
_STEPS = np.array([0.995, 0.9, 0.75, 0.5])
_WEIGHTS = np.array([0.4, 0.2, 0.2, 0.2])


@dataclass(frozen=True, slots=True)
class Trials:
    """Trials of many groups (one group is one node of one agent) as arrays with one entry for each trial."""

    group: Counts
    difficulty: Floats
    passed: Bools
    design_point: Counts


@dataclass(frozen=True, slots=True)
class Competence:
    """Competence of every group, as arrays; where `trials` is 0 there is none, whatever the other arrays hold.

    `value` is the largest tested difficulty at which the antitonic fit of the pass rate reaches the share, 0
    where none does. `at_least` is true where it is the highest difficulty tested, so that its end is not
    known. `low` is a one-sided 95 % lower bound of the largest tested difficulty at which the pass
    probability reaches the share.
    """

    trials: Counts
    value: Floats
    low: Floats
    at_least: Bools


@dataclass(frozen=True, slots=True)
class TrialCounts:
    """Trials counted. `cells` are the difficulties (in millionths) of each group with their sums, easiest first.

    `alike` counts the design points of each cell that had the same number of trials and passes.
    """

    groups: int
    cells: pl.DataFrame
    alike: pl.DataFrame


def count_trials(trials: Trials, groups: int) -> TrialCounts:
    """Count the trials of groups 0 to `groups` - 1, in any order."""
    hard = _millionths(trials.difficulty)
    frame = pl.DataFrame(
        {"group": trials.group, "difficulty": hard, "point": trials.design_point, "passed": trials.passed}
    )
    points = frame.group_by("group", "difficulty", "point").agg(
        pl.len().alias("tried"), pl.col("passed").sum()
    )
    group, difficulty, tried, passed = (
        points[name].cast(pl.Int64).to_numpy() for name in points.columns if name != "point"
    )
    return _counted(group, difficulty, tried, passed, groups)


def count_design_points(
    group: Counts, difficulty: Floats, tried: Counts, passed: Counts, groups: int
) -> TrialCounts:
    """The same from the trials and passes of each design point, where a design point has one difficulty in a group."""
    return _counted(group, _millionths(difficulty), tried, passed, groups)


def _counted(group: Counts, millionths: Counts, tried: Counts, passed: Counts, groups: int) -> TrialCounts:
    # Difficulties in millionths are at most 1e8, so they fit below the group number in one 64-bit key.
    keys, cell = np.unique((group << 32) | millionths, return_inverse=True)
    size = int(tried.max(initial=0)) + 1
    kinds, count = np.unique((cell * size + tried) * size + passed, return_counts=True)
    alike = pl.DataFrame(
        {"cell": kinds // size**2, "tried": kinds // size % size, "passed": kinds % size, "points": count}
    )

    def summed(values: Counts) -> Counts:
        return np.bincount(cell, weights=values, minlength=keys.size).astype(np.int64)

    cells = {
        "tried": summed(tried),
        "passed": summed(passed),
        "points": np.bincount(cell, minlength=keys.size),
    }
    return TrialCounts(
        groups, pl.DataFrame({"group": keys >> 32, "difficulty": keys & 0xFFFFFFFF, **cells}), alike
    )


def competence(counted: TrialCounts, share: tuple[int, int]) -> Competence:
    """Competence of every group at a pass rate of `share` (numerator, denominator).

    **The value.** Difficulties equal to six decimals are one cell. With G(k) the sum over the k easiest cells
    of passes less share x trials, the antitonic fit (weights: trials) reaches the share at cell j exactly
    when the greatest G from j on is no less than every G before j (min-max formula). The largest such j is
    the last k at which G is greatest; 0 is none. A pass turned into a failure lowers G from its cell on, so
    the last maximum never moves up. All is in whole numbers.

    **The bound.** Assumed: the pass probability p does not rise with difficulty; design points are
    independent; a design point's mean pass rate is on average p of its difficulty, whatever its replicates
    have in common. H(j) says p(j) < share. If it holds, so it does at everything harder. For one design point
    with the share Y of passes, 1 + t (Y - share) / share is then a bet of mean at most 1, for every t in [0,
    1]; the product from cell j upwards, averaged over fixed t, is a non-negative supermartingale, and by
    Ville's inequality it ever reaches 20 with probability at most 5 % (Waudby-Smith and Ramdas 2024, JRSS B
    86(1), 1-27; Howard et al. 2021, Annals of Statistics 49(2), 1055-1080). So H(j) is rejected where it does
    at the end of some cell from j on: no correction is owed for choosing where. The H(j) are tested from easy
    to hard, and the first that stands ends it (fixed sequence: Maurer, Hothorn and Lehmacher 1995): to claim
    too much, the first true H(j) must be rejected, so the whole claim is wrong with probability at most 5 %.
    Every bet grows with Y, so a failure can only lower the bound. It never exceeds the value. Above 32
    difficulties, neighbours are bound into 32 classes with like numbers of design points, claimed at their
    easiest.
    """
    cells = counted.cells
    group, tried, passed = (cells[name].to_numpy() for name in ("group", "tried", "passed"))
    difficulty = cells["difficulty"].to_numpy() / 10.0**DIFFICULTY_DECIMALS
    total = np.bincount(group, weights=tried, minlength=counted.groups).astype(np.int64)
    value, at_least = _isotonic_value(group, difficulty, share[1] * passed - share[0] * tried, counted.groups)
    low = _lower_bound(counted, group, difficulty, share[0] / share[1])
    return Competence(total, value, np.minimum(value, low), at_least)


def failures_rise(counted: TrialCounts) -> Bools:
    """Whether the trials of each group show that failures rise with difficulty, which competence assumes.

    The score test of a linear trend in proportions (Cochran 1954, Armitage 1955), with the empirical variance of the sums of
    design points (Liang and Zeger 1986) and Student's quantile: the two-sided 95 % interval of the slope lies above 0. False with
    fewer than five design points, and where all pass or all fail.
    """
    cells, alike = counted.cells, counted.alike
    group, tried, passed = (cells[name].to_numpy() for name in ("group", "tried", "passed"))
    difficulty = cells["difficulty"].to_numpy() / 10.0**DIFFICULTY_DECIMALS

    def summed(of: Counts, values: Floats) -> Floats:
        return np.asarray(np.bincount(of, weights=values, minlength=counted.groups), dtype=np.float64)

    trials = np.maximum(summed(group, tried), 1.0)
    centred = difficulty - (summed(group, tried * difficulty) / trials)[group]
    failure_rate = summed(group, tried - passed) / trials
    cell, point_tried, point_passed, points = (alike[name].to_numpy() for name in alike.columns)
    of = group[cell]
    residual = centred[cell] * (point_tried - point_passed - point_tried * failure_rate[of])
    count = summed(of, points)
    trend = summed(of, points * residual)
    # About their mean: a true trend must not widen its own interval.
    spread = summed(of, points * residual**2) - trend**2 / np.maximum(count, 1.0)
    error = np.sqrt(np.maximum(spread, 1e-12) * count / np.maximum(count - 1.0, 1.0))
    quantile = stats.t.ppf(0.5 + CONFIDENCE_LEVEL / 2.0, np.maximum(count - 2.0, 1.0))
    return np.asarray((count >= MIN_DESIGN_POINTS) & (trend > quantile * error), dtype=np.bool_)


def _millionths(difficulty: Floats) -> Counts:
    return np.rint(difficulty * 10.0**DIFFICULTY_DECIMALS).astype(np.int64)


def _isotonic_value(group: Counts, difficulty: Floats, gain: Counts, groups: int) -> tuple[Floats, Bools]:
    value, at_least = np.zeros(groups), np.zeros(groups, dtype=np.bool_)
    if not group.size:
        return value, at_least
    first = np.flatnonzero(np.diff(group, prepend=-1))
    cells = np.diff(first, append=group.size)
    summed = np.cumsum(gain)
    summed -= np.repeat(summed[first] - gain[first], cells)
    highest = np.maximum(np.maximum.reduceat(summed, first), 0)
    maximum_at = np.where(summed == np.repeat(highest, cells), np.arange(group.size), -1)
    last = np.maximum.reduceat(maximum_at, first)
    reached = last >= 0
    value[group[first]] = np.where(reached, difficulty[last], 0.0)
    at_least[group[first]] = reached & (last == first + cells - 1)
    return value, at_least


def _classes(group: Counts, points: Counts) -> Counts:
    """Number of each cell's class within its group: one class a cell, or one for like numbers of design points."""
    if not group.size:
        return np.zeros(0, dtype=np.int64)
    first = np.flatnonzero(np.diff(group, prepend=-1))
    cells = np.diff(first, append=group.size)
    summed = np.cumsum(points)
    before = summed - points - np.repeat(summed[first] - points[first], cells)
    total = np.repeat(np.add.reduceat(points, first), cells)
    place = np.arange(group.size) - np.repeat(first, cells)
    wanted = np.where(
        np.repeat(cells, cells) <= MAX_DIFFICULTY_CLASSES, place, before * MAX_DIFFICULTY_CLASSES // total
    )
    fresh = np.diff(wanted, prepend=-1) != 0
    fresh[first] = False
    number = np.cumsum(fresh)
    dense: Counts = number - np.repeat(number[first], cells)
    return dense


def _lower_bound(counted: TrialCounts, group: Counts, difficulty: Floats, share: float) -> Floats:
    low = np.zeros(counted.groups)
    if not group.size:
        return low
    classes = _classes(group, counted.cells["points"].to_numpy())
    width = int(classes.max()) + 1
    slot = group * width + classes
    easiest_difficulty = np.full(counted.groups * width, np.inf)
    np.minimum.at(easiest_difficulty, slot, difficulty)
    shape = (counted.groups, width)
    claimed = _leading_true(
        _highest_wealth(counted.alike, slot, shape, share) >= (1.0 - 1e-12) / (1.0 - CONFIDENCE_LEVEL)
    )
    any_claimed = claimed > 0
    low[any_claimed] = easiest_difficulty.reshape(shape)[any_claimed, claimed[any_claimed] - 1]
    return low


def _highest_wealth(
    alike: pl.DataFrame, slot_of_cell: Counts, shape: tuple[int, int], share: float
) -> Floats:
    """The highest wealth that bets from each class upwards ever reach, as (groups, classes)."""
    slot, points = slot_of_cell[alike["cell"].to_numpy()], alike["points"].to_numpy()
    excess = (alike["passed"].to_numpy() / alike["tried"].to_numpy() - share) / share
    size = shape[0] * shape[1]
    gains = [np.bincount(slot, weights=points * np.log1p(step * excess), minlength=size) for step in _STEPS]
    summed = np.zeros((len(_STEPS), shape[0], shape[1] + 1))
    np.cumsum(np.stack(gains).reshape(len(_STEPS), *shape), axis=2, out=summed[:, :, 1:])
    best = np.zeros(shape)
    for start in range(shape[1]):
        # exp(600) is far above any threshold and still finite.
        gained = np.minimum(summed[:, :, start + 1 :] - summed[:, :, start : start + 1], 600.0)
        best[:, start] = np.tensordot(_WEIGHTS, np.exp(gained), axes=1).max(axis=1)
    return best


def _leading_true(claims: Bools) -> Counts:
    """Length of the leading run of true entries in each row."""
    counted: Counts = np.cumprod(claims, axis=1, dtype=np.int64).sum(axis=1)
    return counted
