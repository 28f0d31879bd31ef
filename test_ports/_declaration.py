"""`@measure`: how a measure is declared.

One decorated function says its name, its options and what it measures.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from bench.contracts import Evidence, Observation, Option, Tape
from bench.simspec import SimSpec

T = TypeVar("T")

MAX_EVIDENCE = 20
"""Moments that an observation keeps: as many as a reviewer looks through, of thousands."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Value in [0, 1], None when not considered; moments to look at; how far the agent came (`stages.py`)."""

    x: float | None
    evidence: tuple[Evidence, ...] = ()
    stages: str = ""


def not_considered(reason: str) -> Finding:
    """The finding for a run that offered nothing to exercise the observable, with the reason."""
    return Finding(None, (Evidence(time_s=0.0, text=reason),))


class NotConsidered(Exception):
    """Ends a measure whose run offered nothing to exercise the observable; the text is the reason."""


def consider(occasion: object, reason: str) -> None:
    """Go on where there is an occasion. Raises NotConsidered, inside a measure alone, where there is none."""
    if not occasion:
        raise NotConsidered(reason)


def shown(x: float, time_s: float, text: str) -> Finding:
    """A value with the one moment that shows it."""
    return Finding(x, (Evidence(time_s=time_s, text=text),))


def nothing_shown(time_s: float, reason: str) -> Finding:
    """The finding 0 for a run in which the agent had the occasion and showed nothing, with the reason."""
    return shown(0.0, time_s, reason)


@dataclass(frozen=True, slots=True)
class Limit:
    """A condition on an option beside its kind: `Annotated[float, Limit(is_valid, "more than 0")]`."""

    is_valid: Callable[[Any], bool]
    requirement: str


Positive = Annotated[float, Limit(lambda value: value > 0.0, "a number more than 0")]


@dataclass(frozen=True, slots=True)
class DeclaredOption:
    """One option of a measure. `default` is None when a decomposition must set it."""

    name: str
    parameter: str
    kind: Any
    default: Option | None
    limit: Limit | None

    def __str__(self) -> str:
        """The name, the values to choose from, and the default if there is one."""
        text = self.name
        if get_origin(self.kind) is Literal:
            text += f": {', '.join(map(_value_text, get_args(self.kind)))}"
        return f"{text} ({'must be set' if self.default is None else _value_text(self.default)})"

    def read(self, value: Option) -> Option:
        """The value as the measure takes it. Raises ValueError that says what is valid."""
        # The kind comes first: a limit may compare numbers, and would fail on a text.
        valid, requirement = self._matches_kind(value)
        if valid and self.limit is not None:
            valid, requirement = self.limit.is_valid(value), self.limit.requirement
        if not valid:
            raise ValueError(f"option {self.name!r} is {value!r}; it must be {requirement}")
        return float(value) if self.kind is float else value

    def _matches_kind(self, value: Option) -> tuple[bool, str]:
        if get_origin(self.kind) is Literal:
            return value in get_args(self.kind), f"one of {', '.join(get_args(self.kind))}"
        if self.kind is str:
            return isinstance(value, str), "text"
        if self.kind is bool:
            return isinstance(value, bool), "true or false"
        if self.kind is int:
            return type(value) is int and value >= 0, "a whole number, not negative"
        # bool is a subclass of int in Python, and true is no number in a decomposition.
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False, "a number, finite and not negative"
        return math.isfinite(value) and value >= 0, "a number, finite and not negative"


