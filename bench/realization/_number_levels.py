"""Levels that are the text of a number, made numbers where every field that takes them does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError

from bench.documents import validate_document
from bench.errors import SetupError
from bench.simspec import SimSpec

from ._realize import Bases
from .design._design import Design
from .design._factors import DesignFactor, FactorLevel
from .design._spec_paths import find_path


def with_number_levels(base: Bases, design: Design) -> Design:
    """The design in which a level such as '20' is 20 where all fields that its factor sets take it as a number.

    Such a field is set to 20, so the level is 20 in formulas and statistics too. Raises SetupError where two levels are
    the same number.
    """
    bases = [base] if isinstance(base, SimSpec) else list(base.values())
    factors = [_with_numbers(factor, bases) for factor in design.factors]
    if all(new is old for new, old in zip(factors, design.factors, strict=True)):
        return design
    document = design.model_dump() | {"factors": [factor.model_dump() for factor in factors]}
    return validate_document(document, Design, source="design")


def _with_numbers(factor: DesignFactor, bases: Sequence[SimSpec]) -> DesignFactor:
    # With patches, levels are the names of the patches.
    if factor.patches or not any(map(_is_number_text, factor.levels)):
        return factor
    levels = [
        _as_taken(level, factor.sets, bases) if _is_number_text(level) else level for level in factor.levels
    ]
    # A copy is not validated: a level that stands twice is found when the design is.
    return factor.model_copy(update={"levels": tuple(levels)})


def _is_number_text(level: FactorLevel) -> bool:
    try:
        return isinstance(level, str) and math.isfinite(float(level))
    except ValueError:
        return False


def _as_taken(level: FactorLevel, paths: Sequence[str], bases: Sequence[SimSpec]) -> FactorLevel:
    taken = [value for base in bases for path in paths if (value := _taken(base, path, level)) is not None]
    are_numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in taken)
    return taken[0] if taken and are_numbers else level


def _taken(base: SimSpec, path: str, level: FactorLevel) -> Any:
    """What the field at a path makes of a level; the level itself where it is refused, None without such a field."""
    try:
        steps = find_path(base, path).steps
    except SetupError:
        return None
    value: Any = base
    annotation: Any = SimSpec
    for step in steps:
        if isinstance(value, BaseModel):
            annotation = type(value).model_fields[str(step)].annotation
            value = getattr(value, str(step))
        elif isinstance(value, dict):
            annotation, value = get_args(annotation)[1], value.get(step)
        else:
            value = value[step]
    try:
        return TypeAdapter(annotation).validate_python(level)
    except ValidationError:
        return level
