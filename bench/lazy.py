"""Rooms that import a module of theirs when one of its names is first used."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

# One name a line, as the linter writes them.
_NAME = re.compile(r"^    from (\S+) import (\w+) as \2$", re.MULTILINE)


@cache
def declared_names(package: str) -> dict[str, str]:
    """The names that a lazy package declares under TYPE_CHECKING, each with the module that has it.

    From its source, so that people, type checkers and the interpreter read one list.
    """
    face: Any = sys.modules[package]
    source = face.__spec__.loader.get_data(face.__file__).decode()
    return {name: module for module, name in _NAME.findall(source)}


def lazy_names(package: str) -> Callable[[str], Any]:
    """The `__getattr__` of a package whose names live in its modules.

    Every worker and every Python agent is an interpreter of its own, and what it imports it pays again.
    """

    def fetch(name: str) -> Any:
        # What the import system asks of every package is answered without reading the source.
        if name.startswith("__") or name not in declared_names(package):
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(declared_names(package)[name], package), name)
        # Kept as an ordinary attribute: the next use of `package.name` does not come here.
        setattr(sys.modules[package], name, value)
        return value

    return fetch
