"""The library that is preloaded into agents, built when it is first needed."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from bench.errors import Fault, SetupError
from bench.process_threads import unseen_reason
from bench.temporary_folders import user_cache

SOURCE = Path(__file__).with_name("preload.c")
# Optimised, because programs read clocks in their inner loops; initial-exec storage needs no allocation in a handler.
FLAGS = ("-std=gnu11", "-O2", "-fPIC", "-shared")
COMPILERS = ("cc", "gcc", "clang")
FIELD = "pace.mode"
# One file of a thousand lines takes one CPU second; generous for a busy host.
_BUILD_BUDGET_S = 120.0


@cache
def warp_fault() -> Fault | None:
    """Why no session can be flown in warp on this host; None where it can. Builds the library if need be."""
    if reason := unseen_reason():
        return Fault(FIELD, f"warp must see whether threads sleep, and {reason}", "fly with --pace realtime")
    try:
        built_library()
    except SetupError as error:
        return error.faults[0]
    return None


def built_library(folder: Path | None = None) -> Path:
    """The compiled library in `folder` (the user's cache when None), built there if it is not there yet.

    Its name holds a digest of the source, the flags and the compiler, so that each of them gets a library of its own.
    Raises SetupError on a host for which there is none: without a compiler, or other than 64-bit Linux with glibc.
    """
    if platform.system() != "Linux" or platform.libc_ver()[0] != "glibc":
        raise SetupError(FIELD, "warp is for Linux with glibc", "fly on such a host, or with --pace realtime")
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        raise SetupError(
            FIELD,
            "warp needs a C compiler for its library, and there is none here",
            "install gcc (Debian: apt install gcc libc6-dev), or fly with --pace realtime",
        )
    folder = folder or user_cache()
    library = folder / f"librebar-warp-{_key(compiler)}.so"
    if not library.exists():
        _build(compiler, library)
    return library


def library_digest(library: Path) -> str:
    """SHA-256 of the compiled library, for the provenance of a result."""
    return hashlib.sha256(library.read_bytes()).hexdigest()


def _key(compiler: str) -> str:
    program = os.stat(compiler)
    # A compiler that was updated in its place is another one.
    state = (" ".join(FLAGS), platform.machine(), compiler, str(program.st_size), str(program.st_mtime_ns))
    return hashlib.sha256("\0".join(state).encode() + SOURCE.read_bytes()).hexdigest()[:16]


def _build(compiler: str, library: Path) -> None:
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".warp-", dir=library.parent) as folder:
        made = Path(folder) / library.name
        done = subprocess.run(
            [compiler, *FLAGS, "-o", str(made), str(SOURCE)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
            timeout=_BUILD_BUDGET_S,
        )
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line] or [
                f"it ended with {done.returncode}"
            ]
            raise SetupError(
                FIELD,
                f"{compiler} cannot build the library for warp: {lines[0]}",
                "install the C library's headers (Debian: apt install libc6-dev), or fly with --pace realtime",
            )
        # In one step: of two sessions that build at once, neither sees half a library.
        os.replace(made, library)
