"""Programs that people fly with start in the box: those of the page, scripts with a first line, environments of their own,
wrappers.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
import venv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from own_network import call_in_own_network
from rungs import BARE, CONFINING, EVERY, rung_or_skip
from started_agents import PATIENCE_S, plan_of

from bench.agents import open_agent
from bench.agents.confinement._landlock import landlock_version
from bench.agents.confinement._landlock_launch import TCP_FROM
from bench.contracts import AgentManifest

PAGE = Path(__file__).parents[2] / "docs" / "agents-confinement.md"
WORDS = "it works"
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


THEIRS = Path(sys.prefix) / "clients" / "bin" / "python"


@dataclass(frozen=True)
class Program:
    """A program of this name in docs/agents-confinement.md. `make` writes it into a folder and returns its command; None where this host
    has no such program.
    """

    name: str
    make: Callable[[Path], tuple[str, ...] | None]


def python(code: str) -> Callable[[Path], tuple[str, ...]]:
    return lambda folder: ("{python}", "-c", f"{code}\nprint({WORDS!r})")


ASYNCIO = """
import asyncio
async def main():
    async def echo(reader, writer):
        writer.write(await reader.readline())
        await writer.drain()
        writer.close()
    servers = [await asyncio.start_server(echo, "127.0.0.1", 0), await asyncio.start_unix_server(echo, "socket")]
    port = servers[0].sockets[0].getsockname()[1]
    for reader, writer in (await asyncio.open_connection("127.0.0.1", port), await asyncio.open_unix_connection("socket")):
        writer.write(b"hello\\n")
        assert await reader.readline() == b"hello\\n"
        writer.close()
    process = await asyncio.create_subprocess_exec("true")
    assert await process.wait() == 0
asyncio.run(main())
"""
SOCKETS = """
import http.client, http.server, socket, threading
class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.end_headers()
    def log_message(self, *words):
        pass
with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
    threading.Thread(target=server.serve_forever, daemon=True).start()
    client = http.client.HTTPConnection("127.0.0.1", server.server_port)
    client.request("GET", "/")
    assert client.getresponse().status == 200
    server.shutdown()
for family, address in ((socket.AF_INET6, ("::1", 0)), (socket.AF_UNIX, "\\0abstract")):
    with socket.socket(family) as listening, socket.socket(family) as calling:
        listening.bind(address)
        listening.listen()
        calling.connect(listening.getsockname())
"""
MULTIPROCESSING = """
import multiprocessing
from multiprocessing import shared_memory
if __name__ == "__main__":
    with multiprocessing.Pool(2) as pool:
        assert pool.map(abs, [-1, 2]) == [1, 2]
    queue, lock = multiprocessing.Queue(), multiprocessing.Lock()
    with lock:
        queue.put(3)
    assert queue.get() == 3
    block = shared_memory.SharedMemory(create=True, size=1000)
    block.buf[0] = 7
    again = shared_memory.SharedMemory(block.name)
    assert again.buf[0] == 7
    block.unlink()
    with multiprocessing.Manager() as manager:
        assert manager.list([1])[0] == 1
"""
SQLITE = """
import sqlite3
database = sqlite3.connect("agent.db")
assert database.execute("PRAGMA journal_mode = wal").fetchone() == ("wal",)
database.execute("CREATE TABLE seen (id INTEGER)")
database.execute("INSERT INTO seen VALUES (1)")
database.commit()
assert sqlite3.connect("agent.db").execute("SELECT id FROM seen").fetchall() == [(1,)]
"""
GIT = """
import subprocess
def git(*words):
    subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *words], check=True, stdout=subprocess.DEVNULL)
git("init", "repository")
git("-C", "repository", "commit", "--allow-empty", "-m", "first")
git("-C", "repository", "gc")
"""
ZENOH = """
import zenoh
with zenoh.open(zenoh.Config()) as session:
    with session.declare_subscriber("a/b") as subscriber:
        session.put("a/b", "hello")
        assert subscriber.recv().payload.to_string() == "hello"
