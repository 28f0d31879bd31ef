"""Where in a SimSpec a key factor is read from: the fields that one would change to change it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from ._document import SimSpec
from ._factors import FACTORS

_STEP = re.compile(r"(?P<name>\w+)(?:\[(?P<pick>\w+|\*)\])?")


def factor_paths(simspec: SimSpec, factor: str) -> tuple[str, ...]:
    """The fields of this SimSpec that a key factor is read from, as a campaign's `sets` names them.

    Where the situation has none of them yet, what `FACTORS` says of it. KeyError for an unknown factor.
    """
    stated = FACTORS[factor].path
    for choice in stated.split(" else "):
        found = tuple(one for path in choice.split(", ") for one in _found(simspec, path.split("."), ""))
        if found:
            return found
    return (stated,)


def _found(here: Any, steps: list[str], before: str) -> Iterator[str]:
    """Every way in which the steps can be gone from here to something that is given."""
    if not steps:
        yield before.removeprefix(".")
        return
    match = _STEP.fullmatch(steps[0])
    assert match, steps[0]
    value = getattr(here, match["name"]) if isinstance(here, BaseModel) else None
    before = f"{before}.{match['name']}"
    if value is None:
        return
    if match["pick"] is None:
        yield from _found(value, steps[1:], before)
        return
    for index, member in enumerate(value):
        kinds = (getattr(member, "role", None), getattr(member, "kind", None))
        if match["pick"] == "*" or match["pick"] in kinds:
            yield from _found(member, steps[1:], f"{before}[{getattr(member, 'id', index)}]")
