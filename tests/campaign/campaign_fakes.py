"""Fake sessions for campaign tests: a job for real worker processes, with a script of what each realization does."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from bench.contracts import (
    FIRMWARE_FAILED,
    AgentExit,
    Confinement,
    OnProgress,
    Outcome,
    ProgressUpdate,
    SessionResult,
    Texts,
    facts_of,
)
from bench.errors import Fault, SetupError
from bench.simspec import ActorGroup, Budgets, Point, Polygon, Role, SimSpec, World

# Every worker imports this module for its job, and these rooms are half of that: the functions of the runner's side
# import them.
if TYPE_CHECKING:
    from bench.campaign import Campaign, CampaignFolder, CampaignSummary, JournalEntry, Observer

T = TypeVar("T")
JOB = "campaign_fakes:fake_flight"


@dataclass(frozen=True)
class Script:
    """What each realization does, `ok` if it is not named. Takes the decomposition's place, which every job gets.

    It has no nodes, so every situation can be rated.
    """

    acts: dict[str, str] = field(default_factory=dict)
    digest: str = "0" * 64
    name: str = "script"
    nodes: tuple[str, ...] = ()
    observables: tuple[str, ...] = ()


def fake_flight(simspec: SimSpec, decomposition: Script, folder: Path, realization: str) -> SessionResult:
    """Write a recording as a session would, or fail as the script says."""
    assert list(folder.iterdir()) == [], "a job gets an empty run folder"
    act = decomposition.acts.get(realization, "ok")
    marker = folder.parent.parent / f"{realization}.met"
    if act.endswith("-once"):
        act = "ok" if marker.exists() else act.removesuffix("-once")
        marker.touch()
    if "REBAR_CAMPAIGN_FOLDER" in os.environ:
        # In a worker's folder, with which it goes; in the process of the tests nobody would remove it.
        Path(tempfile.mkdtemp(), "of a session").touch()
    (folder / "recording.mcap").write_bytes(f"half of {realization}".encode())
    match act:
        case "raise":
            raise ValueError("a made-up bench error")
        case "rob":
            raise FileNotFoundError("somebody removed the recording")
        case "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        case "vanish":
            raise SetupError(Fault("agent.manifest", "there is no such file", "restore it"))
        case "crash" | "killed":
            code = 1 if act == "crash" else -signal.SIGKILL
            reason = f"the agent's process ended with {code} before its mission did"
            return SessionResult(
                realization=realization,
                outcome=Outcome.AGENT_CRASHED,
                reason=reason,
                facts=facts_of(AgentExit(code=code)),
            )
        case "firmware":
            reason = f"{FIRMWARE_FAILED}: PX4 ended with SIGSEGV"
            return SessionResult(
                realization=realization, outcome=Outcome.BENCH_ERROR, reason=reason, simulated_s=12.5
            )
        case "exit":
            os._exit(3)
        case "babble":
            print("printed \x1b[2J\u202e –", flush=True)
            # As a library in C does, which knows nothing of Python's streams.
            os.write(2, b"written \x1b[2J\xff")
            os._exit(3)
        case "segv":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "hang":
            agent = subprocess.Popen(
                [sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True
            )
            (folder.parent.parent / "agent.pid").write_text(str(agent.pid))
            time.sleep(600)
        case "leave":
            sys.exit(7)
    (folder / "recording.mcap").write_bytes(f"all of {realization}, seed {simspec.seeds.root}".encode())
    return SessionResult(realization=realization, outcome=Outcome.COMPLETED, simulated_s=1.0)


SECOND_TRY = "campaign_fakes:second_try"


def second_try(simspec: SimSpec, decomposition: object, folder: Path, realization: str) -> SessionResult:
    """A session whose first attempt the host spoils, for any decomposition."""
    del simspec, decomposition
    tried = folder.parent.parent / f"{realization}.tried"
    if not tried.exists():
        tried.touch()
        raise ValueError("a made-up bench error")
    tried.unlink()
    (folder / "recording.mcap").write_bytes(f"all of {realization}".encode())
    return SessionResult(realization=realization, outcome=Outcome.COMPLETED, simulated_s=1.0)


MIXED_ENDS = "campaign_fakes:mixed_ends"


def mixed_ends(simspec: SimSpec, decomposition: object, folder: Path, realization: str) -> SessionResult:
    """A session that repeats to the byte, for any decomposition: naive agents crash, others complete."""
    del decomposition
    (folder / "recording.mcap").write_bytes(f"all of {realization}, seed {simspec.seeds.root}".encode())
    outcome = Outcome.AGENT_CRASHED if "naive" in realization else Outcome.COMPLETED
    return SessionResult(realization=realization, outcome=outcome, simulated_s=1.0)


TELLING = "campaign_fakes:telling_flight"
UPDATES = tuple(
    ProgressUpdate(simulated_s=20.0 * number, time_limit_s=60.0, wall_s=2.0 * number, speed=10.0, phase=phase)
    for number, phase in enumerate(("taking_off", "searching"), 1)
)


def telling_flight(
    simspec: SimSpec, decomposition: object, folder: Path, realization: str, on_progress: OnProgress
) -> SessionResult:
    """A session that says twice how far it is."""
    for update in UPDATES:
        on_progress(update)
    return mixed_ends(simspec, decomposition, folder, realization)


FORFEIT = "campaign_fakes:fake_forfeit"


def fake_forfeit(simspec: SimSpec, decomposition: Script, folder: Path, realization: str) -> SessionResult:
    """The session of an agent that broke the bench, with a recording in which nothing flew."""
    (folder / "recording.mcap").write_bytes(f"none of {realization}".encode())
    return SessionResult(realization=realization, outcome=Outcome.AGENT_BROKE_BENCH)


CONFINED = "campaign_fakes:fake_confined"


def fake_confined(simspec: SimSpec, decomposition: Script, folder: Path, realization: str) -> SessionResult:
    """A session whose agent cannot reach the bench any more."""
    (folder / "recording.mcap").write_bytes(f"confined {realization}".encode())
    return SessionResult(
        realization=realization,
        outcome=Outcome.COMPLETED,
        facts=facts_of(Confinement(isolation="landlock", network="own")),
    )


YARD = Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in ((0, 0), (50, 0), (50, 50), (0, 50))))


def small_campaign(points: int = 3, replicates: int = 2, **budgets: Any) -> Campaign:
    """A campaign of points x replicates realizations over a yard with a few people in it."""
    from bench.campaign import Campaign, CampaignAgent, CampaignBudgets
    from bench.realization import Design, DesignFactor

    base = SimSpec(
        name="yard",
        world=World(area=YARD),
        actors=(ActorGroup(id="people", asset="civilian", role=Role.BYSTANDER, count=4),),
        budgets=Budgets(wall_s=60.0),
    )
    fog = DesignFactor(
        name="fog", levels=tuple(float(level) for level in range(points)), sets=("environment.fog_level",)
    )
    return Campaign(
        name="small",
        base=base,
        design=Design(factors=(fog,), replicates=replicates, seed=7),
        agents=(CampaignAgent(manifest="fake"),),
        # One retry, at once: only tests about the pauses between retries have some.
        budgets=CampaignBudgets(**({"retry_s": 0.0} | budgets)),
    )


def demo(count: int = 2, **changes: Any) -> Campaign:
    """So many scenes of the demo, by default at the overhead fidelity."""
    from bench.campaign import load_campaign

    campaign = load_campaign(Path(__file__).parents[2] / "campaigns" / "demo.yaml")
    method = campaign.design.method.model_copy(update={"take": count})
    design = campaign.design.model_copy(update={"method": method})
    return campaign.model_copy(update={"design": design, "fidelity": "overhead", **changes})


def to_scores(paths: CampaignFolder) -> None:
    """Ends a campaign with its scores and its report."""
    from bench.campaign import finish_campaign

    finish_campaign(paths.path)


def known(value: T | None) -> T:
    """A value that may be missing and is not."""
    assert value is not None
    return value


def texts_of(result: SessionResult, kind: type[Texts]) -> tuple[str, ...]:
    """The texts of a result's fact; none without it."""
    fact = result.fact(kind)
    return fact.texts if fact else ()


