"""The comparison of two agents as text: the same cells in the page and in the terminal."""

from __future__ import annotations

from bench.statistics import Divergence, NodeComparison, UnpairedNodeComparison

from ._format import number

NOTHING = "–"


def rate_cells(node: NodeComparison) -> list[str]:
    """Node, pairs, rates of both sides in per cent, their difference in points (second minus first) with its interval, p and
    adjusted p; a dash where there is none.
    """
    rates, difference = node.counts.rates, node.difference
    return [
        node.node,
        str(node.counts.pairs),
        *([number(100 * rate) for rate in rates] if rates else [NOTHING] * 2),
        _signed(difference.estimate) if difference else NOTHING,
        f"{_signed(difference.low)} to {_signed(difference.high)}" if difference else NOTHING,
        _p(node.mcnemar_p),
        _p(node.p_adjusted),
    ]


def divergence_cells(divergence: Divergence | None) -> list[str]:
    """The divergence, what chance makes of it, and its p; dashes where there is none."""
    if divergence is None:
        return [NOTHING] * 3
    return [number(divergence.value, 2), number(divergence.by_chance, 2), _p(divergence.p)]


def unpaired_cells(node: UnpairedNodeComparison) -> tuple[str, ...]:
    """A node of other scenes: what both sides passed, divergence, by chance, p, adjusted p."""
    return (
        node.node,
        *(f"{passed} of {runs}" for passed, runs in zip(node.passed, node.considered, strict=True)),
        *divergence_cells(node.divergence),
        _p(node.p_adjusted),
    )


def _signed(share: float) -> str:
    text = number(100 * share)
    return f"+{text}" if share > 0.0 and text != "0.0" else text


# Below 0.001 the digits depend on assumptions of the test more than on the data.
def _p(value: float | None) -> str:
    return NOTHING if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"
