"""An image for the rung `container`, made of this host's own Python and shell: nothing is fetched."""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
from functools import cache
from pathlib import Path

import numpy
import pytest
import zenoh

from bench.agents.confinement._container import Container

PYTHON = str(
    Path(sys.base_prefix, "bin", f"python{sys.version_info.major}.{sys.version_info.minor}").resolve()
)
# Parts of the standard library that no probe imports and that make an image several times as large.
_LEFT_OUT = {
    *("site-packages", "test", "tests", "idlelib", "tkinter", "turtledemo", "ensurepip"),
    *("lib2to3", "__pycache__"),
}


def _libraries(programs: list[Path]) -> set[Path]:
    """The shared libraries and the loader of programs and modules, as `ldd` lists them."""
    listed = subprocess.run(["ldd", *map(str, programs)], capture_output=True, text=True, check=False).stdout
    return {Path(path) for path in re.findall(r"(/[^\s:]+) \(0x", listed)}


def _files() -> list[Path]:
    library = Path(sysconfig.get_path("stdlib"))
    modules = [
        path
        for path in library.rglob("*")
        if path.is_file() and not _LEFT_OUT & set(path.parts) and not path.parts[-2].startswith("config-")
    ]
    programs = [Path(PYTHON), Path("/bin/sh")]
    # Compiled packages are mounted from the host, and what they link against is not: these two need what others need.
    packages = [path for package in (numpy, zenoh) for path in Path(package.__path__[0]).glob("**/*.so")]
    binaries = [*programs, *packages, *(path for path in modules if path.suffix == ".so")]
    # Libraries are listed by paths such as `a/../b`, and engines refuse an archive that names a file twice.
    found = {Path(os.path.normpath(path)) for path in (*programs, *modules, *_libraries(binaries))}
    # What a package brings with it is mounted with it.
    return sorted(path for path in found if not path.is_relative_to(sys.prefix))


@cache
def image_or_skip() -> str:
    """The name of the image in the engine's store; it is built when it is missing.

    Skips the test where no engine answers, or where it cannot start a plain container.
    """
    if reason := Container().trial():
        pytest.skip(f"container cannot start here: {reason}")
    engine = shutil.which("podman") or "docker"
    files = _files()
    # Of this file too: what it puts into the image has no path on the host.
    stated = [Path(__file__), *files]
    digest = hashlib.sha256(
        "\n".join(f"{path} {path.stat().st_size}" for path in stated).encode()
    ).hexdigest()
    name = f"localhost/rebar-tests/host-python:{digest[:12]}"
    if subprocess.run([engine, "image", "inspect", name], capture_output=True, check=False).returncode:
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w", dereference=True) as archive:
            for path in files:
                archive.add(path, str(path).lstrip("/"), recursive=False)
            # More than the quota of the agents that the tests start: what an image has in /tmp counts to no agent.
            filler = tarfile.TarInfo("tmp/filler")
            filler.size = 5 << 20
            archive.addfile(filler, io.BytesIO(bytes(filler.size)))
        _run(engine, "import", "-", name, data=packed.getvalue())
    # Without the limits that podman gives by default: not every root user may raise them.
    limits = ("--ulimit", "nproc=1000:1000", "--ulimit", "nofile=1000:1000")
    _run(engine, "run", "--rm", "--network", "host", *limits, "--entrypoint", "", name, PYTHON, "-c", "pass")
    return name


def _run(*words: str, data: bytes = b"") -> None:
    done = subprocess.run(words, input=data, capture_output=True, check=False)
    if done.returncode:
        pytest.skip(f"{' '.join(words[:2])}: {done.stderr.decode(errors='replace').strip()}")
