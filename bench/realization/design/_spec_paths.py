"""Paths into a SimSpec: `environment.fog_level`, `actors[targets].concealment` (by id or number)."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from bench.errors import SetupError
from bench.simspec import SimSpec

_PART = re.compile(r"(?P<name>[A-Za-z_][A-Za-z0-9_]*)(?:\[(?P<member>[A-Za-z0-9_-]+)\])?")

# Fields that realization itself writes into every SimSpec; factors may not set them.
OWNED = ("format", "name", "realized", "agent", "seeds.root")

# Units by the suffix of a field's name. The first match wins, so longer suffixes come first.
UNITS = {
    "per_m": "1/m",
    "per_km2": "1/km2",
    "m": "m",
    "mps": "m/s",
    "s": "s",
    "deg": "deg",
    "hz": "Hz",
    "px": "px",
    "wh": "Wh",
    "level": "level",
}


@dataclass(frozen=True, slots=True)
class SpecPath:
    """A path that exists in a base SimSpec, as keys and indices of its plain-value form."""

    text: str
    steps: tuple[str | int, ...]

    @property
    def unit(self) -> str | None:
        """The unit in the field's name; None when the name states none."""
        last = next(step for step in reversed(self.steps) if isinstance(step, str))
        return next((unit for end, unit in UNITS.items() if last.endswith(f"_{end}")), None)

    @property
    def open(self) -> bool:
        """Whether it leads into the vehicle's free-form parameters, whose names state no units."""
        return self.steps[:2] == ("vehicle", "parameters")

    def set(self, document: Any, value: object) -> None:
        """Write a value into plain values that have the base's shape."""
        for step in self.steps[:-1]:
            document = document[step]
        document[self.steps[-1]] = value


def find_path(base: SimSpec, text: str) -> SpecPath:
    """The path in `base`. Raises SetupError when it does not exist or realization itself writes it."""
    owned = next((field for field in OWNED if text == field or text.startswith(f"{field}.")), None)
    if owned:
        what = f"{owned} is written by realization itself"
        raise SetupError(text, what, "agents, names and seeds come from the campaign")
    value: Any = base
    steps: list[str | int] = []
    for part in text.split("."):
        match = _PART.fullmatch(part)
        if match is None:
            raise SetupError(text, f"{part!r} is not a step of a path", "write field.field or list[id].field")
        value = _field(value, match["name"], steps)
        steps.append(match["name"])
        if match["member"] is not None:
            value, index = _member(value, match["member"], steps)
            steps.append(index)
    return SpecPath(text, tuple(steps))


def _field(value: Any, name: str, steps: list[str | int]) -> Any:
    where = _dotted(steps) or "the SimSpec"
    if isinstance(value, dict):
        # An open table such as vehicle.parameters takes any key.
        return value.get(name)
    if value is None:
        remedy = "write it there, so that the factor has something to change"
        raise SetupError(where, f"{where} is not given in the base SimSpec", remedy)
    if not isinstance(value, BaseModel):
        what = f"{where} is a plain value and has no field {name!r}"
        raise SetupError(where, what, f"end the path at {where}")
    fields = type(value).model_fields
    if name not in fields:
        raise SetupError(where, f"{where} has no field {name!r}", _nearest(name, fields))
    return getattr(value, name)


def _member(value: Any, member: str, steps: list[str | int]) -> tuple[Any, int]:
    where = _dotted(steps)
    if not isinstance(value, tuple):
        raise SetupError(where, f"{where} is not a list", f"drop [{member}]")
    ids = [getattr(item, "id", str(index)) for index, item in enumerate(value)]
    # Ids take precedence over numbers, because an id may consist of digits.
    if member in ids:
        index = ids.index(member)
    elif member.isdigit() and int(member) < len(value):
        index = int(member)
    else:
        raise SetupError(where, f"{where} has no member {member!r}", _nearest(member, ids))
    return value[index], index


def _nearest(name: str, candidates: Iterable[str]) -> str:
    candidates = list(candidates)
    close = difflib.get_close_matches(name, candidates, n=1)
    return f"did you mean {close[0]}?" if close else f"there are: {', '.join(candidates) or 'none'}"


def _dotted(steps: list[str | int]) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps).removeprefix(".")
