"""An agent as a process of this host: what it is given, what is kept of its output, and how it is ended."""

from __future__ import annotations

import json
import os
import selectors
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from bench.contracts import AgentPlan, AgentUsage, ProcessRoot
from bench.errors import AgentBoxKilled, SetupError
from bench.simspec import seed_of

from ._program import expand_command, expand_placeholders
from .confinement import (
    BOX_PLACE,
    CONTAINER,
    Box,
    ConfinedProcess,
    Place,
    Wall,
    find_program,
    leaves_open,
    program_paths,
    rung_of,
    this_host,
    without_sessions,
)

# Host times, chosen: for an agent to exit by itself after the tick socket's end, and after SIGTERM.
LEAVE_S = 0.25
GRACE_S = 2.0
# Kept of its output: the beginning shows the set-up, the end shows why it stopped.
HEAD_BYTES = 256 * 1024
TAIL_BYTES = 64 * 1024
LAST_WORDS_BYTES = 4000
# Of 64 KiB each, which is more than a pipe of Linux holds.
LAST_READS = 64
READ_BYTES = 65536
TRUTH_FILE = "truth.json"


@contextmanager
def open_agent(plan: AgentPlan) -> Iterator[LocalProcess]:
    """Start the agent on the rung that its manifest asks for; leaving the block ends it and what it started.

    The thread that enters must outlive the agent: the kernel ends the agent when that thread ends, so an
    agent never survives its session. Once the agent has started, the bench opens nothing in a folder that the agent can
    write: there the agent decides what a name leads to. Raises SetupError when the command or the environment names an
    option that the SimSpec does not have, or the rung cannot start here.
    """
    rung = rung_of(plan.manifest, plan.simspec.agent)
    plan.scratch.mkdir(parents=True, exist_ok=True)
    if plan.truth is not None:
        (plan.scratch / TRUTH_FILE).write_text(plan.truth.model_dump_json(), encoding="utf-8")
    box = box_of(plan, rung.place(plan.scratch), in_image=rung.name == CONTAINER)
    with closing(_Output()) as output:
        process = rung.start(box, output.write_end)
        output.begin()
        agent = LocalProcess(process, output, program=box.command[0], isolation=rung.name)
        try:
            yield agent
        finally:
            agent.end()


def box_of(plan: AgentPlan, place: Place, *, in_image: bool = False) -> Box:
    """What the agent at `place` may see and use; `in_image`: its program is in the manifest's image."""
    manifest, options = plan.manifest, plan.simspec.agent.options
    environment = environment_of(plan, place)
    # The host's search path means nothing in the image, which brings its own.
    if in_image and "PATH" not in manifest.environment:
        del environment["PATH"]
    command = expand_command(manifest, plan.folder, options)
    paths = _named_paths(plan, command)
    # A program that a wrapper starts needs what it would need as the command: a Python its libraries.
    others = [path for path in paths if path.is_file() and os.access(path, os.X_OK)]
    paths = [kept for path in paths for kept in without_sessions(path, plan.hidden)]
    if plan.cache is not None and not plan.fills_cache and place != BOX_PLACE:
        paths.append(plan.cache)
    if not in_image:
        program = find_program(command[0], environment, plan.scratch)
        if program is not None:
            command = (str(program), *command[1:])
            others.append(program)
        # Keys of a dict: the program of most commands is named by its path.
        paths += [needed for path in dict.fromkeys(others) for needed in program_paths(path, environment)]
    return Box(
        command=command,
        environment=environment,
        scratch=plan.scratch,
        read=tuple(paths),
        files=_files(plan, place),
        shared=_shared(plan),
        tcp_ports=_tcp_ports(plan) | set(manifest.tcp_ports),
        limits=manifest.limits,
        gpu=manifest.gpu,
        image=manifest.image,
        hosts=plan.endpoints.hosts,
    )


def _named_paths(plan: AgentPlan, command: Sequence[str]) -> list[Path]:
    """What the manifest and its command name on the host."""
    manifest = plan.manifest
    read = {f"read[{index}]": path for index, path in enumerate(manifest.read)}
    expanded = expand_placeholders(manifest, plan.folder, plan.simspec.agent.options, read)
    paths = [Path(path) for path in expanded.values()]
    # The manifest's folder is for agents whose manifest names it: others share that folder with much else.
    if any("{folder}" in text for text in (*manifest.command, *manifest.environment.values())):
        paths.append(plan.folder)
    # A file that the command names is part of the agent: its script, its model. Folders are for `read`.
    return paths + [Path(word) for word in command if word.startswith("/") and Path(word).is_file()]