@dataclass(frozen=True, slots=True)
class DeclaredMeasure:
    """A measure, as the entry-point group `rebar.measures` holds it. `find` is the decorated function."""

    name: str
    options: tuple[DeclaredOption, ...]
    find: Callable[..., Finding]

    def __call__(
        self, observable: str, tape: Tape, simspec: SimSpec, options: Mapping[str, Option]
    ) -> Observation:
        """Measure one run. Raises ValueError as `check_options` does."""
        try:
            finding = self.find(tape, simspec, **self._read(options))
        except NotConsidered as reason:
            finding = not_considered(str(reason))
        evidence = thinned(finding.evidence)
        return Observation(
            observable=observable,
            considered=finding.x is not None,
            x=finding.x,
            evidence=evidence,
            stages=finding.stages,
        )

    def check_options(self, options: Mapping[str, Option]) -> None:
        """Raise ValueError, naming measure, option and what is known, for an unknown or wrong one."""
        self._read(options)

    @property
    def description(self) -> str:
        """What it measures, from the docstring of its function."""
        return inspect.getdoc(self.find) or ""

    @property
    def explanation(self) -> str:
        """The description and the options with their kinds and defaults, as `rebar measures` prints them."""
        options = "".join(f"\n- {option}" for option in self.options)
        return f"{self.description}\n\nOptions (default):{options or ' none'}"

    @property
    def conventions(self) -> str:
        """What its module says about all its measures, behind the first paragraph of the docstring."""
        return (inspect.getdoc(inspect.getmodule(self.find)) or "").partition("\n\n")[2]

    def _read(self, options: Mapping[str, Option]) -> dict[str, Option]:
        known = {option.name: option for option in self.options}
        if unknown := sorted(set(options) - set(known)):
            stated = f"known: {', '.join(known)}" if known else "it has no options"
            named = ", ".join(map(repr, unknown))
            raise ValueError(f"measure {self.name!r}: unknown option {named}; {stated}")
        required = [name for name, option in known.items() if option.default is None]
        if missing := [name for name in required if name not in options]:
            raise ValueError(f"measure {self.name!r}: needs option {', '.join(map(repr, missing))}")
        try:
            return {known[name].parameter: known[name].read(value) for name, value in options.items()}
        except ValueError as error:
            raise ValueError(f"measure {self.name!r}: {error}") from None


def _value_text(value: Option) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value) or '""'


def measure(function: Callable[..., Finding]) -> DeclaredMeasure:
    """Declare a measure: a pure function `(tape, simspec, *, option: kind = default, ...) -> Finding`.

    Its name is the function's name, its options are the keyword-only parameters, and `rebar measures` prints
    its docstring. A kind is `float`, `int` (neither negative), `str`, `bool` or a `Literal` of texts, or one
    of these `Annotated` with a `Limit`. A trailing underscore of a parameter is dropped, so that an option
    can be called `class`. Raises TypeError for another signature.
    """
    name, parameters = function.__name__, inspect.signature(function).parameters.values()
    options = [parameter for parameter in parameters if parameter.kind is inspect.Parameter.KEYWORD_ONLY]
    if len(parameters) - len(options) != 2:
        raise TypeError(f"measure {name!r} must take the tape, the SimSpec, and options after a '*'")
    # get_type_hints resolves names that are left as text; it needs them at module level.
    kinds = get_type_hints(function, include_extras=True)
    declared = tuple(_option(name, parameter, kinds.get(parameter.name)) for parameter in options)
    return DeclaredMeasure(name, declared, function)


def _option(measure_name: str, parameter: inspect.Parameter, annotation: Any) -> DeclaredOption:
    limit = None
    if get_origin(annotation) is Annotated:
        annotation, *extras = get_args(annotation)
        limit = next((extra for extra in extras if isinstance(extra, Limit)), None)
    if annotation not in (float, int, str, bool) and get_origin(annotation) is not Literal:
        raise TypeError(
            f"measure {measure_name!r}: parameter {parameter.name!r} must be float, int, str, bool or a Literal"
        )
    # None can stand for "no default" because no option of a decomposition is null.
    default = None if parameter.default is inspect.Parameter.empty else parameter.default
    return DeclaredOption(parameter.name.rstrip("_"), parameter.name, annotation, default, limit)


def thinned(moments: Sequence[T]) -> tuple[T, ...]:
    """At most `MAX_EVIDENCE` of the moments, spread evenly, with the first and the last among them."""
    if len(moments) <= MAX_EVIDENCE:
        return tuple(moments)
    step = (len(moments) - 1) / (MAX_EVIDENCE - 1)
    return tuple(moments[round(index * step)] for index in range(MAX_EVIDENCE))
