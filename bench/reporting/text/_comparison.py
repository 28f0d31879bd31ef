"""The comparison of two agents as text: the same cells in the page and in the terminal."""

from __future__ import annotations

from dataclasses import dataclass

from bench.statistics import NodeComparison, UnpairedNodeComparison

from ._format import number

NOTHING = "–"


@dataclass(frozen=True, slots=True)
class ComparisonCells:
    """One node compared. Rates are per cent, differences points of per cent, second minus first."""

    node: str
    pairs: str
    first: str
    second: str
    difference: str
    interval: str
    mcnemar_p: str
    p_adjusted: str
    divergence: str
    divergence_by_chance: str
    divergence_p: str


def comparison_cells(node: NodeComparison) -> ComparisonCells:
    """The numbers of a node as text, with a dash where there is none."""
    rates, difference, divergence = node.counts.rates, node.difference, node.divergence
    return ComparisonCells(
        node=node.node,
        pairs=str(node.counts.pairs),
        first=number(100 * rates[0]) if rates else NOTHING,
        second=number(100 * rates[1]) if rates else NOTHING,
        difference=_signed(difference.estimate) if difference else NOTHING,
        interval=f"{_signed(difference.low)} to {_signed(difference.high)}" if difference else NOTHING,
        mcnemar_p=_p(node.mcnemar_p),
        p_adjusted=_p(node.p_adjusted),
        divergence=number(divergence.value, 2) if divergence else NOTHING,
        divergence_by_chance=number(divergence.by_chance, 2) if divergence else NOTHING,
        divergence_p=_p(divergence.p) if divergence else NOTHING,
    )


def unpaired_cells(node: UnpairedNodeComparison) -> tuple[str, ...]:
    """A node of other scenes: what both sides passed, divergence, by chance, p, adjusted p."""
    divergence = node.divergence
    return (
        node.node,
        *(f"{passed} of {runs}" for passed, runs in zip(node.passed, node.considered, strict=True)),
        number(divergence.value, 2) if divergence else NOTHING,
        number(divergence.by_chance, 2) if divergence else NOTHING,
        _p(divergence.p) if divergence else NOTHING,
        _p(node.p_adjusted),
    )


def _signed(share: float) -> str:
    text = number(100 * share)
    return f"+{text}" if share > 0.0 and text != "0.0" else text


# Below 0.001 the digits depend on assumptions of the test more than on the data.
def _p(value: float | None) -> str:
    return NOTHING if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"
