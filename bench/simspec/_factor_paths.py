"""The fields of a SimSpec that decide the value of a key factor."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from ._document import SimSpec
from ._factors import FACTORS

_STEP = re.compile(r"(?P<name>\w+)(?:\[(?P<pick>\w+|\*)\])?")


def factor_paths(simspec: SimSpec, factor: str) -> tuple[str, ...]:
    """The fields of this SimSpec that decide a key factor, in the notation of a campaign's `sets`.

    If the situation has none of the fields, the path of `FACTORS` as it is. Raises KeyError for an unknown
    factor.
    """
    stated_path = FACTORS[factor].path
    escorted = "" if simspec.mission.escort is None else simspec.mission.escort.group
    for alternative in stated_path.split(" else "):
        fields = tuple(
            field
            for path in alternative.split(", ")
            for field in _given_fields(simspec, path.split("."), "", escorted)
        )
        if fields:
            return fields
    return (stated_path,)


def _given_fields(part: Any, steps: list[str], prefix: str, escorted: str) -> Iterator[str]:
    """The path of every field that the steps lead to from `part`; fields that are not given are left out.

    `escorted` is the id of the escorted group, empty without one.
    """
    if not steps:
        yield prefix.removeprefix(".")
        return
    match = _STEP.fullmatch(steps[0])
    # The paths are constants of FACTORS, so a step that does not match is a mistake there and not in the
    # SimSpec.
    assert match, steps[0]
    value = getattr(part, match["name"]) if isinstance(part, BaseModel) else None
    prefix = f"{prefix}.{match['name']}"
    if value is None:
        return
    if match["pick"] is None:
        yield from _given_fields(value, steps[1:], prefix, escorted)
        return
    for index, member in enumerate(value):
        selectors = [getattr(member, "role", None), getattr(member, "kind", None)]
        if escorted and getattr(member, "id", None) == escorted:
            selectors.append("escorted")
        if match["pick"] == "*" or match["pick"] in selectors:
            # By its id where the member has one: an index would change its meaning when a member is inserted.
            yield from _given_fields(member, steps[1:], f"{prefix}[{getattr(member, 'id', index)}]", escorted)