"""
MAVSDK = """
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
import os
mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
_, host, port = os.environ["REBAR_MAVLINK"].split(":")
assert mavsdk.add_any_connection(f"udpin://{host}:{port}") == ConnectionResult.SUCCESS
"""
GRPC = """
import asyncio, socket, threading
from mavsdk_grpc import System
def beat(port):
    from pymavlink import mavutil
    link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1, source_component=1, dialect="common")
    while True:
        link.mav.heartbeat_send(2, 12, 0, 0, 4)
        threading.Event().wait(0.2)
async def main():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    system = System()
    threading.Thread(target=beat, args=(port,), daemon=True).start()
    await system.connect(f"udpin://127.0.0.1:{port}")
    async for state in system.core.connection_state():
        if state.is_connected:
            return
asyncio.run(asyncio.wait_for(main(), 40))
"""
NODE = """
const os = require('os'), net = require('net'), dgram = require('dgram'), crypto = require('crypto');
const { Worker } = require('worker_threads');
if (os.cpus().length < 1 || process.memoryUsage().rss < 1 || os.tmpdir() === '') throw new Error('no machine');
crypto.createHash('sha256').update('x').digest('hex');
const server = net.createServer((socket) => socket.end('hello'));
server.listen(0, '127.0.0.1', () => {
  net.connect(server.address().port, '127.0.0.1').on('data', () => {
    const socket = dgram.createSocket('udp4');
    socket.bind(0, '127.0.0.1', () => {
      new Worker('require("worker_threads").parentPort.postMessage(1)', { eval: true }).on('message', () => {
        console.log('it works');
        process.exit(0);
      });
    });
  });
});
"""
JAVA = """
import java.nio.file.*; import java.net.*; import java.util.concurrent.*;
public class Agent {
  public static void main(String[] words) throws Exception {
    Files.writeString(Files.createTempFile("a", "b"), "c");
    if (Runtime.getRuntime().availableProcessors() < 1) throw new Error("no processor");
    try (ServerSocket server = new ServerSocket(0, 1, InetAddress.getLoopbackAddress());
         Socket client = new Socket(server.getInetAddress(), server.getLocalPort())) { server.accept().close(); }
    ForkJoinPool.commonPool().submit(() -> 1).get();
    System.out.println("it works");
  }
}
"""
PSEUDO_TERMINAL = """
import os, pty, resource
master, slave = os.openpty()
os.write(slave, b"x")
assert os.read(master, 1) == b"x"
assert pty.spawn(["true"]) == 0
"""
MACHINE = """
import os, tempfile, threading
from pathlib import Path
assert os.cpu_count() >= 1 and len(os.sched_getaffinity(0)) >= 1
for name in ("cpuinfo", "meminfo", "stat", "self/status", "self/maps", "self/exe"):
    assert Path("/proc", name).exists() and (name == "self/exe" or Path("/proc", name).read_bytes())
with tempfile.TemporaryDirectory() as folder:
    Path(folder, "a").write_text("b")
