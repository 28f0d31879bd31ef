"""Which programs the library cannot reach, and the processes of an agent that run such a one."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Set
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from bench.errors import SetupError
from bench.process_threads import ProcessThreads, WatchedProcess

# From <elf.h>: the header of a 64-bit file from e_type on, one program header, one section header.
_HEADER = struct.Struct("<HHIQQQIHHHHHH")
_PROGRAM_HEADER_BYTES, _SECTION_HEADER = 56, struct.Struct("<IIQQQQIIQQ")
_IDENTITY_BYTES = 16
_ELF64_LITTLE = b"\x7fELF\x02\x01"
_PT_INTERP = 3
_GO_SECTIONS = (b".go.buildinfo", b".gopclntab", b".note.go.buildid")
# Host time that a process may be asleep without the library before it counts as one that never had it: a program enters
# before its first line, so this is for a host too busy to start programs. Chosen.
UNENTERED_S = 1.0
# CPU time within which any dynamic linker is done; the largest programs take some 0.1 s.
UNENTERED_CPU_S = 5.0
LIBRARY = b"/librebar-warp"


def unreachable_reason(program: Path) -> str:
    """Why the library cannot be preloaded into a program's file; empty where nothing speaks against it.

    A script is not judged: its interpreter is, once it runs.
    """
    with suppress(OSError, struct.error), program.open("rb") as file:
        identity = file.read(_IDENTITY_BYTES)
        if not identity.startswith(b"\x7fELF"):
            return ""
        if not identity.startswith(_ELF64_LITTLE):
            return "it is not a program for 64-bit processors"
        fields = _HEADER.unpack(file.read(_HEADER.size))
        if any(name in _GO_SECTIONS for name in _section_names(file, fields)):
            return "it is a Go program, which asks the kernel for the time itself"
        if not _has_interpreter(file, fields):
            return "it is statically linked"
    return ""


def _has_interpreter(file: BinaryIO, fields: tuple[int, ...]) -> bool:
    offset, count = fields[4], fields[9]
    file.seek(offset)
    kinds = [struct.unpack("<I", file.read(_PROGRAM_HEADER_BYTES)[:4])[0] for _ in range(count)]
    return _PT_INTERP in kinds


def _section_names(file: BinaryIO, fields: tuple[int, ...]) -> Iterator[bytes]:
    offset, count, names_index = fields[5], fields[11], fields[12]
    if not offset or not count:
        return
    file.seek(offset)
    sections = [_SECTION_HEADER.unpack(file.read(_SECTION_HEADER.size)) for _ in range(count)]
    file.seek(sections[names_index][4])
    names = file.read(sections[names_index][5])
    for section in sections:
        yield names[section[0] :].partition(b"\0")[0]


class Programs:
    """Follows which program each process of an agent runs, and whether the library is in it."""

    def __init__(self, threads: ProcessThreads) -> None:
        self._threads = threads

    def unentered(self, entered: Set[int]) -> list[WatchedProcess]:
        """The processes without the library in their present program: they start, or it will never be in them."""
        return [process for process in self._threads.processes.values() if not _has_library(process, entered)]

    def unchanged(self) -> bool:
        """Whether every process still runs the program in which `unentered` saw the library.

        So cheap that it goes with every look. A program that becomes itself anew without the library escapes it until
        the next call of `unentered`.
        """
        processes = self._threads.processes.values()
        return all(
            process.program is not None and _program_of(process) == process.program for process in processes
        )

    def refusal(self, process: WatchedProcess, now_s: float) -> str:
        """Why a process that has not entered never will, by the host's clock `now_s`; empty while it may just start."""
        # It has ended since it was last looked for: nothing is mapped in it any more, and it sleeps for good.
        if _program_of(process) is None:
            return ""
        path = Path(f"/proc/{process.pid}/exe")
        name = f"process {process.pid}"
        with suppress(OSError):
            name = os.readlink(path)
        if reason := unreachable_reason(path):
            return f"{name} cannot fly in warp: {reason}"
        if not _rests(process) or process.unentered_since_s is None:
            process.unentered_since_s = now_s
        late = now_s - process.unentered_since_s > UNENTERED_S
        if late or _cpu_s(process) > UNENTERED_CPU_S:
            return (
                f"{name} runs without the library for warp: a program of the agent has cleared LD_PRELOAD, or the system "
                "ignores it there"
            )
        return ""


def _has_library(process: WatchedProcess, entered: Set[int]) -> bool:
    """Whether the library is mapped, has started, and is not idle there because the program goes around it."""
    process.program = None
    program = _program_of(process)
    with suppress(OSError):
        mapped = LIBRARY in Path(f"/proc/{process.pid}/maps").read_bytes()
        if (
            mapped
            and process.inner_pid in entered
            and not unreachable_reason(Path(f"/proc/{process.pid}/exe"))
        ):
            process.program = program
            process.unentered_since_s = None
    return process.program is not None


def _program_of(process: WatchedProcess) -> tuple[int, int] | None:
    """Which file it runs; None once it has ended.

    Raises SetupError where the system does not let us see, and so not where its threads wait either.
    """
    try:
        status = os.stat(f"/proc/{process.pid}/exe")
    except PermissionError as error:
        what = "the system does not let the bench see what the agent's threads do, as it is another user"
        remedy = "give the bench CAP_SYS_PTRACE, or start the agent with --isolation none"
        raise SetupError("pace.mode", what, remedy) from error
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _rests(process: WatchedProcess) -> bool:
    with suppress(OSError):
        return all(thread.rests() and thread.still_rests() for thread in process.threads.values())
    return False


def _cpu_s(process: WatchedProcess) -> float:
    total_ns = 0
    for thread in process.threads.values():
        with suppress(OSError, ValueError, IndexError):
            total_ns += int(thread.history().split()[0])
    return total_ns / 1e9
