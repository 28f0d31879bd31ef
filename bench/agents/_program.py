"""What an agent's manifest says about its program, compared with the files of this host."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from bench.contracts import AgentManifest
from bench.errors import Fault, SetupError, command_line

Options = Mapping[str, str | float | int | bool]

_OPTIONS_WITH_VALUES = ("-W", "-X", "--check-hash-based-pycs")
# Options without a value may stand in one word (-Bum); after -W and -X their value may.
_MODULE_OR_CODE = re.compile("-[A-VYZabd-ln-z]*[mc]")
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
    """The manifest's command, ready to be run. Raises SetupError as `expand_placeholders` does.

    A program with a slash and a script of the bench's Python are looked up from the manifest's folder: the agent starts
    in a folder of its own, which is empty. In an image they are the image's.
    """
    texts = {f"command[{index}]": part for index, part in enumerate(manifest.command)}
    command = list(expand_placeholders(manifest, folder, options, texts).values())
    if manifest.image:
        return tuple(command)
    if "/" in command[0]:
        # As pathlib does: a path that is absolute already stays.
        command[0] = str(folder / command[0])
    if (script := _script_place(command)) is not None:
        command[script] = str(folder / command[script])
    return tuple(command)


def _script_place(command: Sequence[str]) -> int | None:
    """Where the script stands that the bench's Python is to run; None for a module, and for any other program."""
    if command[0] != sys.executable:
        return None
    place = 1
    while place < len(command) and command[place].startswith("-"):
        if command[place] == "-" or _MODULE_OR_CODE.match(command[place]):
            return None
        place += 2 if command[place] in _OPTIONS_WITH_VALUES else 1
    return place if place < len(command) else None


def program_faults(manifest: AgentManifest, folder: Path, options: Options) -> list[Fault]:
    """Why the agent's command cannot be started here; empty if nothing is known against it.

    The program of a manifest with an image is in the image, so nothing is known of it.

    Looks for the program, and for the script or module that the bench's Python is to run; likewise for the command that
    fills a cache. Nothing is run or imported, so a program can still fail at its start.
    """
    faults = _command_faults(manifest, folder, options, "command")
    if manifest.cache is not None:
        faults += _command_faults(preparing(manifest), folder, options, "cache.prepare")
    return faults


def preparing(manifest: AgentManifest) -> AgentManifest:
    """The manifest of the command that fills an agent's cache: it meets no session."""
    assert manifest.cache is not None
    changes = {"command": manifest.cache.prepare, "mavlink": (), "zenoh": False, "reset": "process"}
    return manifest.model_copy(update=changes)


def _command_faults(manifest: AgentManifest, folder: Path, options: Options, field: str) -> list[Fault]:
    try:
        command = expand_command(manifest, folder, options)
        expand_placeholders(manifest, folder, options, manifest.environment)
    except SetupError as error:
        return list(error.faults)
    if manifest.image:
        return []
    where, program = f"{manifest.name}: {field}", command[0]
    path = shutil.which(program, path=os.environ.get("PATH", os.defpath))
    if path is None or not Path(path).is_file():
        if Path(program).is_absolute() and Path(program).is_file():
            return [Fault(where, f"{program} is not executable", f"chmod +x {shlex.quote(program)}")]
        remedy = _build_remedy(folder, program) or "install it, or correct the command in the manifest"
        return [Fault(where, f"there is no program {program!r}", remedy)]
    if program == sys.executable and command[1:2] == ("-m",) and len(command) > 2:
        # With another search path this process cannot tell what that one would find.
        if "PYTHONPATH" not in manifest.environment and not _has_module(command[2]):
            return [Fault(where, f"there is no Python module {command[2]!r}", "install its package")]
        return []
    return _script_faults(command, folder, where)


def _script_faults(command: Sequence[str], folder: Path, where: str) -> list[Fault]:
    """A fault if what an interpreter is to run is missing: a script of the bench's Python, or what a folder could build, as
    dist/agent.js.
    """
    is_python = command[0] == sys.executable
    place = _script_place(command) if is_python else 1
    if place is None or place >= len(command) or Path(command[place]).exists():
        return []
    remedy = _build_remedy(folder, command[place]) or is_python * "restore it, or correct the command"
    return [Fault(where, f"there is no file {command[place]}", remedy)] if remedy else []


def _build_remedy(folder: Path, program: str) -> str:
    """What builds a program that is missing in the manifest's folder, by the file there that says how; empty for none."""
    if not Path(program).is_relative_to(folder):
        return ""
    builds = {
        "Makefile": ("make", "-C", folder),
        "Cargo.toml": (
            *("cargo", "build", *(() if "debug" in Path(program).parts else ("--release",))),
            *("--manifest-path", folder / "Cargo.toml"),
        ),
    }
    for name, words in builds.items():
        if (folder / name).is_file():
            return f"build it: `{command_line(*words)}`"
    if (folder / "package.json").is_file():
        place = shlex.quote(str(folder))
        return f"build it: `cd {place} && npm install && npm run build --if-present`"
    return ""


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
    return _has_part([Path(place) for place in spec.submodule_search_locations or ()], rest)


def _has_part(places: Sequence[Path], parts: Sequence[str]) -> bool:
    """Whether a module of a package that lies at these places can be there."""
    if not parts:
        return True
    folders = [place for place in places if place.is_dir()]
    if not folders:
        # From an archive, or by an importer of its own: not for us to judge.
        return not places or any(place.exists() for place in places)
    part, *rest = parts
    if not any(path.name.split(".")[0] == part for folder in folders for path in folder.glob(f"{part}*")):
        return False
    within = [folder / part for folder in folders if (folder / part).is_dir()]
    return not within or _has_part(within, rest)


def _as_text(option: str | float | int | bool) -> str:
    return str(option).lower() if isinstance(option, bool) else str(option)