Path.home().joinpath("c").write_text("d")
"""


def node(folder: Path) -> tuple[str, ...] | None:
    (folder / "agent.js").write_text(NODE)
    return ("node", "{folder}/agent.js") if shutil.which("node") else None


def java(folder: Path) -> tuple[str, ...] | None:
    (folder / "Agent.java").write_text(JAVA)
    if shutil.which("java") is None or shutil.which("javac") is None:
        return None
    subprocess.run(["javac", "-d", folder, folder / "Agent.java"], check=True)
    return ("java", "-cp", "{folder}", "Agent")


def static_binary(folder: Path) -> tuple[str, ...] | None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        return None
    (folder / "agent.c").write_text(f'#include <stdio.h>\nint main(void) {{ puts("{WORDS}"); return 0; }}\n')
    command = [compiler, "-static", "-o", str(folder / "agent"), str(folder / "agent.c")]
    linked = subprocess.run(command, capture_output=True, check=False).returncode == 0
    return ("{folder}/agent",) if linked else None


def git(folder: Path) -> tuple[str, ...] | None:
    return python(GIT)(folder) if shutil.which("git") else None


def grpc(folder: Path) -> tuple[str, ...] | None:
    (folder / "grpc_agent.py").write_text(f"{GRPC}\nprint({WORDS!r})")
    has_package = (
        THEIRS.exists() and subprocess.run([THEIRS, "-c", "import mavsdk_grpc"], check=False).returncode == 0
    )
    return (str(THEIRS), "{folder}/grpc_agent.py") if has_package else None


PROGRAMS = (
    Program("files, /proc, processors, temporary files", python(MACHINE)),
    Program("asyncio with TCP and Unix sockets", python(ASYNCIO)),
    Program("HTTP, IPv6 and abstract sockets in the agent", python(SOCKETS)),
    Program("multiprocessing: pools, queues, locks, shared memory", python(MULTIPROCESSING)),
    Program("sqlite", python(SQLITE)),
    Program("a pseudo-terminal", python(PSEUDO_TERMINAL)),
    Program("a Zenoh client with its default configuration", python(ZENOH)),
    Program("MAVSDK 4", python(MAVSDK)),
    Program("MAVSDK 3 with its gRPC server", grpc),
    Program("git", git),
    Program("Node with threads and servers", node),
    Program("Java with temporary files and sockets", java),
    Program("a static binary", static_binary),
)


def ended(
    folder: Path, rung: str, *command: str, read: tuple[str, ...] = (), path: str | None = None
) -> tuple[int | None, str]:
    """Exit code and output of an agent whose manifest lies in `folder`; None for one that had to be ended."""
    with rung_or_skip(rung) as isolation:
        manifest = AgentManifest(
            name="wanted",
            command=command,
            environment={"PATH": path} if path else {},
            isolation=isolation,
            read=read,
            zenoh=False,
        )
        with open_agent(plan_of(manifest, folder, folder.parent / "scratch")) as agent:
            deadline = time.monotonic() + PATIENCE_S
            while (code := agent.exit_code()) is None and time.monotonic() < deadline:
                time.sleep(0.01)
        return code, agent.output().decode()


Made = dict[str, tuple[Path, tuple[str, ...]]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The folder and the command of each program that this host has."""
    programs: Made = {
        SERVER_AS_CHILD: (tmp_path_factory.mktemp("server"), ("{python}", "-c", SERVER_AS_CHILD))
    }
    for program in PROGRAMS:
        home = tmp_path_factory.mktemp("program") / "agent"
        home.mkdir()
        if (command := program.make(home)) is not None:
            programs[program.name] = home, command
    return programs


def all_ends(programs: Made, rung: str) -> dict[str, tuple[bool, str]]:
    """Whether each program works on a rung, and what it wrote."""
    ends = {}
    for name, (home, command) in programs.items():
        try:
            code, output = ended(home, rung, *command)
        except pytest.skip.Exception as reason:
            pytest.skip(str(reason))
        ends[name] = (code == 0 and output.endswith(f"{WORDS}\n"), output)
    return ends


