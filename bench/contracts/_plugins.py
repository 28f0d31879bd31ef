"""The registry of plug-ins is the table of entry points in pyproject.toml; this reads it."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from bench.errors import Fault, SetupError

PluginGroup = Literal[
    "rebar.vehicles",
    "rebar.measures",
    "rebar.agents",
    "rebar.scenes",
    "rebar.surrogates",
    "rebar.renderers",
    "rebar.detectors",
]


# What is installed does not change under a running process, and looking costs tens of milliseconds.
@cache
def plugins(group: PluginGroup) -> dict[str, EntryPoint]:
    """Every plug-in declared for the group, by name, without importing any.

    Not to be changed by the caller.
    """
    return {entry.name: entry for entry in entry_points(group=group)}


def load_plugin(group: PluginGroup, name: str) -> Any:
    """The object behind an entry point.

    Raises SetupError, naming what there is, when there is none of that name.
    """
    available = plugins(group)
    if name not in available:
        raise SetupError(
            Fault(
                group,
                f"there is no plug-in named {name!r}",
                f"installed: {', '.join(sorted(available)) or 'none'}",
            )
        )
    return available[name].load()