def fly(
    folder: Path,
    campaign: Campaign | None = None,
    script: Script | None = None,
    workers: int = 1,
    rerun: Collection[Outcome] = (),
    accept: Collection[Outcome] = (),
    forfeit: str | None = None,
    confined: str | None = None,
    **collaborators: Any,
) -> CampaignSummary:
    """Run a campaign of fakes in this process. A worker takes a second of CPU to start: only tests about workers open some."""
    from in_process_executor import open_in_process

    from bench.campaign import Collaborators, Jobs, RunOptions, run_campaign_sync

    collaborators.setdefault("open_executor", open_in_process())
    options = RunOptions(cast(Any, script or Script()), workers, rerun, accept)
    jobs = Jobs(JOB, forfeit, confined)
    return run_campaign_sync(
        campaign or small_campaign(), folder, options, Collaborators(jobs=jobs, **collaborators)
    )


def entries(folder: Path) -> dict[str, JournalEntry]:
    """What the journal of a campaign's folder has of each realization."""
    from bench.campaign import open_journal

    with open_journal(folder / "journal.sqlite") as journal:
        return {entry.id: entry for entry in journal.entries()}


def attempts(folder: Path) -> dict[str, int]:
    """How often each realization was flown."""
    return {name: entry.attempts for name, entry in entries(folder).items()}


def print_results() -> Observer:
    """Prints a line for every result, so that a test knows the progress of a runner in another process."""
    from bench.campaign import RealizationFinished

    def tell(event: object) -> None:
        if isinstance(event, RealizationFinished):
            print(event.realization, flush=True)

    return tell


def main(folder: str, *acts: str) -> None:
    """A runner in a process of its own, to be interrupted."""
    from bench.campaign import open_local_pool

    script = Script(dict(zip(acts[::2], acts[1::2], strict=True)))
    observers = [print_results()]
    ended = fly(
        Path(folder), small_campaign(points=6), script, 2, observers=observers, open_executor=open_local_pool
    )
    print(f"stopped: {ended.stopped}", flush=True)
