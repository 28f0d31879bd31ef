"""An agent that spoils what the bench might open, shorten or remove loses its own session and nothing else, on every rung."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest
from own_network import call_in_own_network
from rungs import BARE, CONFINING, rung_or_skip
from started_agents import EXAMPLE, plan_of, until
from warp_host import library_or_skip

from bench.agents import open_agent
from bench.campaign import load_measurable_decomposition
from bench.campaign.execution._flight import fly_here
from bench.contracts import AgentManifest, Outcome, SessionResult
from bench.realization import place
from bench.removal import remove_tree
from bench.simspec import Isolation, PaceMode, load_simspec

WORDS = "what the agent prints"
PRECIOUS = b"a result of somebody else\n"
# Each leaves something in the agent's folder under the name of what the bench once wrote there, and as what comes first
# to mind. `victims` are files of the bench's user; those that the agent can reach by itself are for the rung `none`.
TRICKS = {
    "link": "for victim in victims: os.symlink(victim, name(victim))",
    "chain of links": "os.symlink(victims[0], 'a'); os.symlink('a', 'agent.log'); os.symlink(os.getcwd(), 'b')",
    "dangling link": "os.symlink('/nowhere/at/all', 'agent.log')",
    "folder": "os.makedirs('agent.log/in/it')",
    "full device": "os.symlink('/dev/full', 'agent.log')",
    "endless device": "os.symlink('/dev/zero', 'agent.log')",
    "pipe": "os.mkfifo('agent.log')",
    "closed folder": "os.mkdir('closed'); open('closed/file', 'w').close(); close('closed')",
    "link to a folder": "os.symlink(os.path.dirname(victims[0]), 'agent.log')",
    "nested folders": "nest(1200)",
    "long names": "nest(100, 'n' * 255)",
}
AGENT = """
import os, sys
victims = sys.argv[2:]
name = os.path.basename
def nest(count, folder='n'):
    held = os.open('.', os.O_RDONLY)
    for _ in range(count):
        os.mkdir(folder, dir_fd=held)
        deeper = os.open(folder, os.O_RDONLY, dir_fd=held)
        os.close(held)
        held = deeper
def close(folder):
    try:
        os.chmod(folder, 0)
    except PermissionError:
        pass
print('what the agent prints', flush=True)
exec(sys.argv[1])
sys.exit(3)
"""
# All that it gets of what the kernel counts for each user.
GREEDY = """
import ctypes, time
libc = ctypes.CDLL(None)
instances, timers, timer = 0, 0, ctypes.c_void_p()
while instances < 1000 and libc.inotify_init() >= 0:
    instances += 1
while timers < 100000 and libc.timer_create(1, None, ctypes.byref(timer)) == 0:
    timers += 1
