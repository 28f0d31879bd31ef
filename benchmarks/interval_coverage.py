"""How often the intervals of a confidence cover the true value, over a grid of made campaigns.

python benchmarks/interval_coverage.py [CAMPAIGNS]

docs/statistics.md has a part of what it prints. CAMPAIGNS (2000) are made for each cell of the grid, so a coverage of 95 % has a standard error of half a point. Every cell has its own seed. Wilson's
interval is summed over the binomial distribution instead.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import stats
from statsmodels.stats.proportion import proportion_confint

from bench.arrays import Floats
from bench.statistics import bounded_mean, clopper_pearson, effective_size

CLUSTERS = (5, 10, 24, 100)
SHARES = (0.5, 0.7, 0.8, 0.9, 0.95, 0.99)
CORRELATIONS = (0.0, 0.1, 0.3, 0.6, 0.9, 0.95)
LEAVES = (3, 10, 30)
CRASH_RATES = (0.02, 0.05, 0.1, 0.2, 0.3)


@dataclass(frozen=True, slots=True)
class Cell:
    """One place of the grid: what the campaigns are like, and the share of them that the interval covers."""

    family: str
    clusters: int
    replicates: int
    text: str
    coverage: float
    width: float


def passes(rng: np.random.Generator, p: float, correlation: float, shape: tuple[int, int, int]) -> Floats:
    """Passes whose clusters have beta-distributed rates: `correlation` is that of two runs of a cluster."""
    if correlation == 0.0:
        return (rng.random(shape) < p).astype(np.float64)
    size = (1.0 - correlation) / correlation
    return (rng.random(shape) < rng.beta(p * size, (1.0 - p) * size, (*shape[:2], 1))).astype(np.float64)


def latent_passes(
    rng: np.random.Generator, p: float, correlation: float, shape: tuple[int, int, int]
) -> Floats:
    """Passes where a normal variable is below a limit: `correlation` is that of the variable in a cluster."""
    shared = rng.standard_normal((*shape[:2], 1))
    latent = np.sqrt(correlation) * shared + np.sqrt(1.0 - correlation) * rng.standard_normal(shape)
    return np.asarray(latent < stats.norm.ppf(p), dtype=np.float64)


def interval(ratios: Floats) -> tuple[Floats, Floats]:
    """The interval that a summary gives for the mean of (campaigns, clusters, replicates) ratios."""
    campaigns, clusters, replicates = ratios.shape
    runs, mean = clusters * replicates, ratios.mean(axis=(1, 2))
    squared = ((ratios.sum(axis=2) - replicates * mean[:, None]) ** 2).sum(axis=1)
    size = effective_size(mean, np.full(campaigns, runs), np.full(campaigns, clusters), squared)
    low, high = clopper_pearson(mean * size, size)
    ratio_low, ratio_high = bounded_mean(mean, runs, clusters, squared)
    counted = (ratios * (1.0 - ratios)).max(axis=(1, 2)) < 1e-9
    return np.where(counted, low, ratio_low), np.where(counted, high, ratio_high)


def cell(family: str, text: str, true: float, ratios: Floats) -> Cell:
    """Coverage of one place of the grid."""
    low, high = interval(ratios)
    # Both ends come from sums of floats: an end that is equal to the true value may differ in its last bit.
    covered = (low <= true + 1e-12) & (high >= true - 1e-12)
    _, clusters, replicates = ratios.shape
    return Cell(family, clusters, replicates, text, float(covered.mean()), float((high - low).mean()))


def count_cells(campaigns: int) -> Iterator[Cell]:
    """Passes of replicates that share design points."""
    generators: dict[str, Callable[..., Floats]] = {"beta-binomial": passes, "latent normal": latent_passes}
    for clusters, replicates, p, correlation in product(CLUSTERS, (1, 2, 4), SHARES, CORRELATIONS):
        if replicates == 1 and correlation > 0.0:
            continue
        for number, (name, generate) in enumerate(generators.items()):
            rng = np.random.default_rng(
                [clusters, replicates, round(100 * p), round(100 * correlation), number]
            )
            samples = generate(rng, p, correlation, (campaigns, clusters, replicates))
            yield cell(name, f"p {p:g}, correlation {correlation:g}", p, samples)


def ratio_cells(campaigns: int) -> Iterator[Cell]:
    """Ratios of runs in which several observables are considered.

    In the family "alike" the observables of a run, and runs of a design point, agree by a latent normal
    variable. In "crashes" some runs (or whole design points) achieve nothing. In "fixed" half of the
    observables are always achieved.
    """
    for clusters, replicates, leaves, p in product(CLUSTERS, (1, 3), LEAVES, (0.5, 0.8, 0.9, 0.95, 0.99)):
        rng = np.random.default_rng([clusters, replicates, leaves, round(100 * p)])
        shape = (campaigns, clusters, replicates)
        shared = (0.0,) if replicates == 1 else (0.0, 0.3, 0.9)
        for correlation, of_point in product((0.0, 0.1, 0.3, 0.6), shared):
            point = np.sqrt(correlation * of_point) * rng.standard_normal((*shape[:2], 1))
            run = np.sqrt(correlation * (1.0 - of_point)) * rng.standard_normal(shape)
            rates = stats.norm.cdf((stats.norm.ppf(p) - point - run) / np.sqrt(1.0 - correlation))
            text = f"{leaves} observables, p {p:g}, correlation {correlation:g}, {of_point:g} of it by design point"
            yield cell("alike", text, p, rng.binomial(leaves, rates) / leaves)
        for rate, whole in product(CRASH_RATES, (False,) if replicates == 1 else (False, True)):
            crashed = rng.random((*shape[:2], 1) if whole else shape) < rate
            ratios = np.where(crashed, 0.0, rng.binomial(leaves, p, shape) / leaves)
            text = (
                f"{leaves} observables, p {p:g}, {rate:g} of the {'design points' if whole else 'runs'} crash"
            )
            yield cell("crashes", text, p * (1.0 - rate), ratios)
        half = leaves // 2
        ratios = (half + rng.binomial(leaves - half, p, shape)) / leaves
        yield cell("fixed", f"{leaves} observables, p {p:g}", (half + p * (leaves - half)) / leaves, ratios)


def print_table(cells: list[Cell]) -> None:
    """Print mean, least and most coverage by family, number of clusters and replicates."""
    print("| runs | design points x replicates | mean | 5 in 100 cells below | least | where | mean width |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    groups: dict[tuple[str, int, int], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.family, cell.clusters, cell.replicates), []).append(cell)
    for (family, clusters, replicates), group in sorted(groups.items()):
        covered = np.array([cell.coverage for cell in group])
        worst = min(group, key=lambda cell: cell.coverage)
        print(
            f"| {family} | {clusters} x {replicates} | {100 * covered.mean():.1f} | {100 * np.quantile(covered, 0.05):.1f} "
            f"| {100 * worst.coverage:.1f} | {worst.text} | {np.mean([cell.width for cell in group]):.2f} |"
        )
    coverage = np.array([cell.coverage for cell in cells])
    below = ", ".join(f"{limit} %: {100 * np.mean(coverage < limit / 100):.1f} %" for limit in (90, 93, 95))
    print(f"\n{len(cells)} cells, mean {100 * coverage.mean():.1f} %; share of cells below {below}\n")


def print_wilson() -> None:
    """Print the least and the mean coverage of Wilson's interval over all true shares."""
    print("| n | mean | least | at |\n| --- | --- | --- | --- |")
    for n in (10, 14, 30, 100, 215):
        count = np.arange(n + 1)
        low, high = proportion_confint(count, n, method="wilson")
        # Coverage jumps at the ends of the intervals: its least value is just beside one of them.
        even = (np.arange(20_000) + 0.5) / 20_000
        beside = np.concatenate([low[1:] - 1e-9, high[:-1] + 1e-9])
        covered = [
            np.asarray([stats.binom.pmf(count[(low <= p) & (p <= high)], n, p).sum() for p in shares])
            for shares in (even, beside)
        ]
        worst = int(covered[1].argmin())
        print(
            f"| {n} | {100 * covered[0].mean():.1f} | {100 * covered[1][worst]:.1f} | p {beside[worst]:.4f} |"
        )


def main() -> None:
    """Print all tables."""
    campaigns = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    print("Passes and failures\n")
    print_table(list(count_cells(campaigns)))
    print("Ratios of several observables\n")
    print_table(list(ratio_cells(campaigns)))
    print("Wilson\n")
    print_wilson()


if __name__ == "__main__":
    main()
