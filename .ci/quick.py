"""`make quick`: an answer within a minute. Lint, types, and the fast tests of what changed and of what
imports it.

What changed is what git says differs from BASE (HEAD unless given; the last commit when nothing differs). The
rooms that changed are tested first, then the rooms that import them. Tests that fly, start processes or take
long are left to `make test`; so is whatever the minute did not reach, and the last line says so.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parents[1]
BIN = Path(sys.executable).parent
RUFF, MYPY = str(BIN / "ruff"), str(BIN / "mypy")
FAMILIES = ("vehicle_models", "test_ports", "agent_adapters", "decompositions")
PACKAGES = ("bench", *FAMILIES)
FAST = "not slow and not flight and not process and not clients and not real"
BUDGET_S = 60.0


def changed_files(base: str | None) -> list[str]:
    """Paths that differ from the base, untracked ones included; those of the last commit when there are
    none.
    """

    def names(*command: str) -> list[str]:
        return subprocess.run(
            ["git", *command], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.split()

    here = names("diff", "--name-only", base or "HEAD") + names("ls-files", "--others", "--exclude-standard")
    return here or names("diff", "--name-only", "HEAD~1", "HEAD")


def room_of(path: str) -> str | None:
    """`bench.scoring`, `vehicle_models`, or None for a file that is in no package and no test folder."""
    parts = Path(path).parts
    if parts[0] == "tests" and len(parts) > 2:
        return parts[1] if parts[1] in FAMILIES else f"bench.{parts[1]}"
    if parts[0] == "bench":
        return f"bench.{Path(parts[1]).stem}" if len(parts) > 1 else None
    return parts[0] if parts[0] in FAMILIES else None


def importers_of(rooms: set[str]) -> set[str]:
    """Rooms that import one of these directly."""
    graph = grimp.build_graph(*PACKAGES)
    importers = set()
    for module in graph.modules:
        if graph.find_modules_directly_imported_by(module) and (
            room := room_of(module.replace(".", "/") + ".py")
        ):
            imported = {
                room_of(name.replace(".", "/") + ".py")
                for name in graph.find_modules_directly_imported_by(module)
            }
            if imported & rooms:
                importers.add(room)
    return importers - rooms


def tests_of(room: str) -> Path | None:
    """The folder of a room's tests, where there is one."""
    folder = ROOT / "tests" / room.rpartition(".")[2]
    return folder if folder.is_dir() else None


def main() -> int:
    """0 when everything that was reached passed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--base", help="a commit or branch to compare with")
    base = parser.parse_args().base
    deadline = time.monotonic() + BUDGET_S
    changed = changed_files(base)
    python = [name for name in changed if name.endswith(".py") and (ROOT / name).is_file()]
    checks = [[RUFF, "check", "."], [RUFF, "format", "--check", "."]]
    if python:
        checks.append([MYPY, *python])
    for command in checks:
        if subprocess.run(command, cwd=ROOT).returncode:
            return 1
    rooms = {room for name in changed if (room := room_of(name))}
    order = [*sorted(rooms), *sorted(importers_of(rooms))]
    folders = list(dict.fromkeys(folder for room in order if (folder := tests_of(room))))
    for number, folder in enumerate(folders):
        left_s = deadline - time.monotonic()
        rest = ", ".join(str(path.relative_to(ROOT)) for path in folders[number:])
        if left_s < 1.0:
            print(f"the minute is over; not tried: {rest}")
            return 0
        print(f"== {folder.relative_to(ROOT)}", flush=True)
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "2", "-m", FAST, str(folder)]
        try:
            code = subprocess.run(command, cwd=ROOT, timeout=left_s).returncode
        except subprocess.TimeoutExpired:
            print(f"the minute is over; not finished: {rest}")
            return 0
        if code not in (0, 5):  # 5: the folder holds no fast test
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