print(instances, timers, flush=True)
time.sleep(600)
"""
PAGE_TRICKS = {
    "shortened": "os.truncate(page, 0)",
    "shortened by half": "os.truncate(page, 4096)",
    "zeros": "open(page, 'r+b').write(bytes(os.path.getsize(page)))",
    "ones": "open(page, 'r+b').write(b'\\xff' * os.path.getsize(page))",
    "many slots": "open(page, 'r+b').write(open(page, 'rb').read(16) + b'\\xff' * 4)",
}
PAGE_AGENT = """
import os, sys, time
page = os.environ['REBAR_WARP_WAITERS']
exec(sys.argv[1])
time.sleep(0.5)
time.sleep(600)
"""


def flown(folder: Path, isolation: Isolation, pace: PaceMode, code: str, *arguments: str) -> SessionResult:
    """The result of a session with this agent, of two simulated seconds at most, in `folder`/run."""
    manifest = folder / "tricky.yaml"
    document = {
        "name": "tricky",
        "command": ["{python}", "-I", "-S", "-c", code, *arguments],
        "pace": [pace],
        "zenoh": False,
        "isolation": isolation,
    }
    manifest.write_text(json.dumps(document))
    spec = load_simspec(EXAMPLE)
    update = {
        "mission": spec.mission.model_copy(update={"time_limit_s": 2.0}),
        "pace": spec.pace.model_copy(update={"mode": pace}),
        "agent": spec.agent.model_copy(update={"manifest": str(manifest)}),
    }
    placed = place(spec.model_copy(update=update))
    return fly_here(placed, load_measurable_decomposition("search-and-report"), folder / "run", "tricky")


# Without walls the agent reaches all that the bench might open. Behind them its folder is removed in other ways.
@pytest.mark.parametrize(
    ("trick", "rung"),
    [
        *((trick, "none") for trick in TRICKS),
        *(
            (trick, rung)
            for rung in CONFINING
            for trick in ("link", "closed folder", "nested folders", "long names")
        ),
    ],
)
def test_what_an_agent_leaves_in_its_folder_decides_nothing(
    trick: str, rung: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its end and its output are its own, no file but its own has changed, and its folder is gone."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    victims = [tmp_path / "result.json", tmp_path / "earlier" / "agent.log"]
    for victim in victims:
        victim.parent.mkdir(exist_ok=True)
        victim.write_bytes(PRECIOUS)
    with rung_or_skip(rung) as isolation:
        result = flown(tmp_path, isolation, "lockstep", AGENT, TRICKS[trick], *map(str, victims))
    assert result.outcome is Outcome.AGENT_CRASHED, result.reason
    # A watch on a folder of the disk may be there first.
    assert "exit code 3" in result.reason or (rung == BARE and "folders in one another" in result.reason)
    assert (tmp_path / "run" / "agent.log").read_text() == f"{WORDS}\n"
    assert [victim.read_bytes() for victim in victims] == [PRECIOUS] * 2
    assert list(temporary.glob("rebar-agent-*")) == []


# The page is a file that the bench and the agent map, the same behind every wall: one rung with walls, and none.
@pytest.mark.parametrize(
    ("trick", "rung"), [*((trick, "landlock") for trick in PAGE_TRICKS), ("shortened", "none")]
)
def test_who_spoils_the_page_of_warp_loses_the_run(trick: str, rung: str, tmp_path: Path) -> None:
    """Before the agent has said anything, the run counts all the same: so does one in which nothing of use was cut off."""
    library_or_skip()
    with rung_or_skip(rung) as isolation:
        result = flown(tmp_path, isolation, "warp", PAGE_AGENT, PAGE_TRICKS[trick])
    if trick == "shortened by half":
        assert result.outcome is Outcome.TIME_LIMIT, result.reason
    elif trick == "shortened" and result.outcome is Outcome.AGENT_CRASHED:
        # Its own reads of what is no longer there may end it before the bench looks.
        assert "signal 7" in result.reason
    else:
        assert result.outcome is Outcome.AGENT_PROTOCOL
        assert "REBAR_WARP_WAITERS" in result.reason


def used_up(folder: Path, *, beside: int) -> tuple[int, int] | None:
    """How many inotify instances and timers an agent of this process gets, and keeps while another one in a process of its
    own asks for as many; None where it has the user of the process `beside` (0: of none).
    """
    if beside and os.getpid() % 500 == beside % 500:
        return None
    command = ("{python}", "-I", "-S", "-c", GREEDY)
    manifest = AgentManifest(name="greedy", command=command, isolation="landlock", zenoh=False)
    with open_agent(plan_of(manifest, folder, folder / "scratch")) as agent:
        assert agent.own_user or os.getuid() != 0
        until(lambda: b"\n" in agent.output() or agent.exit_code() is not None)
        assert agent.exit_code() is None, agent.output_tail()
        instances, timers = map(int, agent.output().split())
        if not beside:
            other = None
            while other is None:
                other = call_in_own_network(folder, used_up, folder / "other", beside=os.getpid())
            instances, timers = other
    return instances, timers


def test_what_an_agent_uses_up_no_agent_of_another_worker_misses(tmp_path: Path) -> None:
    """An ordinary user's agents have one user, so they share its inotify instances."""
    with rung_or_skip("landlock"):
        taken = used_up(tmp_path, beside=0)
    assert taken is not None
    assert taken[1] == 4096
    assert taken[0] > 0 or os.getuid() != 0


def test_a_tree_is_removed_at_any_depth_without_following_links(tmp_path: Path) -> None:
    """Two trees, one deeper than Python's recursion, with links out, folders that nobody may read, and many files."""
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "kept").write_bytes(PRECIOUS)
    for number, depth in enumerate((3, 2 * sys.getrecursionlimit() + 100)):
        top = tmp_path / f"tree-{number}"
        top.mkdir()
        held = os.open(top, os.O_RDONLY)
        for level in range(depth):
            os.symlink(outside, "link", dir_fd=held)
            os.close(os.open("file", os.O_CREAT, 0o000, dir_fd=held))
            for name in ("n", f"{os.getpid()}-{level}"):
                os.mkdir(name, dir_fd=held)
            deeper = os.open("n", os.O_RDONLY, dir_fd=held)
            os.chmod(deeper, 0o700)
            os.chmod(f"{os.getpid()}-{level}", 0o000, dir_fd=held)
            os.close(held)
            held = deeper
        os.close(held)
        remove_tree(top)
        assert not top.exists()
    remove_tree(tmp_path / "never made")
    assert (outside / "kept").read_bytes() == PRECIOUS
