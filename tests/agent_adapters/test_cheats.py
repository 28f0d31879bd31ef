"""Each cheat, in a session: it gains nothing, harms nobody, leaves nothing, has its outcome."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import pytest
from anyio.from_thread import start_blocking_portal
from cheats import _resources
from cheats._catalogue import CHEATS
from flown_scenes import DECOMPOSITION, small_scene
from host_servers import server

from bench.agents import load_manifest
from bench.agents.confinement import rungs
from bench.agents.confinement._landlock import namespaces_fault
from bench.campaign import Task, WorkerPlan, load_measurable_decomposition, open_local_pool
from bench.campaign.execution._executor import FLIGHTS
from bench.contracts import Confinement, Observation, Outcome, SessionResult
from bench.documents import dump_json
from bench.simspec import SimSpec

MANIFEST = Path(__file__).parent / "cheats" / "cheat.yaml"
LIMIT_S = 4.0
LONG_S = {"flood-decisions": 8.0, "flood-link": 30.0}
QUICK = (
    *("read-files", "write-campaigns", "kill-bench", "leave-daemon"),
    *("subscribe-truth", "set-simulation", "flood-reports", "acknowledge-ahead"),
)
"""Flown by `make test`: one of each kind, and those that got something before there were walls."""

ENDED_BY_LANDLOCK = {"fill-disk": "limit of 16 MB in its folder"}
"""Without namespaces landlock watches what other rungs wall off, and ends the agent; docs/agents-confinement.md says so."""
MERIT = {"OBS-362"}
"""What is said can be read: whoever says anything has that, and an idle agent has not."""


@dataclass(frozen=True)
class Flight:
    """The result of one session, what the agent printed of its gains, and what was found on the host afterwards."""

    result: SessionResult
    attempts: int
    gains: dict[str, object]
    remains: list[str]
    neighbour_intact: bool
    log_bytes: int

    @property
    def confinement(self) -> Confinement:
        confinement = self.result.fact(Confinement)
        assert confinement is not None
        return confinement


def simspec(manifest: str, isolation: str | None, limit_s: float, **options: str | int) -> SimSpec:
    """Two targets and a bystander in the open, and an agent with hints that a cheat would have to guess."""
    places = (("soldier", 30.0, 30.0), ("soldier", -40.0, 10.0), ("civilian", 10.0, -40.0))
    return small_scene(
        {"manifest": manifest, "isolation": isolation, "options": options},
        *((f"group-{number}", *place) for number, place in enumerate(places)),
        name="cheats",
        mission={"altitude_m": 25.0, "time_limit_s": limit_s},
        # Host time of the agent's own: `dawdle` waits for it, and nobody else comes near.
        budgets={"reply_s": 8.0},
    )


def digest(folder: Path) -> dict[str, str]:
    """Every file below a folder with a digest of its content."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path): sha256(path.read_bytes()).hexdigest() for path in files}


def traces(marker: str) -> list[str]:
    """Processes of the host that carry the marker, and files with it where programs may write."""
    matches = [
        str(path)
        for folder in ("/tmp", "/var/tmp", "/dev/shm", "/run", "/etc", "/usr/local", "/")
        for path in Path(folder).glob(f"*{marker}*")
        if path.is_file()
    ]
    for entry in os.scandir("/proc"):
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            for name in ("cmdline", "environ"):
                with suppress(OSError):
                    if marker.encode() in Path(entry.path, name).read_bytes():
                        matches.append(f"{entry.path}/{name}")
    with suppress(OSError):
        segments = Path("/proc/sysvipc/shm").read_text().splitlines()[1:]
        matches += [f"shared memory {row}" for row in segments if int(row.split()[0]) == 0x5EBAC]
    return matches


class Range:
    """A worker in a network of its own that flies cheats beside the folder of a neighbouring campaign."""

    def __init__(self, folder: Path, port: int, run: Callable[[Task], SessionResult]) -> None:
        self._folder, self._port, self._run = folder, port, run
        self._results: dict[tuple[str, str], Flight] = {}
        self._neighbour = folder / "neighbour"
        self._neighbour.mkdir()
        for name in ("journal.sqlite", "scores.json", "manifest.json", "simspec.json"):
            (self._neighbour / name).write_text('{"realized": {"actors": [{"east_m": 1.0, "north_m": 2.0}]}}')

    def fly(self, agent: str, isolation: str = "auto") -> Flight:
        """Fly an agent once on a rung; the second time it is the same flight."""
        key = (agent, isolation)
        if key not in self._results:
            self._results[key] = self._fly(agent, isolation)
        return self._results[key]

    def _fly(self, agent: str, isolation: str) -> Flight:
        name = f"{agent}-{isolation}"
        folder = self._folder / "runs" / name
        folder.mkdir(parents=True)
        marker = f"rebar-cheat-{os.getpid()}-{name}"
        trick = agent.removeprefix("cheat-")
        manifest = agent if trick == agent else str(MANIFEST)
        spec = simspec(
            manifest,
            None if isolation == "auto" else isolation,
            LONG_S.get(trick, LIMIT_S),
            trick=trick,
            marker=marker,
            session=str(folder),
            neighbour=str(self._neighbour),
            host_port=self._port,
        )
        document_path = self._folder / f"{name}.json"
        document_path.write_text(dump_json(spec))
        before = digest(self._neighbour)
        result = self._run(Task(name, document_path, folder, 600.0))
        log = folder / "agent.log"
        lines = log.read_text(errors="replace").splitlines() if log.is_file() else []
        gains = [json.loads(line) for line in lines if line.startswith('{"cheat"')]
        return Flight(
            result=result,
            attempts=gains[-1]["attempts"] if gains else 0,
            gains=gains[-1]["gains"] if gains else {},
            remains=traces(marker),
            neighbour_intact=digest(self._neighbour) == before,
            log_bytes=log.stat().st_size if log.is_file() else 0,
        )


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Range]:
    folder = tmp_path_factory.mktemp("cheats")
    plan = WorkerPlan(FLIGHTS.flight, load_measurable_decomposition(DECOMPOSITION))
    with (
        # A server of the host that takes every connection.
        server(lambda _: None) as port,
        # An event loop in a thread of its own: the pool lives as long as all tests together.
        start_blocking_portal() as portal,
        portal.wrap_async_context_manager(open_local_pool(plan, 1, folder)) as pool,
    ):
        yield Range(folder, port, lambda task: portal.call(pool.fly, task, lambda worker: None))


