"""Parts of a regression over factors: factor columns, the terms that a design can carry, and those left out."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats.contingency import association, crosstab

from bench.arrays import Bools, Counts, Floats

FactorLevel = bool | int | float | str
# A numeric factor with more levels enters as a straight line, because a campaign has too few runs to estimate
# each level.
MAX_CATEGORIES = 6
# Interactions enter only where so many degrees of freedom remain for the error. Chosen, not measured.
MIN_RESIDUAL_DF = 8
# Contrasts are of order 1, so a smaller singular value is rounding.
RANK_TOLERANCE = 1e-8


@dataclass(frozen=True, slots=True)
class FactorColumn:
    """The level of one factor in every run under analysis, None in runs in which it is inactive.

    An inactive run says nothing about the factor's effect: its difference from active runs is due to the
    factor that switches it.
    """

    name: str
    values: tuple[FactorLevel | None, ...]

    @property
    def active(self) -> Bools:
        """Mask (runs,) of the runs in which it has a level."""
        return np.array([level is not None for level in self.values], dtype=np.bool_)

    @property
    def numeric(self) -> bool:
        """Whether its levels are numbers; true and false count as names."""
        return all(
            isinstance(level, int | float) and not isinstance(level, bool)
            for level in self.values
            if level is not None
        )

    @property
    def levels(self) -> tuple[FactorLevel, ...]:
        """Each level once: numbers in ascending order, names in the order of the runs."""
        distinct = dict.fromkeys(level for level in self.values if level is not None)
        return tuple(sorted(distinct, key=float)) if self.numeric else tuple(distinct)

    @property
    def is_line(self) -> bool:
        """Whether it enters an analysis of variance as a straight line."""
        return self.numeric and len(self.levels) > MAX_CATEGORIES

    def among(self, rows: Bools) -> FactorColumn:
        """The same factor in a selection of the runs."""
        return FactorColumn(
            self.name, tuple(level for level, selected in zip(self.values, rows, strict=True) if selected)
        )

    def numbers(self) -> Floats:
        """Its values where it is active; only for a numeric factor."""
        return np.array([float(level) for level in self.values if level is not None])

    def codes(self) -> Counts:
        """Index of the level of each active run among `levels`."""
        place = {level: number for number, level in enumerate(self.levels)}
        return np.array([place[value] for value in self.values if value is not None], dtype=np.int64)

    def spread_out(self, columns: Floats) -> Floats:
        """Columns of the active runs as (runs, k), 0 in inactive runs."""
        whole = np.zeros((len(self.values), columns.shape[1]))
        whole[self.active] = columns
        return whole

    def contrasts(self) -> Floats:
        """Contrasts as (runs, degrees of freedom): a standardised line, or levels that sum to zero; 0 where inactive."""
        if self.is_line:
            numbers = self.numbers()
            return self.spread_out(((numbers - numbers.mean()) / numbers.std())[:, None])
        unit = np.vstack([np.eye(len(self.levels) - 1), -np.ones(len(self.levels) - 1)])
        return self.spread_out(unit[self.codes()])


@dataclass(frozen=True, slots=True)
class Term:
    """A main effect (one factor) or an interaction (two), as columns of a regression."""

    factors: tuple[str, ...]
    columns: Floats

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
    """The terms that a design carries, those that it cannot, and for each carried term its aliases."""

    carried: tuple[Term, ...]
    left_out: tuple[OmittedTerm, ...]
    shared: Mapping[str, tuple[str, ...]]

    def note(self, term: str) -> str:
        """A warning for the reader of this term's numbers; empty where there is none."""
        aliases = self.shared.get(term, ())
        return f"cannot be told from {', '.join(aliases)}" if aliases else ""


def factor_columns(levels: Sequence[Mapping[str, FactorLevel | None]]) -> tuple[FactorColumn, ...]:
    """Columns from each run's levels, None where a factor is inactive, in the order of the first run.

    Raises ValueError where runs have different factors.
    """
    names = tuple(levels[0]) if levels else ()
    if any(set(run_levels) != set(names) for run_levels in levels):
        raise ValueError("every run must have a level of every factor")
    return tuple(FactorColumn(name, tuple(run_levels[name] for run_levels in levels)) for name in names)


def terms_of(factors: Sequence[FactorColumn], points: int, *, interactions: bool = True) -> Terms:
    """Main effects in the given order, then two-way interactions, as far as the design determines them.

    `points` is the number of independent units (design points, or runs where none is repeated). Of factors
    that vary together the first is carried, and its note names the others.
    """
    sorter = _TermSelection(factors)
    for factor in factors:
        if len(factor.levels) < 2:
            sorter.out(factor.name, "has one level only")
        else:
            sorter.take(Term((factor.name,), factor.contrasts()))
    if not interactions:
        return sorter.sorted()
    mains = {term.name: term for term in sorter.carried}
    crossed = [_interaction(a, b) for a, b in itertools.combinations(mains.values(), 2)]
    room = points - 1 - sum(term.df for term in mains.values()) - MIN_RESIDUAL_DF
    if crossed and sum(term.df for term in crossed) > room:
        sorter.out("interactions", f"{points} design points leave too little to tell them from chance")
        return sorter.sorted()
    for term in crossed:
        sorter.take(term)
    return sorter.sorted()


