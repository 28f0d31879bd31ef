"""Installs the stand-in in the place of real firmware."""

from __future__ import annotations

import sys
from pathlib import Path

import firmware_stand_in


def install_firmware(folder: Path, kind: str) -> Path:
    """The firmware as a user would name it: PX4's folder, ArduPilot's program."""
    program = folder / "bin" / "px4" if kind == "px4" else folder / "arducopter"
    program.parent.mkdir(parents=True)
    # Isolated (-I, -S): it uses the standard library alone, so it cannot take the bench's own codec.
    tests = Path(firmware_stand_in.__file__).parents[1]
    lines = (
        f"#!{sys.executable} -IS",
        "import sys",
        f"sys.path.insert(0, {str(tests)!r})",
        "import firmware_stand_in",
        "firmware_stand_in.main()",
    )
    program.write_text("\n".join(lines) + "\n", encoding="utf-8")
    program.chmod(0o755)
    if kind == "ardupilot":
        return program
    script = folder / "etc" / "init.d-posix" / "rcS"
    script.parent.mkdir(parents=True)
    script.touch()
    return folder
