"""Host time of an agent and all that it started: from a made /proc, and from real processes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_agent_process import python, wait_for

from bench.agents import open_agent
from bench.agents._process_usage import ProcessTreeUsage
from bench.contracts import AgentUsage

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


class Host:
    """A /proc with the processes that a test writes into it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def put(
        self,
        pid: int,
        parent: int,
        session: int,
        cpu_s: float,
        delays_s: dict[int, float],
        *,
        nice: int = 0,
        policy: int = 0,
        home: str = "/elsewhere",
        start: int = 0,
    ) -> None:
        """Write a process with one thread for each delay."""
        fields = ["0"] * 50
        fields[0], fields[1], fields[3] = "S", str(parent), str(session)
        fields[11] = str(round(cpu_s * TICKS_PER_S))
        fields[16], fields[19], fields[38] = str(nice), str(start), str(policy)
        stat = f"{pid} (a) b) {' '.join(fields)}"
        process = self.folder / str(pid)
        process.mkdir(exist_ok=True)
        (process / "stat").write_text(stat)
        (process / "environ").write_bytes(f"PATH=/bin\0HOME={home}\0".encode())
        for tid, delay_s in delays_s.items():
            task = process / "task" / str(tid)
            task.mkdir(parents=True, exist_ok=True)
            (task / "stat").write_text(stat)
            (task / "schedstat").write_text(f"123 {round(delay_s * 1e9)} 7\n")

    def remove(self, pid: int) -> None:
        shutil.rmtree(self.folder / str(pid))


@pytest.fixture
def host(tmp_path: Path) -> Host:
    return Host(tmp_path)


def usage(host: Host) -> ProcessTreeUsage:
    return ProcessTreeUsage(100, "/scratch/agent", proc=host.folder, nice=0)


def test_two_agents_on_one_host_are_told_apart(host: Host) -> None:
    """Threads, children and grandchildren of one agent are added; those of the other and of the host are not."""
    host.put(1, 0, 1, 90.0, {1: 90.0})
    host.put(100, 1, 100, 2.0, {100: 1.0, 101: 0.5})
    host.put(110, 100, 100, 3.0, {110: 0.25})
    host.put(111, 110, 111, 4.0, {111: 0.125})  # a session of its own
    host.put(200, 1, 200, 7.0, {200: 40.0})
    assert usage(host).read() == AgentUsage(9.0, 1.875)
    assert ProcessTreeUsage(200, "/scratch/other", host.folder, 0).read() == AgentUsage(7.0, 40.0)


def test_children_that_ended_stay_counted(host: Host) -> None:
    """What a parent waited for moves into its own time; what nobody did is kept; neither is counted twice."""
    tree = usage(host)
    host.put(100, 1, 100, 1.0, {100: 0.5})
    host.put(110, 100, 100, 2.0, {110: 0.25})
    host.put(120, 1, 100, 4.0, {120: 0.125})  # an orphan in the agent's session
    assert tree.read() == AgentUsage(7.0, 0.875)
    host.remove(110)
    host.remove(120)
    host.put(100, 1, 100, 3.0, {100: 0.5})
    assert tree.read() == AgentUsage(7.0, 0.875)
    assert tree.read() == AgentUsage(7.0, 0.875)


def test_a_process_id_that_is_used_again_is_a_new_process(host: Host) -> None:
    """The kernel gave the id of an ended child to a stranger."""
    tree = usage(host)
    host.put(100, 1, 100, 1.0, {})
    host.put(110, 100, 100, 2.0, {110: 0.25}, start=5)
    tree.read()
    host.put(110, 1, 1, 50.0, {110: 9.0}, start=6)
    assert tree.read().starved_s == 0.25


def test_a_daemon_is_recognised_by_its_home(host: Host) -> None:
    """It left the session and its parent has ended; a stranger with another HOME is not taken for it."""
    host.put(100, 1, 100, 1.0, {100: 0.5})
    host.put(300, 1, 300, 2.0, {300: 0.25}, home="/scratch/agent")
    host.put(301, 1, 301, 8.0, {301: 8.0}, home="/scratch/agent2")
    assert usage(host).read() == AgentUsage(3.0, 0.75)


@pytest.mark.parametrize(("nice", "policy"), [(1, 0), (0, 5), (0, 2)])
def test_a_thread_that_chose_to_wait_excuses_nothing(host: Host, nice: int, policy: int) -> None:
    """A lower or a special priority is the agent's own choice; its running time counts all the same."""
    host.put(100, 1, 100, 1.0, {100: 0.5})
    host.put(110, 100, 100, 2.0, {110: 30.0}, nice=nice, policy=policy)
    assert usage(host).read() == AgentUsage(3.0, 0.5)


def test_a_system_without_proc_tells_nothing(host: Host, tmp_path: Path) -> None:
    """Then no wait is excused; nor where the kernel has no schedstat."""
    assert ProcessTreeUsage(100, "/scratch/agent", tmp_path / "nowhere", 0).read() == AgentUsage()
    host.put(100, 1, 100, 1.0, {100: 0.5})
    (tmp_path / "100" / "task" / "100" / "schedstat").unlink()
    assert usage(host).read() == AgentUsage(1.0, 0.0)


# Counts of work, not of seconds: the agent loops this often while a neighbour on its core loops for ever. It sleeps
# until then: whoever yields the core for a while may run alone for as long afterwards.
LOOPS = 3_000_000
SHARED_CORE = f"""
import os, time
core = min(os.sched_getaffinity(0))
os.sched_setaffinity(0, {{core}})
open('core', 'w').write('%d\\n' % core)
while not os.path.exists('go'):
    time.sleep(0.01)
for _ in range({LOOPS}):
    pass
open('ready', 'w').write('\\n')
import signal
signal.pause()
"""


def wait_for_file(path: Path) -> str:
    wait_for(path.name, lambda: path.exists() and path.read_text().endswith("\n"))
    return path.read_text()


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="this kernel has no schedstat")
def test_a_real_agent_beside_busy_loops_is_starved_and_a_sleeping_one_is_not(tmp_path: Path) -> None:
    """Two busy loops share the core of one agent; the other agent sleeps as long."""
    sleeper_code = "open('ready', 'w').write('\\n')\nimport signal; signal.pause()"
    busy, asleep = (tmp_path / name / "home" for name in ("busy", "asleep"))
    with (
        open_agent(python(tmp_path / "busy", SHARED_CORE)) as agent,
        open_agent(python(tmp_path / "asleep", sleeper_code)) as sleeper,
    ):
        core = int(wait_for_file(busy / "core"))
        wait_for_file(asleep / "ready")
        asleep_before = sleeper.usage()
        before = agent.usage()
        loop = f"import os\nos.sched_setaffinity(0, {{{core}}})\nos.write(1, b'.')\nwhile True: pass"
        loops = [
            subprocess.Popen([sys.executable, "-S", "-c", loop], stdout=subprocess.PIPE) for _ in range(2)
        ]
        try:
            # On a busy host the agent could be done before its neighbours have started.
            for process in loops:
                assert process.stdout is not None
                assert process.stdout.read(1) == b"."
            (busy / "go").touch()
            wait_for_file(busy / "ready")
        finally:
            for process in loops:
                process.kill()
                process.communicate()
        after, asleep_after = agent.usage(), sleeper.usage()
    starved_s, cpu_s = after.starved_s - before.starved_s, after.cpu_s - before.cpu_s
    assert cpu_s > 0.0
    # A fair scheduler lets two others run for each slice of the agent's.
    assert starved_s > 0.25 * cpu_s
    assert asleep_after.starved_s - asleep_before.starved_s < 0.25 * starved_s
