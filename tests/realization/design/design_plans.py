"""Designs of a few plain factors, as documents state them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.documents import validate_document
from bench.errors import SetupError
from bench.realization import Design


def ranges(count: int, **fields: Any) -> list[dict[str, Any]]:
    """Factors f0, f1 ... from 0 to 1, each of its own field."""
    return [
        {"name": f"f{place}", "range": {"low": 0.0, "high": 1.0, **fields}, "sets": [f"x{place}"]}
        for place in range(count)
    ]


def levels(name: str, *values: object, **fields: Any) -> dict[str, Any]:
    """A factor with these levels."""
    return {"name": name, "levels": list(values), "sets": [name], **fields}


def design(factors: list[dict[str, Any]], **fields: Any) -> Design:
    return validate_document({"factors": factors, **fields}, Design)


def refused(factors: list[dict[str, Any]], **fields: Any) -> str:
    """Why a design is refused."""
    with pytest.raises(SetupError) as refusal:
        design(factors, **fields)
    return str(refusal.value)


def matrix(plan: Design) -> NDArray[np.float64]:
    """Levels of a design of numbers: a row for each point, a column for each factor."""
    return np.array([[float(level) for level in point.levels.values()] for point in plan.points()])


# Conditional, derived and forbidden levels at once: each may make another one impossible.
TANGLED = [
    levels("gps", "good", "degraded", "none"),
    levels("noise", 1, 2, 3, when="gps == 'degraded'"),
    levels("approach", "N", "E", "S", "W"),
    levels("fog", 0, 2, 4),
    levels("night", True, False),
    {"name": "load", "formula": "fog * 2 + (1 if night else 0)", "sets": ["load"]},
]
FORBID = ["approach == 'N' and fog > 1", "load > 8", "noise == 3 and approach == 'S'"]
WHOLE = {"name": "whole", "range": {"low": 3, "high": 6, "integer": True}, "sets": ["whole"]}


def rated(chosen: Any) -> dict[str, float]:
    """A difficulty in which most of the range is easy."""
    return {"KA-1": 20.0 if chosen["f0"] < 0.8 else 60.0, "KA-2": 20.0 if chosen["a"] == "x" else 90.0}
