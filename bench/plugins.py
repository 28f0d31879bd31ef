"""The registry of plug-ins is the table of entry points in pyproject.toml; this reads it."""

from __future__ import annotations

import traceback
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from bench.errors import SetupError

PluginGroup = Literal[
    "rebar.vehicles",
    "rebar.measures",
    "rebar.agents",
    "rebar.assets",
    "rebar.scenes",
    "rebar.surrogates",
    "rebar.renderers",
    "rebar.detectors",
    "rebar.firmware",
    "rebar.tables",
    "rebar.commands",
    "rebar.documents",
]

# Plug-ins of packages in examples/, of which the bench's pages speak: whoever asks for one is told how to get it.
EXAMPLES: dict[tuple[PluginGroup, str], str] = {
    ("rebar.commands", "export-rerun"): "examples/rerun_export",
    ("rebar.commands", "fit-detector"): "examples/detector_fit",
    ("rebar.detectors", "grounded"): "examples/grounded_detector",
    ("rebar.firmware", "px4-board"): "examples/boards",
    ("rebar.renderers", "moderngl"): "examples/gl_renderer",
}


# What is installed does not change under a running process, and looking costs tens of milliseconds.
@cache
def plugins(group: PluginGroup) -> dict[str, EntryPoint]:
    """Every plug-in declared for the group, by name, without importing any.

    Not to be changed by the caller.
    """
    return {entry.name: entry for entry in entry_points(group=group)}


def load_plugin(group: PluginGroup, name: str) -> Any:
    """The object behind an entry point.

    Raises SetupError, naming what there is, when there is none of that name, or saying why it cannot be imported.
    """
    available = plugins(group)
    if name not in available:
        raise SetupError(
            group,
            f"there is no plug-in named {name!r}",
            remedy_for(group, name),
        )
    try:
        return available[name].load()
    # Code of others runs here.
    except Exception as error:
        what = f"{name!r} of {package_of(group, name)} cannot be imported: {failure_text(error)}"
        raise SetupError(group, what, "fix the package, or install it again") from error


def remedy_for(group: PluginGroup, name: str) -> str:
    """For a plug-in that is not installed: what is, and how to install one of a package in examples/."""
    example = EXAMPLES.get((group, name))
    how = f"pip install {example}" if example else "or install its package"
    return f"installed: {', '.join(sorted(plugins(group))) or 'none'}; {how}"


def package_of(group: PluginGroup, name: str) -> str:
    """The name of the installed package that declares a plug-in."""
    package = plugins(group)[name].dist
    return package.name if package is not None else "an unknown package"


def failure_text(error: BaseException) -> str:
    """An exception with the file and the line that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {error}{place}"