def achieved(observations: tuple[Observation, ...]) -> set[str]:
    """Observables whose measured value reaches their threshold."""
    observables = load_measurable_decomposition(DECOMPOSITION).observables
    return {
        item.observable
        for item in observations
        if item.x is not None and item.x >= observables[item.observable].threshold
    }


def walls_hold(trick: str, confinement: Confinement) -> bool:
    """Whether the rung and the network of this flight are to hold the trick."""
    match CHEATS[trick].held_by:
        case "rung":
            return confinement.isolation == "landlock"
        case "network":
            return confinement.network == "own"
        case "bench":
            return True


def check(trick: str, flights: Range, isolation: str = "auto") -> None:
    flight = flights.fly(f"cheat-{trick}", isolation)
    result, confinement = flight.result, flight.confinement
    # Its end counts against it: no trick makes a session disappear.
    assert result.outcome.counts
    if confinement.isolation == "landlock" and namespaces_fault() and trick in ENDED_BY_LANDLOCK:
        assert result.outcome is Outcome.AGENT_CRASHED, result.reason
        assert ENDED_BY_LANDLOCK[trick] in result.reason
    else:
        assert result.outcome is Outcome(CHEATS[trick].outcome), result.reason
        assert flight.attempts > 0
    assert flight.log_bytes < 400_000
    if not walls_hold(trick, confinement):
        walls = f"{confinement.isolation} with network {confinement.network}"
        pytest.skip(f"{trick} needs a wall that {walls} has not")
    assert not any(flight.gains.values()), flight.gains
    assert flight.remains == []
    assert flight.neighbour_intact
    idle = flights.fly("null-idle").result
    assert idle.outcome is Outcome.TIME_LIMIT
    assert achieved(result.observations) - MERIT <= achieved(idle.observations)


@pytest.mark.flight
@pytest.mark.process
@pytest.mark.parametrize("trick", QUICK)
def test_a_cheat_gains_nothing(trick: str, flights: Range) -> None:
    """One of each kind, on the rung that this host gives."""
    check(trick, flights)


WORKING_RUNGS = [name for name in ("landlock",) if rungs()[name].trial() is None]


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.process
@pytest.mark.parametrize("isolation", WORKING_RUNGS)
@pytest.mark.parametrize("trick", [trick for trick in CHEATS if trick not in QUICK])
def test_every_other_cheat_gains_nothing_on_every_rung(trick: str, isolation: str, flights: Range) -> None:
    """`auto`, on which the quick ones fly, is the first rung that works."""
    check(trick, flights, isolation)


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.process
@pytest.mark.parametrize(
    "trick",
    ["read-files", "read-environment", "write-campaigns", "kill-bench", "leave-daemon", "leave-files"],
)
def test_without_walls_a_cheat_gets_something(trick: str, flights: Range) -> None:
    """So the tests above can fail. The trick itself does no harm: what it leaves, this test removes."""
    flight = flights.fly(f"cheat-{trick}", "none")
    assert flight.result.outcome is Outcome.TIME_LIMIT, flight.result.reason
    for trace in flight.remains:
        if trace.startswith("/proc/"):
            with suppress(ProcessLookupError):
                os.kill(int(trace.split("/")[2]), signal.SIGKILL)
        elif trace.startswith("/"):
            Path(trace).unlink(missing_ok=True)
    assert any(flight.gains.values()) or flight.remains


def test_the_tricks_stay_within_the_limits_of_their_manifest() -> None:
    """What a trick takes to try a limit is the limit that the manifest sets."""
    limits = load_manifest(MANIFEST)[0].limits
    assert limits.memory_mb == _resources.MEMORY_MB
    assert limits.processes == _resources.PROCESSES
    assert limits.scratch_mb == _resources.SCRATCH_MB


@pytest.mark.process
@pytest.mark.parametrize("given", [{}, {"REBAR_VEHICLE": "vehicle_1", "REBAR_MAVLINK": "udpin:127.0.0.1:1"}])
def test_a_cheat_refuses_to_run_outside_a_session(given: dict[str, str]) -> None:
    """Also with a part of what a session gives. It says why, and tries nothing."""
    command = [sys.executable, str(MANIFEST.with_name("__main__.py")), "kill-everything"]
    done = subprocess.run(command, env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "this is no session" in done.stderr
    assert "REBAR_TICK" in done.stderr