def table() -> dict[str, dict[str, str]]:
    """The table of the page: by program and column."""
    lines = PAGE.read_text().split("| program |")[1].split("\n\n")[0].splitlines()
    columns = [cell.strip(" `") for cell in lines[0].strip("|").split("|")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    return {name: dict(zip(columns, cells, strict=True)) for name, *cells in rows}


@pytest.mark.parametrize("rung", EVERY)
def test_programs_work_where_the_page_says_so(rung: str, made: Made, tmp_path: Path) -> None:
    """And nowhere else; without walls each of those works that does not work everywhere, so that it can fail for the walls
    alone. All at once: the start of a process with a network of its own takes longer than most of them.
    """
    rows = {**table(), SERVER_AS_CHILD: dict.fromkeys(COLUMNS.values(), "yes")}
    tried = {name: program for name, program in made.items() if rung != "none" or "no" in rows[name].values()}
    ends = call_in_own_network(tmp_path, all_ends, tried, rung)
    expected = {name: rung == "none" or rows[name][COLUMNS[rung]] == "yes" for name in ends}
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


@pytest.fixture(scope="module")
def their_python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a virtual environment that has a module `extra`."""
    folder = tmp_path_factory.mktemp("environment") / "its-own"
    venv.create(folder, with_pip=False, symlinks=True)
    site = next((folder / "lib").glob("python3*")) / "site-packages"
    (site / "extra.py").write_text(f"WORDS = {WORDS!r}\n")
    return folder / "bin" / "python"


def test_scripts_with_a_first_line(folder: Path, rung: str, their_python: Path) -> None:
    """One by a path, one by env; both by their place in the manifest's folder."""
    program(folder / "shell.sh", "#!/bin/sh", f"echo '{WORDS}'", "exit 3")
    program(
        folder / "found.py",
        "#!/usr/bin/env python3",
        "import extra",
        "print(extra.WORDS)",
        "raise SystemExit(4)",
    )
    path = f"{their_python.parent}:/usr/bin:/bin"
    assert ended(folder, rung, "{folder}/shell.sh") == (3, f"{WORDS}\n")
    assert ended(folder, rung, "{folder}/found.py", path=path) == (4, f"{WORDS}\n")


def test_an_environment_of_its_own(folder: Path, rung: str, their_python: Path) -> None:
    """As the command, as the first line of a script, and behind a wrapper that the manifest lets read it."""
    code = "import extra, sys; print(extra.WORDS); sys.exit(5)"
    assert ended(folder, rung, str(their_python), "-c", code) == (5, f"{WORDS}\n")
    program(folder / "run.py", f"#!{their_python}", code)
    assert ended(folder, rung, "{folder}/run.py") == (5, f"{WORDS}\n")
    program(folder / "wrapper.sh", "#!/bin/sh", f'exec "{their_python}" -c "{code}"')
    assert ended(folder, rung, "{folder}/wrapper.sh", read=(str(their_python),)) == (5, f"{WORDS}\n")
    # Rules alone follow the link to the system's Python, which does not find the environment.
    refused, text = ended(folder, rung, "{folder}/wrapper.sh")
    assert refused != 5, "what nobody named is not in the box"
    assert WORDS not in text


def test_a_program_that_starts_another(folder: Path, rung: str, their_python: Path) -> None:
    """env and nice take the environment's Python as an argument, which the command names."""
    code = "import extra; print(extra.WORDS)"
    assert ended(folder, rung, "env", "A=1", str(their_python), "-c", code) == (0, f"{WORDS}\n")
    assert ended(folder, rung, "nice", str(their_python), "-c", code) == (0, f"{WORDS}\n")


def test_python_starts_python(folder: Path, rung: str) -> None:
    """A child has the interpreter and the packages of its parent."""
    code = "import subprocess, sys; sys.exit(subprocess.call([sys.executable, '-c', 'import numpy; print(numpy.pi > 3)']))"
    assert ended(folder, rung, "{python}", "-c", code) == (0, "True\n")


def test_a_server_that_it_starts_on_any_port(folder: Path, rung: str) -> None:
    """It works in the network of a session, as above; on the host's, Landlock knows ports alone and refuses one that nobody
    named.
    """
    code, text = ended(folder, rung, "{python}", "-c", SERVER_AS_CHILD)
    refused = landlock_version() >= TCP_FROM
    assert ("Permission denied" in text, code) == (refused, int(refused)), text
