"""What a regression over factors is made of: columns of factors, the terms that a design can carry, what must stay out and why."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FactorLevel = bool | int | float | str
MAX_CATEGORIES = 6
"""A numeric factor with more levels than this enters as a straight line, since its levels could not each be estimated."""
MIN_RESIDUAL_DF = 8
"""Degrees of freedom that must be left once interactions are in; with fewer, none is carried."""
RANK_TOLERANCE = 1e-8


@dataclass(frozen=True, slots=True)
class FactorColumn:
    """The level of one factor in every run under analysis, None in runs in which it is inactive.

    Such a run tells nothing of the factor's effect: what differs between active and inactive is due to what switches it.
    """

    name: str
    values: tuple[FactorLevel | None, ...]

    @property
    def active(self) -> NDArray[np.bool_]:
        """(runs,) where it has a level."""
        return np.array([one is not None for one in self.values], dtype=np.bool_)

    @property
    def numeric(self) -> bool:
        """Whether its levels are numbers; true and false are names."""
        return all(isinstance(one, int | float) and not isinstance(one, bool) for one in self.values if one is not None)

    @property
    def levels(self) -> tuple[FactorLevel, ...]:
        """Each level once: numbers rising, names in the order of the runs."""
        seen = dict.fromkeys(one for one in self.values if one is not None)
        return tuple(sorted(seen, key=float)) if self.numeric else tuple(seen)

    @property
    def is_line(self) -> bool:
        """Whether an analysis of variance takes it as a straight line."""
        return self.numeric and len(self.levels) > MAX_CATEGORIES

    def among(self, rows: NDArray[np.bool_]) -> FactorColumn:
        """The same in some of the runs."""
        return FactorColumn(self.name, tuple(one for one, kept in zip(self.values, rows, strict=True) if kept))

    def numbers(self) -> NDArray[np.float64]:
        """Its values where it is active; only for a numeric factor."""
        return np.array([float(one) for one in self.values if one is not None])

    def codes(self) -> NDArray[np.int64]:
        """The place of each run's level among `levels`, where it is active."""
        place = {level: number for number, level in enumerate(self.levels)}
        return np.array([place[one] for one in self.values if one is not None], dtype=np.int64)

    def spread_out(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """(runs, k) columns of the active runs, 0 elsewhere."""
        whole = np.zeros((len(self.values), columns.shape[1]))
        whole[self.active] = columns
        return whole

    def contrasts(self) -> NDArray[np.float64]:
        """(runs, degrees of freedom): a standardised line, or levels coded to sum to zero; 0 where it is inactive."""
        if self.is_line:
            numbers = self.numbers()
            return self.spread_out(((numbers - numbers.mean()) / numbers.std())[:, None])
        unit = np.vstack([np.eye(len(self.levels) - 1), -np.ones(len(self.levels) - 1)])
        return self.spread_out(unit[self.codes()])


@dataclass(frozen=True, slots=True)
class Term:
    """A main effect (one factor) or an interaction (two), as columns of a regression."""

    factors: tuple[str, ...]
    columns: NDArray[np.float64]

    @property
    def name(self) -> str:
        return " x ".join(self.factors)

    @property
    def df(self) -> int:
        return int(self.columns.shape[1])


@dataclass(frozen=True, slots=True)
class OmittedTerm:
    """A term that the design cannot carry, and why."""

    term: str
    reason: str


@dataclass(frozen=True, slots=True)
class Terms:
    """The terms that a design carries, those that it cannot, and for kept terms what they cannot be told from."""

    kept: tuple[Term, ...]
    left_out: tuple[OmittedTerm, ...]
    shared: Mapping[str, tuple[str, ...]]

    def note(self, term: str) -> str:
        """What a reader of this term's numbers must know; empty when there is nothing."""
        others = self.shared.get(term, ())
        return f"cannot be told from {', '.join(others)}" if others else ""


def factor_columns(levels: Sequence[Mapping[str, FactorLevel | None]]) -> tuple[FactorColumn, ...]:
    """Columns from each run's levels, None where a factor is inactive, in the order of the first run.

    Raises ValueError where runs have different factors.
    """
    names = tuple(levels[0]) if levels else ()
    if any(set(one) != set(names) for one in levels):
        raise ValueError("every run must have a level of every factor")
    return tuple(FactorColumn(name, tuple(one[name] for one in levels)) for name in names)


def terms_of(factors: Sequence[FactorColumn], points: int, *, interactions: bool = True) -> Terms:
    """Main effects in the given order, then two-way interactions, as far as the design determines them.

    `points` is the number of independent units (design points, or runs where none is repeated). Of factors that vary
    together the first is kept, and says what it cannot be told from.
    """
    sorter = _TermSelection(factors)
    for factor in factors:
        if len(factor.levels) < 2:
            sorter.out(factor.name, "has one level only")
        else:
            sorter.take(Term((factor.name,), factor.contrasts()))
    if not interactions:
        return sorter.sorted()
    mains = {term.name: term for term in sorter.kept}
    crossed = [_interaction(a, b) for a, b in itertools.combinations(mains.values(), 2)]
    room = points - 1 - sum(term.df for term in mains.values()) - MIN_RESIDUAL_DF
    if crossed and sum(term.df for term in crossed) > room:
        sorter.out("interactions", f"{points} design points leave too little to tell them from chance")
        return sorter.sorted()
    for term in crossed:
        sorter.take(term)
    return sorter.sorted()


class _TermSelection:
    """Keeps a term when its columns are not a combination of those that are kept already."""

    def __init__(self, factors: Sequence[FactorColumn]) -> None:
        self.kept: list[Term] = []
        self._runs = len(factors[0].values) if factors else 0
        self._out: list[OmittedTerm] = []
        self._shared: dict[str, tuple[str, ...]] = {}

    def out(self, term: str, reason: str) -> None:
        self._out.append(OmittedTerm(term, reason))

    def take(self, term: Term) -> None:
        used = _columns_of(self._runs, self.kept)
        if _rank(np.hstack([used, term.columns])) == used.shape[1] + term.df:
            self.kept.append(term)
            return
        partners = self._partners(term)
        names = ", ".join(one.name for one in partners)
        whole = _rank(np.hstack([used, term.columns])) == used.shape[1]
        self.out(term.name, f"{'aliased' if whole else 'in part aliased'} with {names}")
        for one in partners:
            self._shared[one.name] = (*self._shared.get(one.name, ()), term.name)

    def sorted(self) -> Terms:
        return Terms(tuple(self.kept), tuple(self._out), dict(self._shared))

    def _partners(self, term: Term) -> list[Term]:
        """The kept terms without which this one would be determined; all of them where no single one would do."""

        def free(others: Iterable[Term]) -> int:
            base = _columns_of(self._runs, others)
            return _rank(np.hstack([base, term.columns])) - _rank(base)

        least = free(self.kept)
        without = [one for one in self.kept if free([other for other in self.kept if other is not one]) > least]
        return without or self.kept


def _interaction(first: Term, second: Term) -> Term:
    products = first.columns[:, :, None] * second.columns[:, None, :]
    return Term((*first.factors, *second.factors), products.reshape(len(products), -1))


def _columns_of(runs: int, terms: Iterable[Term]) -> NDArray[np.float64]:
    return np.hstack([np.ones((runs, 1)), *(term.columns for term in terms)])


def design_matrix(terms: Sequence[Term], runs: int) -> tuple[NDArray[np.float64], dict[str, slice]]:
    """The regression's columns, a constant first, and where each term's columns stand."""
    places, start = {}, 1
    for term in terms:
        places[term.name] = slice(start, start + term.df)
        start += term.df
    return _columns_of(runs, terms), places


def _rank(columns: NDArray[np.float64]) -> int:
    return int(np.linalg.matrix_rank(columns, tol=RANK_TOLERANCE * max(columns.shape)))


@dataclass(frozen=True, slots=True)
class FactorIndependence:
    """How far a design's factors vary together: the largest |Pearson r| of numeric ones, the largest Cramér's V of any two.

    None where there are no two such factors. 0 is a balanced design; at 1 two factors cannot be told apart.
    """

    max_r: float | None
    r_pair: tuple[str, str] | None
    max_v: float | None
    v_pair: tuple[str, str] | None


def independence(factors: Sequence[FactorColumn]) -> FactorIndependence:
    """Check a design's factors against each other, over the runs given."""
    varied = [one for one in factors if len(one.levels) > 1]
    lines = _varied_pairs([one for one in varied if one.numeric])
    classed = _varied_pairs([one for one in varied if not one.is_line])
    r, r_pair = _largest((abs(float(np.corrcoef(a.numbers(), b.numbers())[0, 1])), (a.name, b.name)) for a, b in lines)
    v, v_pair = _largest((cramers_v(a, b), (a.name, b.name)) for a, b in classed)
    return FactorIndependence(r, r_pair, v, v_pair)


def _varied_pairs(factors: Sequence[FactorColumn]) -> Iterator[tuple[FactorColumn, FactorColumn]]:
    """Each two over the runs in which both are active, where both vary there."""
    for a, b in itertools.combinations(factors, 2):
        both = a.active & b.active
        one, other = a.among(both), b.among(both)
        if len(one.levels) > 1 and len(other.levels) > 1:
            yield one, other


def cramers_v(first: FactorColumn, second: FactorColumn) -> float:
    """Cramér's V of two factors' levels, in [0, 1] (Cramér 1946, Mathematical Methods of Statistics, 21.9)."""
    table = np.zeros((len(first.levels), len(second.levels)))
    np.add.at(table, (first.codes(), second.codes()), 1.0)
    expected = table.sum(axis=1, keepdims=True) * table.sum(axis=0, keepdims=True) / table.sum()
    chi2 = float(((table - expected) ** 2 / expected).sum())
    return float(np.sqrt(chi2 / (table.sum() * (min(table.shape) - 1))))


def _largest(found: Iterable[tuple[float, tuple[str, str]]]) -> tuple[float | None, tuple[str, str] | None]:
    pairs = list(found)
    return max(pairs, key=lambda one: one[0]) if pairs else (None, None)
