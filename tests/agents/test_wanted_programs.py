"""Programs that people fly with start in the box: scripts with a first line, environments of their own, wrappers, static
binaries, Node.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
import venv
from pathlib import Path

import pytest

from bench.agents import open_agent
from bench.agents.confinement import rungs
from bench.agents.confinement._landlock import landlock_version
from bench.agents.confinement._landlock_launch import TCP_FROM
from bench.contracts import AgentEndpoints, AgentManifest, AgentPlan
from bench.simspec import Isolation, load_simspec

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"
PATIENCE_S = 60.0
WORDS = "the box has it"
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
IN_A_NETWORK_OF_ITS_OWN = """
import sys
from bench.network_namespace import enter_network_namespace
if fault := enter_network_namespace():
    sys.exit("no network: " + fault)
from pathlib import Path
from test_wanted_programs import SERVER_AS_CHILD, ended
print(ended(Path(sys.argv[1]), sys.argv[2], "{python}", "-c", SERVER_AS_CHILD)[1])
"""


@pytest.fixture(params=["bwrap", "landlock"])
def isolation(request: pytest.FixtureRequest) -> Isolation:
    name: Isolation = request.param
    if reason := rungs()[name].trial():
        pytest.skip(f"{name} cannot start here: {reason}")
    return name


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "agent").mkdir()
    return tmp_path / "agent"


def ended(
    folder: Path, isolation: Isolation, *command: str, read: tuple[str, ...] = (), path: str | None = None
) -> tuple[int, str]:
    """Exit code and output of an agent whose manifest lies in `folder`."""
    endpoints = AgentEndpoints({"REBAR_MAVLINK": "udpin:127.0.0.1:14540"}, None, "", "", 1, None)
    manifest = AgentManifest(
        name="wanted",
        command=command,
        environment={"PATH": path} if path else {},
        isolation=isolation,
        read=read,
        zenoh=False,
    )
    scratch = folder.parent / "scratch"
    plan = AgentPlan(manifest, folder, load_simspec(EXAMPLE), endpoints, scratch)
    with open_agent(plan) as agent:
        deadline = time.monotonic() + PATIENCE_S
        while (code := agent.exit_code()) is None and time.monotonic() < deadline:
            time.sleep(0.01)
    assert code is not None, "the agent did not end"
    return code, agent.output().decode()


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


def test_scripts_with_a_first_line(folder: Path, isolation: Isolation) -> None:
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
    assert ended(folder, isolation, "{folder}/shell.sh") == (3, f"{WORDS}\n")
    assert ended(folder, isolation, "{folder}/found.py", path=path) == (4, f"{WORDS}\n")


def test_an_environment_of_its_own(folder: Path, isolation: Isolation) -> None:
    """As the command, as the first line of a script, and behind a wrapper that the manifest lets read it."""
    python = environment_with(folder.parent / "its-own", "extra")
    code = "import extra, sys; print(extra.WORDS); sys.exit(5)"
    assert ended(folder, isolation, str(python), "-c", code) == (5, f"{WORDS}\n")
    program(folder / "run.py", f"#!{python}", code)
    assert ended(folder, isolation, "{folder}/run.py") == (5, f"{WORDS}\n")
    program(folder / "wrapper.sh", "#!/bin/sh", f'exec "{python}" -c "{code}"')
    assert ended(folder, isolation, "{folder}/wrapper.sh", read=(str(python),)) == (5, f"{WORDS}\n")
    refused, _ = ended(folder, isolation, "{folder}/wrapper.sh")
    assert refused in (126, 127), "what nobody named is not in the box"


def test_a_program_that_starts_another(folder: Path, isolation: Isolation) -> None:
    """env and nice take the environment's Python as an argument, which the command names."""
    python = environment_with(folder.parent / "its-own", "extra")
    code = "import extra; print(extra.WORDS)"
    assert ended(folder, isolation, "env", "A=1", str(python), "-c", code) == (0, f"{WORDS}\n")
    assert ended(folder, isolation, "nice", str(python), "-c", code) == (0, f"{WORDS}\n")


def test_a_static_binary(folder: Path, isolation: Isolation) -> None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    source = folder / "agent.c"
    source.write_text(f'#include <stdio.h>\nint main(void) {{ puts("{WORDS}"); return 7; }}\n')
    built = subprocess.run(
        [compiler, "-static", "-o", folder / "agent", source], capture_output=True, check=False
    )
    if built.returncode:
        pytest.skip("the compiler links no static programs")
    assert ended(folder, isolation, "{folder}/agent") == (7, f"{WORDS}\n")


def test_node_with_threads_sockets_and_digests(folder: Path, isolation: Isolation) -> None:
    """Node reserves much address space, starts threads, and reads openssl.cnf at its start."""
    if shutil.which("node") is None:
        pytest.skip("no Node on this host")
    (folder / "agent.js").write_text(
        f"""
const {{ Worker }} = require('worker_threads');
const digest = require('crypto').createHash('sha256').update('x').digest('hex');
const socket = require('dgram').createSocket('udp4');
socket.bind(0, '127.0.0.1', () => {{
  new Worker('require("worker_threads").parentPort.postMessage(1)', {{ eval: true }}).on('message', () => {{
    console.log({WORDS!r}, digest.length);
    process.exit(6);
  }});
}});
"""
    )
    assert ended(folder, isolation, "node", "{folder}/agent.js") == (6, f"{WORDS} 64\n")


def test_python_starts_python(folder: Path, isolation: Isolation) -> None:
    """A child has the interpreter and the packages of its parent."""
    code = "import subprocess, sys; sys.exit(subprocess.call([sys.executable, '-c', 'import numpy; print(numpy.pi > 3)']))"
    assert ended(folder, isolation, "{python}", "-c", code) == (0, "True\n")


def test_a_server_that_it_starts_on_any_port(folder: Path, isolation: Isolation) -> None:
    """In the network of a session; on the host's, Landlock knows ports alone and refuses one that nobody named."""
    command = [sys.executable, "-c", IN_A_NETWORK_OF_ITS_OWN, str(folder), isolation]
    done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    if done.stderr.startswith("no network: "):
        pytest.skip(done.stderr)
    assert done.stdout == f"{WORDS}\n\n", done.stderr
    code, text = ended(folder, isolation, "{python}", "-c", SERVER_AS_CHILD)
    refused = isolation == "landlock" and landlock_version() >= TCP_FROM
    assert ("Permission denied" in text, code) == (refused, int(refused)), text