def _files(plan: AgentPlan, place: Place) -> tuple[Path, ...]:
    """What the agent may read beside its HOME."""
    files = [plan.scratch / TRUTH_FILE] if plan.truth is not None else []
    if warp := plan.endpoints.warp:
        files += [warp.library, warp.clock]
    if plan.cache is not None and not plan.fills_cache and place == BOX_PLACE:
        files.append(plan.cache)
    return tuple(files)


def _shared(plan: AgentPlan) -> tuple[Path, ...]:
    """What the agent may also write there."""
    waiters = (warp.waiters,) if (warp := plan.endpoints.warp) else ()
    return (*waiters, plan.cache) if plan.cache is not None and plan.fills_cache else waiters


def _tcp_ports(plan: AgentPlan) -> frozenset[int]:
    """The ports of the agent's endpoints that are reached over TCP."""
    ends = plan.endpoints
    addresses = [address for address in (ends.zenoh_locator, ends.tick) if address]
    addresses += [address for address in ends.mavlink.values() if address.startswith("tcp:")]
    addresses += ends.services.values()
    return frozenset(int(address.rpartition(":")[2]) for address in addresses)


def environment_of(plan: AgentPlan, place: Place) -> dict[str, str]:
    """The agent's whole environment. Nothing of the bench's environment leaks into it."""
    ends = plan.endpoints
    spec = plan.simspec
    environment = {
        "PATH": os.environ.get("PATH", os.defpath),
        "LANG": "C.UTF-8",
        "PYTHONHASHSEED": "0",
        "PYTHONUNBUFFERED": "1",
        "HOME": place.home,
        "ROS_DOMAIN_ID": str(ends.domain),
        "REBAR_VEHICLE": spec.vehicle.name,
        "REBAR_OPTIONS": json.dumps(spec.agent.options, sort_keys=True),
        "REBAR_SEED": str(seed_of(spec.seeds, "agent")),
    }
    if ends.zenoh_locator is not None:
        environment |= {
            "REBAR_ZENOH": ends.zenoh_locator,
            "REBAR_ZENOH_USER": ends.zenoh_user,
            "REBAR_ZENOH_PASSWORD": ends.zenoh_password,
        }
    if ends.tick is not None:
        environment |= {"REBAR_TICK": ends.tick, "REBAR_TICK_SECRET": ends.tick_secret}
    if plan.truth is not None:
        environment["REBAR_TRUTH"] = f"{place.files}/{TRUTH_FILE}"
    if plan.cache is not None and plan.manifest.cache is not None:
        # In a box both who fills it and who reads it find it at the same path.
        boxed = f"{place.files}/{plan.cache.name}"
        environment[plan.manifest.cache.variable] = boxed if place == BOX_PLACE else str(plan.cache)
    environment |= dict(ends.mavlink) | dict(ends.services)
    environment |= expand_placeholders(
        plan.manifest, plan.folder, spec.agent.options, plan.manifest.environment
    )
    if ends.warp is not None:
        # Before the libraries that the agent preloads itself: of two functions of one name the first counts.
        # A box has a home of its own, whose name needs no link; without one the agent lives in its folder on the host.
        link = None if place == BOX_PLACE else ends.warp.link
        library = str(link or f"{place.files}/{ends.warp.library.name}")
        preloaded = [library, environment.get("LD_PRELOAD", "")]
        environment |= {
            "LD_PRELOAD": ":".join(filter(None, preloaded)),
            "REBAR_WARP_CLOCK": f"{place.files}/{ends.warp.clock.name}",
            "REBAR_WARP_WAITERS": f"{place.files}/{ends.warp.waiters.name}",
        }
    return environment


