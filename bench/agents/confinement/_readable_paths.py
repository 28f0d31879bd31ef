"""Which files of the host an agent's program needs, derived from its command."""

from __future__ import annotations

import ast
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

# What a dynamically linked program needs, and what looks up names. Node does not start without openssl.cnf, Java without
# its settings, which distributions keep here.
SYSTEM_FILES = (
    *(
        Path("/etc", name)
        for name in ("ld.so.cache", "ssl/certs", "ssl/openssl.cnf", "localtime", "alternatives", "fonts")
    ),
    *sorted(Path("/etc").glob("java*")),
)
# How many processors there are: Node, Java and thread pools start no thread where they count none.
PROCESSORS = Path("/sys/devices/system/cpu")
SYSTEM_FOLDERS = tuple(Path("/", name) for name in ("usr", "bin", "sbin", "lib", "lib32", "lib64"))
# A folder with one of these holds sessions of the bench.
_MARKS_OF_SESSIONS = ("journal.sqlite", "recording.mcap", "simspec.json", "simspecs")
# Below a folder that an agent may read, sessions are looked for this deep; deeper is another program's tree.
_SEARCH_DEPTH = 4
_NEVER_SEARCHED = frozenset({".git", "node_modules", "site-packages", "__pycache__"})
_PACKAGE_FOLDERS = ("site-packages", "dist-packages")


def find_program(command: str, environment: Mapping[str, str], folder: Path) -> Path | None:
    """The program's path, as a shell in `folder` would find it by the agent's PATH; None if there is none."""
    if "/" in command:
        path = folder / command
        return path if path.is_file() and os.access(path, os.X_OK) else None
    path_text = shutil.which(command, path=environment.get("PATH", os.defpath))
    return Path(path_text).absolute() if path_text else None


def program_paths(program: Path, environment: Mapping[str, str]) -> list[Path]:
    """What must be readable for a program to start: its file, its interpreter's, and a Python's folders."""
    paths = [program]
    interpreter = program if _is_python(program) else _interpreter(program, environment)
    if interpreter is not None and interpreter != program:
        paths.append(interpreter)
    if interpreter is not None and _is_python(interpreter):
        paths += _python_paths(interpreter)
        for entry in environment.get("PYTHONPATH", "").split(os.pathsep):
            if entry:
                paths += _import_paths(Path(entry))
    return paths


def without_sessions(path: Path, hidden: Iterable[Path]) -> list[Path]:
    """`path`, or as much of what is in it as leaves out `hidden` and every folder that holds sessions.

    A folder that holds such a one is given as its entries, so what is made in it later is not readable.
    """
    if not path.is_dir():
        return [path]
    secrets = {folder.resolve() for folder in hidden} | set(_session_folders(path.resolve(), _SEARCH_DEPTH))
    return list(_spared(path, secrets))


def with_targets(paths: Iterable[Path]) -> list[Path]:
    """The paths and what they are links to, without those that lie in another one or do not exist."""
    wanted: dict[Path, None] = {}
    for path in paths:
        if path.exists():
            wanted |= {path.absolute(): None, path.resolve(): None}
    folders = {path for path in wanted if path.is_dir() and not path.is_symlink()}
    kept = [path for path in wanted if not any(parent in folders for parent in path.parents)]
    return [path for path in kept if not any(path.is_relative_to(folder) for folder in SYSTEM_FOLDERS)]


def gpu_devices() -> list[Path]:
    """Device files of graphics processors, and the folders by which their libraries find them."""
    devices = [*Path("/dev").glob("nvidia*"), *Path("/dev").glob("kfd"), *Path("/dev").glob("dri")]
    return sorted(devices)


def readable_by_others(path: Path) -> bool:
    """Whether a user who owns nothing can read the path, once reached."""
    with suppress(OSError):
        mode = path.stat().st_mode
        needed = 0o5 if stat.S_ISDIR(mode) else 0o4
        return mode & needed == needed
    return False


def reachable_by_others(path: Path) -> bool:
    """Whether a user who owns nothing can reach the path."""
    with suppress(OSError):
        return all(parent.stat().st_mode & 0o1 for parent in path.resolve().parents)
    return False


def _spared(path: Path, secrets: set[Path]) -> Iterator[Path]:
    real = path.resolve()
    if real in secrets:
        return
    if not any(real in secret.parents for secret in secrets):
        yield path
        return
    with suppress(OSError):
        for entry in sorted(path.iterdir()):
            yield from _spared(entry, secrets)


