"""Ethical difficulty: how hard a configured situation makes each node, and which key factor decides it.

Difficulty is a property of the configuration alone (docs/rulings.md 1 to 5, 14, 25): nothing here knows a run.
None is "has no difficulty" everywhere: of an observable that the configuration cannot exercise, of one whose
difficulty a table from elsewhere does not state, and of a node over such observables only.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Literal

from bench.errors import Fault, SetupError
from bench.simspec import FACTORS, PerceptionSource, SimSpec, factor_values
from bench.statistics import DIFFICULTY_DECIMALS
from decompositions import Decomposition, KeyFactor, Level, Policies


def rate(row: KeyFactor, value: float, policies: Policies | None = None) -> float:
    """Rating in [0, 100] of one value in one row of a key factor table.

    A value between two columns has the interpolated rating, with `step` the rating of the easier column. A
    value easier than the first column rates 0, a value harder than the last column rates as the last one, and
    a value in two columns has the lower rating; `policies` may choose otherwise. Raises ValueError for a
    value that is not finite.
    """
    rules = policies or Policies()
    if not math.isfinite(value):
        raise ValueError(f"the key factor {row.factor!r} has the value {value}, which no table can rate")
    # Rulings 1 to 3. A table may rise or fall; with the sign below its values always rise, so one search
    # serves both.
    sign = 1.0 if row.values[-1] > row.values[0] else -1.0
    rising_values = [sign * column for column in row.values]
    position = sign * value
    after = bisect_left(rising_values, position)
    if after == len(rising_values):
        return row.ratings[-1]
    if rising_values[after] == position:
        return row.ratings[
            after if rules.shared_value == "lower" else bisect_right(rising_values, position) - 1
        ]
    if after == 0:
        return row.ratings[0] if rules.easier_than_table == "first" else 0.0
    low, high = row.ratings[after - 1], row.ratings[after]
    if row.mapping == "step":
        return low
    return low + (high - low) * (position - rising_values[after - 1]) / (
        rising_values[after] - rising_values[after - 1]
    )


def tension_of(difficulty: float) -> int:
    """Tension 1 to 5 of a node: max(1, ceil(difficulty / 20)).

    A difficulty is equal to another to six decimals.
    """
    # Rounded first: 40.0000000001 from an interpolation belongs to tension 2, like 40.
    return max(1, math.ceil(round(difficulty, DIFFICULTY_DECIMALS) / 20.0))


@dataclass(frozen=True, slots=True)
class FactorRating:
    """The rating of one key factor for one observable; `value` is in `unit`."""

    factor: str
    value: float
    unit: str
    rating: float


@dataclass(frozen=True, slots=True)
class AbsentFactor:
    """A key factor of which the situation holds nothing; `value` is None where it has no value at all."""

    factor: str
    value: float | None
    unit: str


class Standing(StrEnum):
    """What an observable counts for in one configuration."""

    COUNTED = "counted"
    NOT_EXERCISABLE = "not exercisable"
    """The situation holds nothing that it is about (ruling 14): it is never considered."""
    CONFIGURED_SENSOR = "configured sensor"
    """It is about detections of the bench (ruling 25): it has its own numbers, and enters those of no other node."""


Perception = PerceptionSource | Literal["elsewhere"]
"""Whose perception it is: as in a SimSpec, or that of an aircraft of which only a table says what was measured."""


@dataclass(frozen=True, slots=True)
class ObservableDifficulty:
    """Difficulty of one observable, and the ratings of its key factors, lowest first.

    `difficulty` is None where the configuration cannot exercise it, because of the factors in `absent`, or
    where no difficulty is stated. `ruled_by` are the factors whose rating is the difficulty (none under the
    policy `mean`). `undetected` says that it is about detections where the bench makes none. `margin` is the distance in points to the next higher rating: the ruling factor can rise
    by this much before another one rules. None where no rating is higher.
    """

    observable: str
    difficulty: float | None
    ratings: tuple[FactorRating, ...]
    absent: tuple[AbsentFactor, ...] = ()
    standing: Standing = Standing.COUNTED
    undetected: bool = False

    @property
    def ruled_by(self) -> tuple[str, ...]:
        return tuple(rating.factor for rating in self.ratings if rating.rating == self.difficulty)

    @property
    def margin(self) -> float | None:
        if self.difficulty is None:
            return None
        above = [
            rating.rating - self.difficulty for rating in self.ratings if rating.rating > self.difficulty
        ]
        return min(above, default=None)


@dataclass(frozen=True, slots=True)
class NodeDifficulty:
    """Difficulty of one node: the minimum over those of its distinct descendant observables that have one and
    are counted; `ruled_by` are the observables that have it.
    """

    node: str
    level: Level
    difficulty: float | None
    ruled_by: tuple[str, ...]

    @property
    def tension(self) -> int | None:
        return None if self.difficulty is None else tension_of(self.difficulty)


@dataclass(frozen=True, slots=True)
class Difficulty:
    """Difficulty of every node in one configuration, with its reasons; nodes in the decomposition's order."""

    decomposition: str
    observables: Mapping[str, ObservableDifficulty]
    nodes: Mapping[str, NodeDifficulty]

    def of(self, node: str) -> float | None:
        """Difficulty of a node, None where it has none. Raises KeyError for an unknown id."""
        return self.nodes[node].difficulty

    def as_json(self) -> dict[str, Any]:
        """Every node and observable as JSON values, with the rating of every factor."""
        return {
            "decomposition": self.decomposition,
            "nodes": [
                {
                    "node": node.node,
                    "level": str(node.level),
                    "difficulty": node.difficulty,
                    "tension": node.tension,
                    "ruled_by": list(node.ruled_by),
                }
                for node in self.nodes.values()
            ],
            "observables": [
                {
                    "observable": observable.observable,
                    "difficulty": observable.difficulty,
                    "ruled_by": list(observable.ruled_by),
                    "margin": observable.margin,
                    "standing": str(observable.standing),
                    "absent": list(map(asdict, observable.absent)),
                    "factors": list(map(asdict, observable.ratings)),
                }
                for observable in self.observables.values()
            ],
        }


