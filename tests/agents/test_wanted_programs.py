"""Programs that people fly with start in the box: those of the page, scripts with a first line, environments of their own,
wrappers.
"""

from __future__ import annotations

import venv
from pathlib import Path

import pytest
from ordinary_programs import PROGRAMS, all_ends, ended
from own_network import call_in_own_network
from rungs import BARE, CONFINING, EVERY

from bench.agents.confinement._landlock import landlock_version
from bench.agents.confinement._landlock_launch import TCP_FROM

PAGE = Path(__file__).parents[2] / "docs" / "agents-confinement.md"
WORDS = "the box has it"
COLUMNS = {"landlock": "landlock", BARE: "landlock without namespaces"}
# As MAVSDK 3 does with its gRPC server: a child takes any free port, and its parent connects to it.
SERVER_AS_CHILD = f"""
import socket, subprocess, sys
child = '''
import socket
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
server.accept()[0].sendall(b"{WORDS}")
'''
with subprocess.Popen([sys.executable, "-I", "-S", "-c", child], stdout=subprocess.PIPE, text=True) as started:
    try:
        port = int(started.stdout.readline())
        with socket.create_connection(("127.0.0.1", port), 10.0) as client:
            print(client.recv(99).decode())
    finally:
        started.kill()
"""


def table() -> dict[str, dict[str, str]]:
    """The table of the page: by program and column."""
    lines = PAGE.read_text().split("| program |")[1].split("\n\n")[0].splitlines()
    columns = [cell.strip(" `") for cell in lines[0].strip("|").split("|")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    return {name: dict(zip(columns, cells, strict=True)) for name, *cells in rows}


@pytest.mark.parametrize("rung", EVERY)
def test_programs_work_where_the_page_says_so(rung: str, tmp_path: Path) -> None:
    """And nowhere else; without walls each works, so that it can fail for the walls alone. All at once: the start of a
    process with a network of its own takes longer than most of them.
    """
    ends = call_in_own_network(tmp_path, all_ends, tmp_path / "programs", rung)
    expected = {name: rung == "none" or table()[name][COLUMNS[rung]] == "yes" for name in ends}
    assert {name: works for name, (works, _) in ends.items()} == expected, [
        output for name, (works, output) in ends.items() if works != expected[name]
    ]


def test_the_page_has_every_program() -> None:
    rows = table()
    assert list(rows) == [program.name for program in PROGRAMS]
    assert {cell for row in rows.values() for cell in row.values()} == {"yes", "no"}


@pytest.fixture(params=CONFINING)
def rung(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "agent").mkdir()
    return tmp_path / "agent"


def program(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    path.chmod(0o755)
    return path


def environment_with(folder: Path, module: str) -> Path:
    """The Python of a virtual environment that has one module more."""
    venv.create(folder, with_pip=False, symlinks=True)
    site = next((folder / "lib").glob("python3*")) / "site-packages"
    (site / f"{module}.py").write_text(f"WORDS = {WORDS!r}\n")
    return folder / "bin" / "python"


def test_scripts_with_a_first_line(folder: Path, rung: str) -> None:
    """One by a path, one by env; both by their place in the manifest's folder."""
    program(folder / "shell.sh", "#!/bin/sh", f"echo '{WORDS}'", "exit 3")
    program(
        folder / "found.py",
        "#!/usr/bin/env python3",
        "import extra",
        "print(extra.WORDS)",
        "raise SystemExit(4)",
    )
    path = f"{environment_with(folder.parent / 'its-own', 'extra').parent}:/usr/bin:/bin"
    assert ended(folder, rung, "{folder}/shell.sh") == (3, f"{WORDS}\n")
    assert ended(folder, rung, "{folder}/found.py", path=path) == (4, f"{WORDS}\n")


def test_an_environment_of_its_own(folder: Path, rung: str) -> None:
    """As the command, as the first line of a script, and behind a wrapper that the manifest lets read it."""
    python = environment_with(folder.parent / "its-own", "extra")
    code = "import extra, sys; print(extra.WORDS); sys.exit(5)"
    assert ended(folder, rung, str(python), "-c", code) == (5, f"{WORDS}\n")
    program(folder / "run.py", f"#!{python}", code)
    assert ended(folder, rung, "{folder}/run.py") == (5, f"{WORDS}\n")
    program(folder / "wrapper.sh", "#!/bin/sh", f'exec "{python}" -c "{code}"')
    assert ended(folder, rung, "{folder}/wrapper.sh", read=(str(python),)) == (5, f"{WORDS}\n")
    # Rules alone follow the link to the system's Python, which does not find the environment.
    refused, text = ended(folder, rung, "{folder}/wrapper.sh")
    assert refused != 5, "what nobody named is not in the box"
    assert WORDS not in text


def test_a_program_that_starts_another(folder: Path, rung: str) -> None:
    """env and nice take the environment's Python as an argument, which the command names."""
    python = environment_with(folder.parent / "its-own", "extra")
    code = "import extra; print(extra.WORDS)"
    assert ended(folder, rung, "env", "A=1", str(python), "-c", code) == (0, f"{WORDS}\n")
    assert ended(folder, rung, "nice", str(python), "-c", code) == (0, f"{WORDS}\n")


def test_python_starts_python(folder: Path, rung: str) -> None:
    """A child has the interpreter and the packages of its parent."""
    code = "import subprocess, sys; sys.exit(subprocess.call([sys.executable, '-c', 'import numpy; print(numpy.pi > 3)']))"
    assert ended(folder, rung, "{python}", "-c", code) == (0, "True\n")


def test_a_server_that_it_starts_on_any_port(folder: Path, rung: str) -> None:
    """In the network of a session; on the host's, Landlock knows ports alone and refuses one that nobody named."""
    command = ("{python}", "-c", SERVER_AS_CHILD)
    assert call_in_own_network(folder.parent, ended, folder, rung, *command) == (0, f"{WORDS}\n")
    code, text = ended(folder, rung, *command)
    refused = landlock_version() >= TCP_FROM
    assert ("Permission denied" in text, code) == (refused, int(refused)), text