class _TermSelection:
    """Carries a term when its columns are not a combination of those that are carried already."""

    def __init__(self, factors: Sequence[FactorColumn]) -> None:
        self.carried: list[Term] = []
        self._runs = len(factors[0].values) if factors else 0
        self._out: list[OmittedTerm] = []
        self._shared: dict[str, tuple[str, ...]] = {}

    def out(self, term: str, reason: str) -> None:
        self._out.append(OmittedTerm(term, reason))

    def take(self, term: Term) -> None:
        used = _columns_of(self._runs, self.carried)
        if _rank(np.hstack([used, term.columns])) == used.shape[1] + term.df:
            self.carried.append(term)
            return
        partners = self._partners(term)
        names = ", ".join(partner.name for partner in partners)
        fully_aliased = _rank(np.hstack([used, term.columns])) == used.shape[1]
        self.out(term.name, f"{'aliased' if fully_aliased else 'in part aliased'} with {names}")
        for partner in partners:
            self._shared[partner.name] = (*self._shared.get(partner.name, ()), term.name)

    def sorted(self) -> Terms:
        return Terms(tuple(self.carried), tuple(self._out), dict(self._shared))

    def _partners(self, candidate: Term) -> list[Term]:
        """The carried terms that the candidate is aliased with; all of them where no single one is responsible."""

        def free(terms: Iterable[Term]) -> int:
            base = _columns_of(self._runs, terms)
            return _rank(np.hstack([base, candidate.columns])) - _rank(base)

        lowest = free(self.carried)
        partners = [
            term
            for term in self.carried
            if free([other for other in self.carried if other is not term]) > lowest
        ]
        return partners or self.carried


def _interaction(first: Term, second: Term) -> Term:
    products = first.columns[:, :, None] * second.columns[:, None, :]
    return Term((*first.factors, *second.factors), products.reshape(len(products), -1))


def _columns_of(runs: int, terms: Iterable[Term]) -> Floats:
    return np.hstack([np.ones((runs, 1)), *(term.columns for term in terms)])


def design_matrix(terms: Sequence[Term], runs: int) -> tuple[Floats, dict[str, slice]]:
    """The columns of the regression, a constant first, and the slice of each term."""
    places, start = {}, 1
    for term in terms:
        places[term.name] = slice(start, start + term.df)
        start += term.df
    return _columns_of(runs, terms), places


def _rank(columns: Floats) -> int:
    return int(np.linalg.matrix_rank(columns, tol=RANK_TOLERANCE * max(columns.shape)))


@dataclass(frozen=True, slots=True)
class FactorIndependence:
    """How far the factors of a design vary together: the largest |Pearson r| of numeric ones and the largest Cramér's V.

    None where there are no two such factors. 0 means a balanced design; at 1 two factors cannot be told
    apart.
    """

    max_r: float | None
    r_pair: tuple[str, str] | None
    max_v: float | None
    v_pair: tuple[str, str] | None


def independence(factors: Sequence[FactorColumn]) -> FactorIndependence:
    """Measure how far factors vary together over the given runs."""
    varied = [factor for factor in factors if len(factor.levels) > 1]
    lines = _varied_pairs([factor for factor in varied if factor.numeric])
    classed = _varied_pairs([factor for factor in varied if not factor.is_line])
    r, r_pair = _largest(
        (abs(float(np.corrcoef(a.numbers(), b.numbers())[0, 1])), (a.name, b.name)) for a, b in lines
    )
    v, v_pair = _largest((cramers_v(a, b), (a.name, b.name)) for a, b in classed)
    return FactorIndependence(r, r_pair, v, v_pair)


def _varied_pairs(factors: Sequence[FactorColumn]) -> Iterator[tuple[FactorColumn, FactorColumn]]:
    """Every two factors over the runs in which both are active, where both vary there."""
    for a, b in itertools.combinations(factors, 2):
        both_active = a.active & b.active
        first, second = a.among(both_active), b.among(both_active)
        if len(first.levels) > 1 and len(second.levels) > 1:
            yield first, second


def cramers_v(first: FactorColumn, second: FactorColumn) -> float:
    """Cramér's V of two factors' levels, in [0, 1] (Cramér 1946, Mathematical Methods of Statistics, 21.9)."""
    table = crosstab(first.codes(), second.codes()).count
    return float(association(table, method="cramer"))


def _largest(values: Iterable[tuple[float, tuple[str, str]]]) -> tuple[float | None, tuple[str, str] | None]:
    pairs = list(values)
    return max(pairs, key=lambda value: value[0]) if pairs else (None, None)
