"""Jensen-Shannon divergence between what two agents (or campaigns) came to at one node.

A run falls into one class: not considered, failed (considered, but without a score), or a band of scores. Bands are 20
points wide, ending where tensions end; 10 from 50 runs a side, 5 from 200. Lin, J. (1991), "Divergence measures based on the
Shannon entropy", IEEE Transactions on Information Theory 37(1), 145-151; base 2, so that it lies in [0, 1].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SHUFFLES = 2000
SHUFFLES_PER_BATCH = 200
BAND_WIDTHS = ((200, 5.0), (50, 10.0), (0, 20.0))
NOT_CONSIDERED, FAILED, BANDS = 0, 1, 2


@dataclass(frozen=True, slots=True)
class NodeOutcome:
    """How a node came out in one run: a score, none because it failed, or not considered at all."""

    score: float | None
    considered: bool


@dataclass(frozen=True, slots=True)
class Divergence:
    """`value` in bits, [0, 1]; `by_chance` is its mean when labels are shuffled, which is not nought in small samples.

    `p` is the share of shuffles (the data itself among them) that diverge as much. `band` is the width of score bands in points.
    """

    value: float
    by_chance: float
    p: float
    band: float
    first: int
    second: int
    paired: bool


def divergence(
    first: Sequence[NodeOutcome], second: Sequence[NodeOutcome], *, paired: bool, seed: int = 0, shuffles: int = SHUFFLES
) -> Divergence | None:
    """Compare two sets of runs; None where either is empty.

    `paired` runs stand in the same order on both sides, and a shuffle exchanges within pairs; otherwise it mixes all runs. Raises
    ValueError where pairs do not match up. The same seed gives the same p.
    """
    if not first or not second:
        return None
    if paired and len(first) != len(second):
        raise ValueError(f"{len(first)} and {len(second)} runs are no pairs")
    band = next(width for least, width in BAND_WIDTHS if min(len(first), len(second)) >= least)
    kinds = [_outcome_class(one, band) for one in (*first, *second)]
    places = {kind: place for place, kind in enumerate(sorted(set(kinds)))}
    hot = np.eye(len(places))[[places[kind] for kind in kinds]]
    one, other = hot[: len(first)], hot[len(first) :]
    value = float(js_divergence(one.sum(axis=0), other.sum(axis=0)))
    draw = np.random.Generator(np.random.PCG64(seed))
    shuffled = _shuffled_pairs(one, other, draw, shuffles) if paired else _shuffled_runs(hot, len(first), draw, shuffles)
    by_chance = js_divergence(shuffled, hot.sum(axis=0) - shuffled)
    p = (1 + int((by_chance >= value - 1e-12).sum())) / (shuffles + 1)
    return Divergence(value, float(by_chance.mean()), p, band, len(first), len(second), paired)


def js_divergence(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Divergence of two rows (or arrays of rows) of counts or weights over the same classes, in bits."""
    p = first / first.sum(axis=-1, keepdims=True)
    q = second / second.sum(axis=-1, keepdims=True)
    middle = (p + q) / 2
    return np.clip((_relative_entropy(p, middle) + _relative_entropy(q, middle)) / 2, 0.0, 1.0)


def _relative_entropy(p: NDArray[np.float64], middle: NDArray[np.float64]) -> NDArray[np.float64]:
    ratio = np.divide(p, middle, out=np.ones_like(p), where=p > 0)
    return np.asarray((p * np.log2(ratio)).sum(axis=-1))


def _outcome_class(ended: NodeOutcome, band: float) -> int:
    if not ended.considered:
        return NOT_CONSIDERED
    if ended.score is None:
        return FAILED
    # Bands end at 20, 40, ... inclusive, as tensions do; all below the first are one, and so are all above 100.
    rounded = round(ended.score / band, 9)
    return BANDS + int(min(max(np.ceil(rounded), 1), np.ceil(100 / band) + 1))


def _shuffled_pairs(
    one: NDArray[np.float64], other: NDArray[np.float64], draw: np.random.Generator, shuffles: int
) -> NDArray[np.float64]:
    gain, start = other - one, one.sum(axis=0)
    parts = [min(SHUFFLES_PER_BATCH, shuffles - done) for done in range(0, shuffles, SHUFFLES_PER_BATCH)]
    return np.vstack([start + draw.integers(0, 2, size=(count, len(one))).astype(np.float64) @ gain for count in parts])


def _shuffled_runs(hot: NDArray[np.float64], first: int, draw: np.random.Generator, shuffles: int) -> NDArray[np.float64]:
    return np.array([hot[draw.permutation(len(hot))[:first]].sum(axis=0) for _ in range(shuffles)])
