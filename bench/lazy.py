"""Rooms that import a module of theirs when one of its names is first used."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

_DECLARATION = re.compile(r"^    from \.([\w.]+) import \w+ as (\w+)$", re.MULTILINE)


def declared_names(package: str) -> dict[str, str]:
    """The names that stand under TYPE_CHECKING in a package, for people and type checkers, each with its module.

    Read from the source, so that each name is stated once: 0.1 ms for the largest room.
    """
    with open(str(sys.modules[package].__file__), encoding="utf-8") as file:
        source = file.read()
    return {name: module for module, name in _DECLARATION.findall(source)}


def lazy_names(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package whose names live in `modules`, by name; each is a module of the package.

    Every worker and every Python agent is an interpreter of its own, and what it imports it pays again.
    """

    def fetch(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{modules[name]}"), name)
        # Kept as an ordinary attribute: the next use of `package.name` does not come here.
        setattr(sys.modules[package], name, value)
        return value

    return fetch