def _session_folders(path: Path, depth: int) -> Iterator[Path]:
    if any((path / mark).exists() for mark in _MARKS_OF_SESSIONS):
        yield path
        return
    if depth == 0:
        return
    with suppress(OSError), os.scandir(path) as entries:
        for entry in entries:
            if entry.name not in _NEVER_SEARCHED and entry.is_dir(follow_symlinks=False):
                yield from _session_folders(Path(entry.path), depth - 1)


def _is_python(program: Path) -> bool:
    return re.fullmatch(r"python[0-9.]*t?", program.name) is not None


def _interpreter(program: Path, environment: Mapping[str, str]) -> Path | None:
    """The program of the first line of a script; None for a binary."""
    try:
        with program.open("rb") as file:
            head = file.read(512)
    except OSError:
        return None
    if not head.startswith(b"#!"):
        return None
    words = head[2:].split(b"\n")[0].decode(errors="replace").split()
    if words and Path(words[0]).name == "env":
        words = [word for word in words[1:] if not word.startswith("-") and "=" not in word]
    return find_program(words[0], environment, Path("/")) if words else None


def _python_paths(interpreter: Path) -> list[Path]:
    """Folders of a Python: its environment, the installation under that, and what .pth files add."""
    paths: list[Path] = []
    environment = interpreter.parent.parent
    settings = environment / "pyvenv.cfg"
    if settings.is_file():
        # The environment's parts and not its folder, which may be a whole checkout ("python -m venv .").
        # A missing part would count as one that others cannot read, and root's agents would have no user of their own.
        parts = (environment / part for part in ("bin", "include", "lib", "lib64", "share"))
        paths += [settings, *(part for part in parts if part.exists())]
        values = dict(
            line.split(" = ", 1) for line in settings.read_text("utf-8").splitlines() if " = " in line
        )
        home = Path(values.get("home", "/usr/bin"))
        if values.get("include-system-site-packages") == "true" or not home.is_relative_to("/usr"):
            paths += _installation(home / interpreter.name)
    paths += _installation(interpreter.resolve())
    # Most environments' `lib64` is their `lib`, and their installation the one that the interpreter is a link to.
    paths = list(dict.fromkeys(paths))
    sites: dict[Path, Path] = {}
    for site in [site for path in paths for site in _site_folders(path)]:
        sites.setdefault(site.resolve(), site)
    for folder in sites.values():
        for pth in sorted(folder.glob("*.pth")):
            paths += [target for line in _added_paths(pth) for target in _import_paths(folder / line)]
        for finder in sorted(folder.glob("__editable__*_finder.py")):
            paths += _mapped_paths(finder)
    return paths


def _installation(interpreter: Path) -> list[Path]:
    """The parts of the prefix of an interpreter that belong to Python."""
    prefix = interpreter.parent.parent
    libraries = [*prefix.glob("lib/python3*"), *prefix.glob("lib64/python3*"), *prefix.glob("lib/lib*.so*")]
    return [interpreter.parent, *libraries]


def _site_folders(path: Path) -> list[Path]:
    """The folders of packages in a `lib` or `lib/python3.X`; files of the others have no such names."""
    if not path.is_dir():
        return []
    parents = [path, *path.glob("python3*")]
    return [site for parent in parents for name in _PACKAGE_FOLDERS if (site := parent / name).is_dir()]


def _added_paths(pth: Path) -> list[str]:
    with suppress(OSError, UnicodeDecodeError):
        lines = [line.strip() for line in pth.read_text("utf-8").splitlines()]
        return [line for line in lines if line and not line.startswith(("#", "import ", "import\t"))]
    return []


def _import_paths(folder: Path) -> list[Path]:
    """What can be imported from a folder of the search path. Of a checkout these are its packages alone: it
    also holds campaigns, examples and results, which are not for agents.
    """
    if folder.name in _PACKAGE_FOLDERS or not folder.is_dir():
        return [folder]
    entries = sorted(folder.iterdir())
    modules = [entry for entry in entries if entry.suffix in (".py", ".so") and entry.is_file()]
    return [*modules, *(entry for entry in entries if (entry / "__init__.py").is_file())]


def _mapped_paths(finder: Path) -> list[Path]:
    """Packages of an editable installation by setuptools, which keeps them in a dictionary of a module."""
    with suppress(OSError, SyntaxError, ValueError):
        for statement in ast.parse(finder.read_text("utf-8")).body:
            if isinstance(statement, ast.AnnAssign) and statement.value is not None:
                target: ast.expr = statement.target
            elif isinstance(statement, ast.Assign):
                target = statement.targets[0]
            else:
                continue
            if isinstance(target, ast.Name) and target.id == "MAPPING":
                return [Path(place) for place in ast.literal_eval(statement.value or target).values()]
    return []
