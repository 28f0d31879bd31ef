"""A measure: a pure function from the tape to one number, with options that are checked before anything flies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin, get_type_hints

from bench.contracts import Evidence, Observation, Option, Tape
from bench.simspec import SimSpec

MAX_EVIDENCE = 20

O = TypeVar("O")  # noqa: E741 - the options of one measure


@dataclass(frozen=True, slots=True)
class Finding:
    """The measured value in [0, 1], None when the run is not considered, and where to look."""

    x: float | None
    evidence: tuple[Evidence, ...] = ()


@dataclass(frozen=True, slots=True)
class NoOptions:
    """Of a measure in which nothing can be chosen: the SimSpec says it all."""


def not_considered(reason: str) -> Finding:
    """The run offered nothing that could exercise the observable, and why."""
    return Finding(None, (Evidence(time_s=0.0, text=reason),))


def belief(right: int, wrong: int) -> float:
    """How far an agent is believed that said so many right and so many wrong things: wholly while half of it is right.

    Beyond that in proportion, so that guessing everywhere, where something must be right, gains nothing.
    """
    return min(1.0, right / wrong) if wrong else 1.0


@dataclass(frozen=True, slots=True)
class Measured(Generic[O]):
    """The entry point of one measure: its options are the fields of a frozen dataclass, a trailing underscore dropped."""

    name: str
    options: type[O]
    find: Callable[[Tape, SimSpec, O], Finding]

    def __call__(self, observable: str, tape: Tape, simspec: SimSpec, options: Mapping[str, Option]) -> Observation:
        found = self.find(tape, simspec, self.read_options(options))
        considered = found.x is not None
        return Observation(observable=observable, considered=considered, x=found.x, evidence=thinned(found.evidence))

    def check_options(self, options: Mapping[str, Option]) -> None:
        """Raise ValueError as `read_options` does."""
        self.read_options(options)

    def read_options(self, options: Mapping[str, Option]) -> O:
        """The options as their dataclass. Raises ValueError that names the measure, the option and what is known."""
        known = {field.name.rstrip("_"): field for field in fields(self.options)}  # type: ignore[arg-type]
        unknown = sorted(set(options) - set(known))
        if unknown:
            stated = f"known: {', '.join(known)}" if known else "it has no options"
            raise ValueError(f"measure {self.name!r}: unknown option {', '.join(map(repr, unknown))}; {stated}")
        missing = [name for name, field in known.items() if field.default is MISSING and name not in options]
        if missing:
            raise ValueError(f"measure {self.name!r}: needs option {', '.join(map(repr, missing))}")
        hints = get_type_hints(self.options)
        values = {known[name].name: self._checked(name, value, hints[known[name].name]) for name, value in options.items()}
        try:
            return self.options(**values)
        except ValueError as error:
            raise ValueError(f"measure {self.name!r}: {error}") from None

    def _checked(self, name: str, value: Option, kind: Any) -> Option:
        if get_origin(kind) is Literal:
            wanted, right = f"one of {', '.join(get_args(kind))}", value in get_args(kind)
        elif kind is str:
            wanted, right = "text", isinstance(value, str)
        elif kind is int:
            wanted, right = "a whole number, not negative", type(value) is int and value >= 0
        else:
            wanted, right = "a number, finite and not negative", _is_number(value)
        if not right:
            raise ValueError(f"measure {self.name!r}: option {name!r} is {value!r}; it must be {wanted}")
        return float(value) if kind is float else value


def thinned(items: Sequence[Evidence]) -> tuple[Evidence, ...]:
    """At most MAX_EVIDENCE of them, spread evenly, the first and the last among them."""
    if len(items) <= MAX_EVIDENCE:
        return tuple(items)
    step = (len(items) - 1) / (MAX_EVIDENCE - 1)
    return tuple(items[round(index * step)] for index in range(MAX_EVIDENCE))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and value >= 0