class _Output:
    """Takes in what the agent writes and keeps its beginning and its end.

    A thread reads, so that an agent never waits for the simulation in order to write; past the first
    `HEAD_BYTES` it reads at a bounded rate, so that one that floods waits for us instead of using up the
    machine.
    """

    def __init__(self) -> None:
        self._read_end, self.write_end = os.pipe()
        os.set_blocking(self._read_end, False)
        self._head = bytearray()
        self._tail: deque[bytes] = deque()
        self._tail_bytes = 0
        self._dropped = 0
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._pump, name="agent-output", daemon=True)

    def begin(self) -> None:
        """Called once the agent holds the write end: ours is closed, so that its end shows."""
        os.close(self.write_end)
        self.write_end = -1
        self._thread.start()

    def close(self) -> None:
        """Take in what is left, without waiting for anyone who still holds the pipe."""
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join()
        for end in (self._read_end, self.write_end):
            if end >= 0:
                os.close(end)

    def text(self) -> bytes:
        """What is kept, with a line in the middle that says how much is not."""
        with self._lock:
            gap = f"\n[... {self._dropped} bytes left out ...]\n".encode() if self._dropped else b""
            return bytes(self._head) + gap + b"".join(self._tail)

    def _pump(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._read_end, selectors.EVENT_READ)
            while not self._ending.is_set():
                if selector.select(timeout=0.2) and self._read() == b"":
                    return
                if len(self._head) >= HEAD_BYTES:
                    self._ending.wait(0.02)
        # What the agent wrote last is in the pipe. Bounded: a process that it left may go on writing.
        for _ in range(LAST_READS):
            if not self._read():
                return

    def _read(self) -> bytes | None:
        """Take in what waits; empty at the end of the stream, None when nothing waits."""
        try:
            data = os.read(self._read_end, READ_BYTES)
        except BlockingIOError:
            return None
        if data:
            self._keep(data)
        return data

    def _keep(self, data: bytes) -> None:
        with self._lock:
            room = HEAD_BYTES - len(self._head)
            self._head += data[:room]
            rest = data[room:] if room < len(data) else b""
            if rest:
                self._tail.append(rest)
                self._tail_bytes += len(rest)
            while self._tail_bytes > TAIL_BYTES and len(self._tail) > 1:
                dropped = self._tail.popleft()
                self._tail_bytes -= len(dropped)
                self._dropped += len(dropped)


class LocalProcess:
    """The `AgentProcess` contract over one process on one rung."""

    def __init__(self, process: ConfinedProcess, output: _Output, program: str, isolation: str) -> None:
        self.isolation, self.own_user = isolation, process.own_user
        self.open_walls: tuple[Wall, ...] = leaves_open(isolation, this_host(own_user=process.own_user))
        self._process = process
        self._output = output
        self._program = program
        self._ended = False

    @property
    def pid(self) -> int:
        return self._process.pid

    def root(self) -> ProcessRoot:
        return self._process.root()

    def exit_code(self) -> int | None:
        code = self._process.poll()
        if code is None or self._ended:
            return code
        # A limit may have ended the whole box: that end is the agent's own.
        if not self._process.exceeded_limit() and (killed := self._process.killed_from_outside()):
            raise AgentBoxKilled(f"{killed} was killed by somebody outside, and the agent with it")
        if failure := self._process.start_failure():
            remedy = "restore the program, or correct the command in the manifest"
            raise SetupError("agent.manifest", f"{self._program} {failure}{self._last_line()}", remedy)
        return code

    def usage(self) -> AgentUsage:
        return self._process.usage()

    def exceeded_limit(self) -> str:
        return self._process.exceeded_limit()

    def output(self) -> bytes:
        """What it wrote, shortened in the middle when it was much; after the end all of it."""
        return self._output.text()

    def output_tail(self) -> str:
        return self._output.text()[-LAST_WORDS_BYTES:].decode(errors="replace")

    def end(self) -> None:
        """Wait for the agent, ask it to end, kill it and everything that it started."""
        self._wait(LEAVE_S)
        self._process.ask_to_end()
        self._wait(GRACE_S)
        self._ended = True
        self._process.end()

    def _last_line(self) -> str:
        """What the rung wrote when it could not start the program: the last line of the output."""
        # The pump has it in a moment: the process that wrote it has ended.
        deadline = time.monotonic() + LEAVE_S
        while not self.output_tail() and time.monotonic() < deadline:
            time.sleep(0.005)
        lines = self.output_tail().strip().splitlines()
        return f": {lines[-1].rpartition(': ')[2]}" if lines else ""

    def _wait(self, span_s: float) -> None:
        deadline = time.monotonic() + span_s
        while self._process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.005)
