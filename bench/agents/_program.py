"""What an agent's manifest says about its program, compared with the files of this host."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from bench.contracts import AgentManifest
from bench.errors import Fault, SetupError

Options = Mapping[str, str | float | int | bool]

_PLACEHOLDER = re.compile(r"\{(python|folder|option:([A-Za-z0-9_.-]+))\}")


def expand_placeholders(
    manifest: AgentManifest, folder: Path, options: Options, texts: Mapping[str, str]
) -> dict[str, str]:
    """The texts with `{python}`, `{folder}` and `{option:NAME}` filled in; their keys name them in faults.

    Raises SetupError with every option that is not in `options`.
    """
    faults = []

    def value(where: str, match: re.Match[str]) -> str:
        if match[1] == "python":
            return sys.executable
        if match[1] == "folder":
            return str(folder)
        if match[2] in options:
            return _as_text(options[match[2]])
        known = ", ".join(sorted(options)) or "none"
        faults.append(
            Fault(
                f"{manifest.name}: {where}",
                f"needs the option {match[2]!r}, which the SimSpec does not give",
                f"add it under agent.options (there now: {known})",
            )
        )
        return ""

    expanded = {where: _PLACEHOLDER.sub(partial(value, where), text) for where, text in texts.items()}
    if faults:
        raise SetupError(faults)
    return expanded


def expand_command(manifest: AgentManifest, folder: Path, options: Options) -> tuple[str, ...]:
    """The manifest's command, ready to be run. Raises SetupError as `expand_placeholders` does."""
    texts = {f"command[{index}]": part for index, part in enumerate(manifest.command)}
    return tuple(expand_placeholders(manifest, folder, options, texts).values())


def program_faults(manifest: AgentManifest, folder: Path, options: Options) -> list[Fault]:
    """Why the agent's command cannot be started here; empty if nothing is known against it.

    The program of a manifest with an image is in the image, so nothing is known of it.

    Looks for the program, and for the script or module that the bench's Python is to run. Nothing is run or
    imported, so a program can still fail at its start.
    """
    try:
        command = expand_command(manifest, folder, options)
        expand_placeholders(manifest, folder, options, manifest.environment)
    except SetupError as error:
        return list(error.faults)
    if manifest.image:
        return []
    where, program = f"{manifest.name}: command", command[0]
    if shutil.which(program, path=os.environ.get("PATH", os.defpath)) is None:
        remedy = "install it, or correct the command in the manifest"
        return [Fault(where, f"there is no program {program!r}", remedy)]
    if program != sys.executable or len(command) == 1:
        return []
    if command[1] == "-m" and len(command) > 2:
        # With another search path this process cannot tell what that one would find.
        if "PYTHONPATH" not in manifest.environment and not _has_module(command[2]):
            return [Fault(where, f"there is no Python module {command[2]!r}", "install its package")]
    elif not command[1].startswith("-") and Path(command[1]).is_absolute() and not Path(command[1]).exists():
        return [Fault(where, f"there is no file {command[1]}", "restore it, or correct the command")]
    return []


def _has_module(name: str) -> bool:
    package, *rest = name.split(".")
    # Only of the first part: asking for a submodule would import its parents, and the bench imports no agent.
    importlib.invalidate_caches()
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:
        return True
    if spec is None:
        return False
    # A package that is imported already keeps its spec after its files are gone.
    if spec.has_location and spec.origin is not None and not Path(spec.origin).exists():
        return False
    places = [Path(place) for place in spec.submodule_search_locations or ()]
    for part in rest:
        if not any(place.is_dir() for place in places):
            # From an archive, or by an importer of its own: not for us to judge.
            return not places or any(place.exists() for place in places)
        nearby = [path for place in places for path in place.glob(f"{part}*")]
        if not any(path.name.split(".")[0] == part for path in nearby):
            return False
        places = [place / part for place in places]
        if not any(place.is_dir() for place in places):
            return True
    return True


def _as_text(option: str | float | int | bool) -> str:
    return str(option).lower() if isinstance(option, bool) else str(option)
