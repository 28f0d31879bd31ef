"""Rooms that import a module of theirs when one of its names is first used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_names(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package whose names live in `modules`, by name; each is a module of the package.

    Every worker and every Python agent is an interpreter of its own, and what it imports it pays again. The same names
    stand under TYPE_CHECKING, for people and type checkers; `tests/test_face.py` compares the two lists.
    """

    def fetch(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{modules[name]}"), name)
        # Kept as an ordinary attribute: the next use of `package.name` does not come here.
        setattr(sys.modules[package], name, value)
        return value

    return fetch
