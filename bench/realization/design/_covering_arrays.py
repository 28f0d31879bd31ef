"""Covering arrays: few points in which every allowed combination of levels of any t factors occurs.

Built in parameter order: Lei, Y., Kacker, R., Kuhn, D. R., Okun, V. and Lawrence, J. (2008), "IPOG/IPOG-D:
efficient test generation for multi-way combinatorial testing", Software Testing, Verification and Reliability
18(3), 125-148. Constraints and conditional factors decide which combinations can occur: Yu, L., Lei, Y.,
Nourozborazjany, M., Kacker, R. and Kuhn, D. R. (2013), "An efficient algorithm for constraint handling in
combinatorial test generation", ICST 2013.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.documents import Document

from ._factor_space import FactorSpace, LevelRule
from ._factors import FactorLevel, FactorLevels

# A factor of a row that has no level yet.
UNSET = -1

MAX_COMBINATIONS = 500_000

# Assignments that are tried before the rules count as too complex. Chosen, not measured.
MAX_ASSIGNMENTS = 200_000


class CoveringArray(Document):
    """Every allowed combination of levels of any `strength` factors at least once, in few points."""

    kind: Literal["covering_array"] = "covering_array"
    strength: int = Field(2, ge=1, le=4, description="2 covers all pairs, 3 all triples.")

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        choices = {factor.name: space.choices(factor) for factor in space.free}
        strength = min(self.strength, len(choices))
        sizes = [len(levels) for levels in choices.values()]
        count = sum(math.prod(chosen_sizes) for chosen_sizes in itertools.combinations(sizes, strength))
        # Checked first: the table of uncovered combinations would not fit in memory.
        if count > MAX_COMBINATIONS:
            raise ValueError(
                f"there are {count} combinations of {strength} levels to cover, more than {MAX_COMBINATIONS}; lower strength"
            )
        rows = _covering_rows(
            choices, strength, PartialAssignments(choices, space.rules()), np.random.default_rng(seed)
        )
        return [space.complete(row) for row in rows]


class PartialAssignments:
    """Decides whether indices into `choices`, as far as chosen, can be completed without breaking a rule."""

    def __init__(self, choices: Mapping[str, Sequence[FactorLevel]], rules: Sequence[LevelRule]) -> None:
        self._names = list(choices)
        self._choices = list(choices.values())
        place = {name: at for at, name in enumerate(choices)}
        self._rules = [(rule, tuple(sorted(place[name] for name in rule.names))) for rule in rules]
        bound = {at for _, places in self._rules for at in places}
        self.bound = tuple(sorted(bound))
        self._known: dict[tuple[int, ...], bool] = {}
        self._looked_at = 0

    def __call__(self, row: Sequence[int]) -> bool:
        """`row` has an index or UNSET for each factor. Raises ValueError when the search takes too long."""
        # Only factors that a rule names decide, so rows that differ elsewhere share an answer.
        key = tuple(row[at] for at in self.bound)
        if key not in self._known:
            self._known[key] = self.filled(row) is not None
        return self._known[key]

    def filled(self, row: Sequence[int], draws: np.random.Generator | None = None) -> list[int] | None:
        """The row completed, with random levels if a generator is given; None when impossible."""
        completed = list(row)
        if not self._legal(completed):
            return None
        return self._filled(completed, [at for at in self.bound if row[at] == UNSET], draws)

    def levels(self, row: Sequence[int]) -> FactorLevels:
        """The levels of a complete row."""
        return {name: levels[at] for name, levels, at in zip(self._names, self._choices, row, strict=True)}

    def _filled(
        self, row: list[int], unset: list[int], draws: np.random.Generator | None
    ) -> list[int] | None:
        if not unset:
            free = [at for at, number in enumerate(row) if number == UNSET]
            for at in free:
                row[at] = int(draws.integers(len(self._choices[at]))) if draws else 0
            return row
        self._looked_at += 1
        if self._looked_at > MAX_ASSIGNMENTS:
            raise ValueError(
                "the forbidden combinations are too complex for a covering_array; use full_factorial, sobol or halton"
            )
        at, *rest = unset
        numbers = range(len(self._choices[at]))
        for number in draws.permutation(len(numbers)).tolist() if draws else numbers:
            row[at] = number
            if self._legal(row, at) and (completed := self._filled(row, rest, draws)) is not None:
                return completed
        row[at] = UNSET
        return None

    def _legal(self, row: Sequence[int], changed: int | None = None) -> bool:
        for rule, places in self._rules:
            if (changed is None or changed in places) and all(row[at] != UNSET for at in places):
                levels = {self._names[at]: self._choices[at][row[at]] for at in places}
                if rule.broken(levels):
                    return False
        return True


def _covering_rows(
    choices: Mapping[str, Sequence[FactorLevel]],
    strength: int,
    possible: PartialAssignments,
    draws: np.random.Generator,
) -> list[FactorLevels]:
    sizes = [len(levels) for levels in choices.values()]
    if not possible([UNSET] * len(sizes)):
        raise ValueError("everything is forbidden")
    # IPOG gives shorter arrays when factors with many levels come first.
    order = sorted(range(len(sizes)), key=lambda at: (-sizes[at], at))
    first = order[:strength]
    rows = [
        row
        for numbers in itertools.product(*(range(sizes[at]) for at in first))
        if possible(row := partial_row(sizes, first, numbers))
    ]
    for count in range(strength, len(order)):
        _extend_rows(
            rows, _UncoveredCombinations(order[:count], order[count], sizes, strength, possible), possible
        )
    filled = [possible.filled(row, draws) for row in rows]
    return [possible.levels(row) for row in filled if row is not None]


def partial_row(sizes: Sequence[int], places: Sequence[int], numbers: Sequence[int]) -> list[int]:
    """A row with these numbers of levels at these places, and nothing else set."""
    row = [UNSET] * len(sizes)
    for at, number in zip(places, numbers, strict=True):
        row[at] = number
    return row


class _UncoveredCombinations:
    """Combinations of one new factor with any t - 1 earlier ones that no row has yet.

    `open` has the shape (sets of earlier factors, their levels as one number, levels of the new factor).
    """

    def __init__(
        self,
        earlier: Sequence[int],
        new: int,
        sizes: Sequence[int],
        strength: int,
        possible: PartialAssignments,
    ) -> None:
        self.new, self._sizes = new, sizes
        sets = list(itertools.combinations(earlier, strength - 1))
        self.sets = np.array(sets, dtype=np.int64).reshape(len(sets), strength - 1)
        self._size_of = np.array(sizes, dtype=np.int64)
        widest = max(math.prod(sizes[at] for at in factors) for factors in self.sets.tolist())
        self.open = np.zeros((len(self.sets), widest, sizes[new]), dtype=np.bool_)
        bound = set(possible.bound)
        for place, factors in enumerate(self.sets.tolist()):
            constrained = bool(bound & {*factors, new})
            for code, numbers in enumerate(itertools.product(*(range(sizes[at]) for at in factors))):
                for level in range(sizes[new]):
                    row = partial_row(sizes, [*factors, new], [*numbers, level]) if constrained else None
                    self.open[place, code, level] = row is None or possible(row)
        self._every = np.arange(len(self.sets))

    def gains(self, row: Sequence[int]) -> NDArray[np.int64]:
        """The number of uncovered combinations that each level of the new factor would cover in this row."""
        codes, is_set = self._codes(row)
        return np.asarray(self.open[self._every[is_set], codes[is_set]].sum(axis=0), dtype=np.int64)

    def strike(self, row: Sequence[int]) -> None:
        """Mark the combinations of this row as covered."""
        if row[self.new] != UNSET:
            codes, is_set = self._codes(row)
            self.open[self._every[is_set], codes[is_set], row[self.new]] = False

    def remaining(self) -> Iterator[list[int]]:
        """Each combination still uncovered, as a row with nothing else set.

        Those covered during the iteration are skipped.
        """
        for place, code, level in np.argwhere(self.open).tolist():
            if self.open[place, code, level]:
                factors = self.sets[place].tolist()
                numbers = []
                for at in reversed(factors):
                    code, number = divmod(code, self._sizes[at])
                    numbers.append(number)
                yield partial_row(self._sizes, [*factors, self.new], [*reversed(numbers), level])

    def _codes(self, row: Sequence[int]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        numbers = np.array(row, dtype=np.int64)
        codes, is_set = np.zeros(len(self.sets), dtype=np.int64), np.ones(len(self.sets), dtype=np.bool_)
        for column in self.sets.T:
            codes = codes * self._size_of[column] + numbers[column]
            is_set &= numbers[column] != UNSET
        return codes, is_set


def _extend_rows(
    rows: list[list[int]], missing: _UncoveredCombinations, possible: PartialAssignments
) -> None:
    """Give each row the new factor's level that covers most, then add rows for what is still uncovered."""
    for row in rows:
        gains = missing.gains(row)
        # A stable sort breaks ties the same way on every machine.
        for level in np.argsort(-gains, kind="stable").tolist():
            if not gains[level]:
                # Left unset, so that a later combination can use this row.
                break
            row[missing.new] = level
            if possible(row):
                missing.strike(row)
                break
            row[missing.new] = UNSET
    for wanted in missing.remaining():
        host = next((row for row in rows if _fits(row, wanted) and possible(_merged(row, wanted))), None)
        if host is None:
            rows.append(wanted)
            host = wanted
        host[:] = _merged(host, wanted)
        missing.strike(host)


def _fits(row: Sequence[int], wanted: Sequence[int]) -> bool:
    return all(UNSET in levels or levels[0] == levels[1] for levels in zip(row, wanted, strict=True))


def _merged(row: Sequence[int], wanted: Sequence[int]) -> list[int]:
    return [other if level == UNSET else level for level, other in zip(row, wanted, strict=True)]
