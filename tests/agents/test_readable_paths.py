"""Which files an agent may read: what its program needs, and no folder with sessions."""

from __future__ import annotations

import os
import sys
import venv
from pathlib import Path

from bench.agents.confinement import find_program, program_paths, without_sessions


def session_folder(path: Path, mark: str) -> Path:
    path.mkdir(parents=True)
    (path / mark).touch()
    return path


def test_folders_with_sessions_are_left_out_wherever_they_are(tmp_path: Path) -> None:
    """Of two campaigns one lies deep, of two single sessions one is marked by nothing and named as hidden."""
    agent = tmp_path / "agent"
    (agent / "models" / "large").mkdir(parents=True)
    (agent / "run.py").touch()
    session_folder(agent / "out" / "standard", "journal.sqlite")
    session_folder(agent / "models" / "tried" / "full", "simspecs")
    session_folder(agent / "flown", "recording.mcap")
    (agent / "now").mkdir()
    kept = without_sessions(agent, [agent / "now"])
    assert kept == [agent / "models" / "large", agent / "run.py"]
    assert without_sessions(agent / "models" / "large", ()) == [agent / "models" / "large"]
    assert without_sessions(agent / "flown", ()) == []


def test_of_a_checkout_only_packages_are_readable(tmp_path: Path) -> None:
    """An editable installation names the checkout in a .pth file; setuptools may name packages in a module."""
    checkout = tmp_path / "checkout"
    for package in ("pilot", "maps"):
        (checkout / package).mkdir(parents=True)
        (checkout / package / "__init__.py").touch()
    (checkout / "campaigns").mkdir()
    (checkout / "single.py").touch()
    venv.create(tmp_path / "env", with_pip=False, symlinks=True)
    site = next((tmp_path / "env" / "lib").glob("python3*")) / "site-packages"
    (site / "checkout.pth").write_text(f"# comment\nimport sys\n{checkout}\n")
    (site / "__editable___other_finder.py").write_text(
        f"MAPPING: dict[str, str] = {{'other': '{tmp_path}/other/src/other'}}\n"
    )
    paths = program_paths(tmp_path / "env" / "bin" / "python", {})
    below = {path for path in paths if path.is_relative_to(checkout) or "other" in path.parts}
    assert below == {
        checkout / "pilot",
        checkout / "maps",
        checkout / "single.py",
        tmp_path / "other" / "src" / "other",
    }
    assert tmp_path / "env" not in paths
    assert Path(sys.executable).resolve().parent in paths


def test_a_script_brings_its_interpreter(tmp_path: Path) -> None:
    """By a first line with the interpreter's path, and by one with env."""
    interpreter = tmp_path / "tools" / "shell"
    interpreter.parent.mkdir()
    os.symlink("/bin/sh", interpreter)
    for number, line in enumerate((f"#!{interpreter} -e", "#!/usr/bin/env shell")):
        script = tmp_path / f"run{number}"
        script.write_text(f"{line}\ntrue\n")
        script.chmod(0o755)
        assert program_paths(script, {"PATH": str(interpreter.parent)}) == [script, interpreter]


def test_programs_are_found_as_a_shell_finds_them(tmp_path: Path) -> None:
    """By the agent's PATH, and by a path from its folder; a file that cannot be executed is no program."""
    for name, mode in (("tool", 0o755), ("text", 0o644)):
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(mode)
    environment = {"PATH": str(tmp_path)}
    assert find_program("tool", environment, Path("/")) == tmp_path / "tool"
    assert find_program("./tool", {}, tmp_path) == tmp_path / "tool"
    assert find_program("text", environment, Path("/")) is None
    assert find_program("./text", {}, tmp_path) is None
    assert find_program("none", environment, Path("/")) is None
