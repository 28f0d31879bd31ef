"""Rooms that import a module of theirs when one of its names is first used."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

_DECLARED_NAME = re.compile(r"^    from (\.[\w.]+) import \w+ as (\w+)$", re.MULTILINE)


def lazy_names(package: str) -> Callable[[str], Any]:
    """The `__getattr__` of a package whose file imports its names under TYPE_CHECKING, one on each line.

    Every worker and every Python agent is an interpreter of its own, and what it imports it pays again. The names stand
    once, for people, type checkers and this function: to read them takes 0.1 ms (171 names).
    """

    @cache
    def modules() -> dict[str, str]:
        source = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
        return {name: module for module, name in _DECLARED_NAME.findall(source)}

    def fetch(name: str) -> Any:
        if name not in modules():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(modules()[name], package), name)
        # Kept as an ordinary attribute: the next use of `package.name` does not come here.
        setattr(sys.modules[package], name, value)
        return value

    return fetch
