"""An agent as a local process: clean environment, bounded output, and an end that includes every process it
started.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from bench.contracts import AgentPlan, AgentUsage
from bench.errors import Fault, SetupError
from bench.simspec import seed_of

from . import _launch
from ._process_usage import ProcessTreeUsage
from ._program import expand_command, expand_placeholders

# Host times, chosen: for an agent to exit by itself after the tick socket's end, and between SIGTERM and
# SIGKILL.
LEAVE_S = 0.25
GRACE_S = 2.0
# The largest file that an agent may write: a run-away log must not fill the disk.
FILE_BYTES = 256 * 1024 * 1024
# Kept of the beginning and of the end of its output: the start shows the set-up, the end shows why it
# stopped.
HEAD_BYTES = 256 * 1024
TAIL_BYTES = 64 * 1024
LAST_WORDS_BYTES = 4000
# Of 64 KiB each, which is more than a pipe of Linux holds.
LAST_READS = 64
READ_BYTES = 65536
OUTPUT_FILE = "agent.log"
TRUTH_FILE = "truth.json"


@contextmanager
def open_agent(plan: AgentPlan) -> Iterator[LocalProcess]:
    """Start the agent in its scratch folder; leaving the block ends it and whatever it started, by force if
    need be.

    The thread that enters must outlive the agent: the kernel ends the agent when that thread ends, so an
    agent never survives its session. What the agent wrote is in `agent.log` of the scratch folder afterwards,
    shortened in the middle when it was much. Raises SetupError when the command or the environment names an
    option that the SimSpec does not have.
    """
    options = plan.simspec.agent.options
    command = expand_command(plan.manifest, plan.folder, options)
    environment = environment_of(plan)
    plan.scratch.mkdir(parents=True, exist_ok=True)
    if plan.truth is not None:
        (plan.scratch / TRUTH_FILE).write_text(plan.truth.model_dump_json())
    with _open_output(plan.scratch / OUTPUT_FILE) as output:
        failure_end, launcher_end = os.pipe()
        try:
            # Through a launcher and not a preexec_fn, because this process has threads; see _launch.
            launch = [_launch.__file__, str(os.getpid()), str(FILE_BYTES), str(launcher_end)]
            started = subprocess.Popen(
                [sys.executable, "-I", "-S", *launch, *command],
                cwd=plan.scratch,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output.write_end,
                stderr=output.write_end,
                pass_fds=(launcher_end,),
                start_new_session=True,
            )
        except BaseException:
            os.close(failure_end)
            raise
        finally:
            os.close(launcher_end)
        output.begin()
        agent = LocalProcess(started, output, home=str(plan.scratch), failure_end=failure_end)
        try:
            yield agent
        finally:
            agent.end(home=str(plan.scratch))


def environment_of(plan: AgentPlan) -> dict[str, str]:
    """The agent's whole environment. Nothing of the bench's environment leaks into it."""
    ends = plan.endpoints
    spec = plan.simspec
    environment = {
        "PATH": os.environ.get("PATH", os.defpath),
        "HOME": str(plan.scratch),
        "LANG": "C.UTF-8",
        "PYTHONHASHSEED": "0",
        "PYTHONUNBUFFERED": "1",
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
        environment["REBAR_TRUTH"] = str(plan.scratch / TRUTH_FILE)
    stated = expand_placeholders(plan.manifest, plan.folder, spec.agent.options, plan.manifest.environment)
    return environment | dict(ends.mavlink) | stated


class _Output:
    """Takes in what the agent writes and keeps its beginning and its end.

    A thread reads, so that an agent never waits for the simulation in order to write; past the first
    `HEAD_BYTES` it reads at a bounded rate, so that one that floods waits for us instead of using up the
    machine.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
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
        """Take in what is left, without waiting for anyone who still holds the pipe, and write the file."""
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join()
        for end in (self._read_end, self.write_end):
            if end >= 0:
                os.close(end)
        self._path.write_bytes(self.text())

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
        # What the agent wrote last is still in the pipe. Bounded, because a process that it left behind may
        # go on writing.
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


@contextmanager
def _open_output(path: Path) -> Iterator[_Output]:
    output = _Output(path)
    try:
        yield output
    finally:
        output.close()


class LocalProcess:
    """The `AgentProcess` contract over one local process and its group."""

    def __init__(
        self, started: subprocess.Popen[bytes], output: _Output, home: str, failure_end: int
    ) -> None:
        self._started = started
        self._failure_end: int | None = failure_end
        self._output = output
        self._tree = ProcessTreeUsage(started.pid, home)
        self._usage = AgentUsage()
        # Set once the process has ended.
        self._reaped_cpu_s = 0.0

    @property
    def pid(self) -> int:
        return self._started.pid

    def exit_code(self) -> int | None:
        code = self._poll()
        if code == _launch.NOT_FOUND and (failure := self._launch_failure()):
            remedy = "restore the program, or correct the command in the manifest"
            raise SetupError(Fault("agent.manifest", failure.decode(errors="replace"), remedy))
        return code

    def _launch_failure(self) -> bytes:
        """What the launcher said before it gave up; empty once the agent has been ended."""
        return b"" if self._failure_end is None else os.read(self._failure_end, READ_BYTES)

    def _poll(self) -> int | None:
        if self._started.returncode is None:
            self._reap(os.WNOHANG)
        return self._started.returncode

    def usage(self) -> AgentUsage:
        # Not after the end: the kernel may give the id to a stranger.
        if self._poll() is None:
            self._usage = self._tree.read()
        return replace(self._usage, cpu_s=max(self._usage.cpu_s, self._reaped_cpu_s))

    def output_tail(self) -> str:
        return self._output.text()[-LAST_WORDS_BYTES:].decode(errors="replace")

    def end(self, home: str) -> None:
        """Wait for the agent, ask its process group to end, kill it; then kill what left the group but has
        the agent's HOME.
        """
        self._wait(LEAVE_S)
        self._signal(signal.SIGTERM)
        self._wait(GRACE_S)
        self._signal(signal.SIGKILL)
        for pid in _processes_with_home(home):
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        if self._poll() is None:
            self._reap(0)
        # Forgotten with the close: the number may soon be that of another file of this process.
        if self._failure_end is not None:
            os.close(self._failure_end)
            self._failure_end = None

    def _wait(self, span_s: float) -> None:
        deadline = time.monotonic() + span_s
        while self._poll() is None and time.monotonic() < deadline:
            time.sleep(0.005)

    def _signal(self, number: signal.Signals) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, number)

    def _reap(self, options: int) -> None:
        """As Popen.poll, but keeps the CPU time that the kernel tells only once."""
        try:
            pid, status, usage = os.wait4(self.pid, options)
        except ChildProcessError:
            # Another thread reaped the process, so its exit code is lost.
            self._started.returncode = -signal.SIGKILL
            return
        if pid:
            self._reaped_cpu_s = usage.ru_utime + usage.ru_stime
            self._started.returncode = os.waitstatus_to_exitcode(status)


def _processes_with_home(home: str) -> Iterator[int]:
    """Processes, other than this one, that were started with this HOME: the agent's own, wherever they
    moved.
    """
    wanted = f"HOME={home}".encode()
    for entry in os.scandir("/proc"):
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            with suppress(OSError):
                if wanted in Path(entry.path, "environ").read_bytes().split(b"\0"):
                    yield int(entry.name)
