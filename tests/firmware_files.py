"""Installs the stand-in in the place of real firmware."""

from __future__ import annotations

import sys
from pathlib import Path

import firmware_stand_in


def install_firmware(folder: Path, kind: str, *, imitates: bool = False) -> Path:
    """PX4's folder or ArduPilot's program: the crude stand-in, or one that `imitates` a whole autopilot."""
    program = folder / "bin" / "px4" if kind == "px4" else folder / "arducopter"
    program.parent.mkdir(parents=True)
    # Isolated (-I, -S): it uses the standard library alone, so it cannot take the bench's own codec.
    module, flags = ("imitated_firmware", "-P") if imitates else ("firmware_stand_in", "-IS")
    tests = Path(firmware_stand_in.__file__).parents[1]
    lines = (
        f"#!{sys.executable} {flags}",
        "import sys",
        f"sys.path.insert(0, {str(tests)!r})",
        f"import {module}",
        f"{module}.main()",
    )
    program.write_text("\n".join(lines) + "\n", encoding="utf-8")
    program.chmod(0o755)
    if kind == "ardupilot":
        return program
    script = folder / "etc" / "init.d-posix" / "rcS"
    script.parent.mkdir(parents=True)
    script.touch()
    return folder
