"""Installs the stand-in in the place of real firmware."""

from __future__ import annotations

import sys
from pathlib import Path

import firmware_stand_in


def install_firmware(folder: Path, kind: str) -> Path:
    """The firmware as a user would name it: PX4's folder, ArduPilot's program."""
    program = folder / "bin" / "px4" if kind == "px4" else folder / "arducopter"
    program.parent.mkdir(parents=True)
    source = Path(firmware_stand_in.__file__).read_text(encoding="utf-8")
    program.write_text(f"#!{sys.executable} -IS\n{source}", encoding="utf-8")
    program.chmod(0o755)
    if kind == "ardupilot":
        return program
    script = folder / "etc" / "init.d-posix" / "rcS"
    script.parent.mkdir(parents=True)
    script.touch()
    return folder