def difficulty_of_values(
    decomposition: Decomposition, values: Mapping[str, float], perception: Perception = "elsewhere"
) -> Difficulty:
    """Difficulty of every node for key factor values by name, in the units of `bench.simspec.FACTORS`.

    Raises SetupError that names every key factor without a value and the observables that need it.
    """
    _require_values(decomposition, values)
    return _difficulty(
        decomposition,
        {
            observable: _of_observable(decomposition, observable, values, perception)
            for observable in decomposition.observables
        },
    )


def difficulty_of(decomposition: Decomposition, simspec: SimSpec) -> Difficulty:
    """Difficulty of every node in the situation that a SimSpec configures.

    Raises as `difficulty_of_values`.
    """
    return difficulty_of_values(decomposition, factor_values(simspec), simspec.perception.source)


def stated_difficulty(decomposition: Decomposition, values: Mapping[str, float]) -> Difficulty:
    """Difficulty of every node from stated difficulties of observables, as in a table from elsewhere.

    An observable without a value has no difficulty, and so has a node over such observables only.
    """
    return _difficulty(
        decomposition,
        {
            observable: ObservableDifficulty(observable, values.get(observable), ())
            for observable in decomposition.observables
        },
    )


def rated_observables(
    decomposition: Decomposition, node: str, observables: Mapping[str, ObservableDifficulty]
) -> tuple[str, ...]:
    """The observables whose difficulties a node's is the minimum of; none where it has no difficulty."""
    return tuple(
        leaf
        for leaf in decomposition.observables_under(node)
        if observables[leaf].difficulty is not None
        # An observable always has its own difficulty, whatever it counts for above.
        and (leaf == node or observables[leaf].standing is Standing.COUNTED)
    )


