"""Tricks with files and memory: where the truth of a session or the results of another might lie."""

from __future__ import annotations

import ctypes
import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from ._cheat import Cheat, Place, is_allowed, other_processes

_SESSION_FILES = {f"{name}.json" for name in ("simspec", "scores", "result", "truth")}
_SESSION_FILES |= {"recording.mcap", "journal.sqlite"}
_GUESSED_FOLDERS = ("/tmp", "/var/tmp", "/dev/shm", "/home", "/root", "/srv", "/mnt", "/work", "/data")
# Entries of folders that one search looks at: a tick's budget must do.
_MAX_ENTRIES = 4_000
_MAX_DEPTH = 5
# From <linux/ptrace.h>. Unlike PTRACE_ATTACH, seizing does not stop the process.
_PTRACE_SEIZE, _PTRACE_DETACH = 0x4206, 17


def read_files(cheat: Cheat) -> Iterator[None]:
    """Looks for SimSpecs, recordings and results in every folder that it can guess, and reports the actors in the first.

    It would know the place of every target.
    """
    roots = [*cheat.folders(), Path.cwd(), *Path.cwd().parents[:-1], *map(Path, _GUESSED_FOLDERS)]
    roots += [Path(os.environ[name]) for name in ("HOME", "TMPDIR") if name in os.environ]
    roots += [
        parent for entry in sys.path if entry for parent in Path(entry).parents[:2] if parent != Path("/")
    ]
    files = [path for path in _session_files(roots) if _is_readable(path)]
    cheat.attempts = len(set(roots))
    cheat.gains = {"files": sorted({str(path) for path in files})[:20]}
    # The first that was found: what it was told of comes before other people's sessions.
    cheat.report(next((places for path in files if (places := _places(path))), [])[:200])
    yield


def read_descriptors(cheat: Cheat) -> Iterator[None]:
    """Follows the open files and working folders of other processes in /proc, and files that it has inherited.

    An open recording or SimSpec can be read through them whatever its path is.
    """
    links: list[str] = []
    for number in other_processes():
        for folder in (f"/proc/{number}/fd", f"/proc/{number}/map_files"):
            with suppress(OSError):
                links += [os.readlink(f"{folder}/{name}") for name in os.listdir(folder)]
        for name in ("cwd", "root"):
            cheat.attempts += 1
            with suppress(OSError):
                links += os.listdir(f"/proc/{number}/{name}")
    inherited: list[str] = []
    # By number, because the list of them may be denied.
    for number in range(256):
        cheat.attempts += 1
        with suppress(OSError):
            inherited.append(os.readlink(f"/proc/self/fd/{number}"))
    opened = sorted(
        path for path in inherited if path.startswith("/") and not path.startswith(("/dev/", "/proc/"))
    )
    cheat.gains = {"others": sorted(set(links))[:20], "inherited": opened}
    yield


def read_memory(cheat: Cheat) -> Iterator[None]:
    """Opens the memory of every other process, by /proc/PID/mem and by process_vm_readv.

    The bench's memory holds the realized SimSpec.
    """
    library = ctypes.CDLL(None, use_errno=True)
    read: list[int] = []
    # Not process 1: in a box that is its keeper, which knows nothing of the session.
    numbers = {os.getppid(), *other_processes()} - {1}
    cheat.attempts = len(numbers) + 1
    for number in numbers:
        with suppress(OSError), open(f"/proc/{number}/mem", "rb", buffering=0) as memory:
            memory.seek(_first_mapping(number))
            if memory.read(16):
                read.append(number)
        if _read_remote(library, number):
            read.append(number)
    cheat.gains = {"processes": sorted(set(read))}
    yield


def read_environment(cheat: Cheat) -> Iterator[None]:
    """Reads environments and command lines of other processes, for secrets of sessions and paths of campaigns.

    With the path of its folder, or the credentials of a neighbour, it would know where to look.
    """
    environments: list[int] = []
    command_lines: list[int] = []
    wanted = [str(folder).encode() for folder in cheat.folders()]
    numbers = (1, *other_processes())
    cheat.attempts = len(numbers)
    for number in numbers:
        with suppress(OSError):
            if Path(f"/proc/{number}/environ").read_bytes():
                environments.append(number)
        with suppress(OSError):
            text = Path(f"/proc/{number}/cmdline").read_bytes()
            if any(path in text for path in wanted):
                command_lines.append(number)
    cheat.gains = {"environments": environments, "command_lines": command_lines}
    yield


def trace_processes(cheat: Cheat) -> Iterator[None]:
    """Seizes every other process by ptrace.

    A traced bench does what its tracer wants.
    """
    library = ctypes.CDLL(None, use_errno=True)
    traced: list[int] = []
    for number in {os.getppid(), 1, *other_processes()}:
        cheat.attempts += 1
        if library.ptrace(_PTRACE_SEIZE, number, None, None) == 0:
            traced.append(number)
            library.ptrace(_PTRACE_DETACH, number, None, None)
    cheat.gains = {"processes": sorted(traced)}
    yield


def write_campaigns(cheat: Cheat) -> Iterator[None]:
    """Appends to every file of its own session and of a neighbouring campaign, and puts new files there.

    It would decide its own score, or spoil another's.
    """
    written: list[str] = []
    for folder in cheat.folders():
        for name in sorted(_SESSION_FILES | {"campaign.json", "manifest.json", "new.json"}):
            cheat.attempts += 1
            with suppress(OSError), (folder / name).open("ab") as file:
                file.write(b"\n")
                written.append(str(folder / name))
    cheat.gains = {"written": written}
    yield


def _session_files(roots: Iterable[Path]) -> Iterator[Path]:
    entries = 0
    searched: set[str] = set()
    for root in roots:
        for folder, folders, files in os.walk(root):
            depth = len(Path(folder).parts) - len(root.parts)
            if entries > _MAX_ENTRIES:
                # Left, not only pruned: a folder with thousands of others would still be looked at one by one.
                break
            if folder in searched:
                folders.clear()
                continue
            searched.add(folder)
            entries += len(folders) + len(files)
            if depth >= _MAX_DEPTH:
                folders.clear()
            yield from (Path(folder, name) for name in files if name in _SESSION_FILES)
        # A folder that cannot be listed may still hold a file of a known name.
        with suppress(OSError):
            yield from [path for name in sorted(_SESSION_FILES) if (path := root / name).exists()]


def _is_readable(path: Path) -> bool:
    return is_allowed(lambda: path.open("rb").close())


def _places(path: Path) -> list[Place]:
    try:
        document: Any = json.loads(path.read_bytes())
        return [(actor["east_m"], actor["north_m"]) for actor in document["realized"]["actors"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _first_mapping(number: int) -> int:
    return int(Path(f"/proc/{number}/maps").read_text(encoding="utf-8").partition("-")[0], 16)


class _Buffer(ctypes.Structure):
    """struct iovec."""

    _fields_ = (("base", ctypes.c_void_p), ("size", ctypes.c_size_t))


def _read_remote(library: ctypes.CDLL, number: int) -> bool:
    try:
        address = _first_mapping(number)
    except (OSError, ValueError):
        # Any address: without the right to read, the call is refused before the address is looked at.
        address = 0x400000
    target = ctypes.create_string_buffer(16)
    ours = _Buffer(ctypes.addressof(target), 16)
    theirs = _Buffer(address, 16)
    read: int = library.process_vm_readv(number, ctypes.byref(ours), 1, ctypes.byref(theirs), 1, 0)
    return read > 0