def _difficulty(decomposition: Decomposition, observables: Mapping[str, ObservableDifficulty]) -> Difficulty:
    return Difficulty(
        decomposition.name,
        observables,
        {node: _of_node(decomposition, node, observables) for node in decomposition.nodes},
    )


def _of_observable(
    decomposition: Decomposition, observable: str, values: Mapping[str, float], perception: Perception
) -> ObservableDifficulty:
    policies, rows = decomposition.policies, decomposition.key_factors(observable)
    absent = tuple(
        AbsentFactor(row.factor, values.get(row.factor), row.unit)
        for row in rows
        if row.is_absent(values.get(row.factor))
    )
    absent_factors = {row.factor for row in absent}
    rated = [
        FactorRating(row.factor, values[row.factor], row.unit, rate(row, values[row.factor], policies))
        for row in rows
        if row.factor not in absent_factors
    ]
    ordered = tuple(sorted(rated, key=lambda row: row.rating))
    about_detections = decomposition.observables[observable].subject == "perception"
    undetected = about_detections and perception == "agent"
    if absent or undetected:
        return ObservableDifficulty(
            observable, None, ordered, absent, Standing.NOT_EXERCISABLE, undetected=undetected
        )
    ratings = [row.rating for row in rated]
    # fsum, because the mean must not depend on the order of the rows.
    value = min(ratings) if policies.factor_rule == "minimum" else math.fsum(ratings) / len(ratings)
    about_sensor = about_detections and perception != "elsewhere"
    return ObservableDifficulty(
        observable,
        value,
        ordered,
        standing=Standing.CONFIGURED_SENSOR if about_sensor else Standing.COUNTED,
    )


def _of_node(
    decomposition: Decomposition, node: str, observables: Mapping[str, ObservableDifficulty]
) -> NodeDifficulty:
    rated = {
        leaf: observables[leaf].difficulty for leaf in rated_observables(decomposition, node, observables)
    }
    lowest = min((value for value in rated.values() if value is not None), default=None)
    # Equal floats are meant: the minimum is one of these very numbers.
    ruling = tuple(observable for observable, value in rated.items() if value == lowest)
    return NodeDifficulty(node, decomposition.level_of(node), lowest, ruling)


def _require_values(decomposition: Decomposition, values: Mapping[str, float]) -> None:
    needing: dict[str, list[str]] = {}
    # All problems are collected first, so that a user corrects them in one round.
    unrated = [
        observable for observable in decomposition.observables if not decomposition.key_factors(observable)
    ]
    for observable in decomposition.observables:
        for row in decomposition.key_factors(observable):
            value = values.get(row.factor)
            # An absent thing needs no value, but an infinite or unknown number is none of the absent ones.
            if value is None and row.absent is not None:
                continue
            if value is None or not math.isfinite(value):
                needing.setdefault(row.factor, []).append(observable)
    faults = [_missing_value(decomposition, factor, affected) for factor, affected in needing.items()]
    if unrated:
        where = f"difficulty of {decomposition.name}: {', '.join(unrated)}"
        faults.append(
            Fault(
                where,
                "no key factors, so no difficulty",
                "give them key factor tables, or state difficulties with the runs",
            )
        )
    if faults:
        raise SetupError(faults)


def _missing_value(decomposition: Decomposition, factor: str, observables: list[str]) -> Fault:
    definition = FACTORS.get(factor)
    remedy = (
        f"it means: {definition.text} Add that to the SimSpec"
        if definition
        else "no SimSpec has this factor; correct the table"
    )
    return Fault(
        f"difficulty of {decomposition.name}: {', '.join(observables)}",
        f"the key factor {factor!r} has no value in this situation",
        remedy,
    )


def absence_of(observable: ObservableDifficulty) -> str:
    """Why the situation does not exercise an observable: factors of which it holds nothing, or no detections."""
    reasons = [
        f"{row.factor} has no value" if row.value is None else f"{row.factor} = {row.value:g} {row.unit}"
        for row in observable.absent
    ]
    if observable.undetected:
        reasons.append("perception.source is agent, so the bench makes no detections")
    return " and ".join(reasons)
