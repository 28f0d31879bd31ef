"""A campaign of real sessions whose runner, workers and agents are killed at drawn moments until it is done."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import PIPE

import polars as pl
import pytest
from campaign_fakes import to_scores
from in_process_executor import open_in_process

from bench.campaign import (
    CampaignFolder,
    Collaborators,
    load_campaign,
    open_journal,
    read_result,
    run_campaign_sync,
    verify_folder,
)
from bench.campaign.execution._worker import descendants
from bench.contracts import Outcome, SessionResult

# Host seconds, against a hang alone: on a busy host a session takes a hundred times as long.
pytestmark = [pytest.mark.process, pytest.mark.timeout(1800)]


KINDS = ("runner", "worker", "agent")

# The cheapest session with a recording, measures and an agent of its own: nothing flies, for two simulated seconds. A busy
# host ends none of them.
_CAMPAIGN = """
format: rebar.campaign/1
name: chaos
description: Short sessions to be interrupted.
base:
  name: short
  world:
    area: {{corners: [{{east_m: -50, north_m: -50}}, {{east_m: 50, north_m: -50}}, {{east_m: 50, north_m: 50}}, {{east_m: -50, north_m: 50}}]}}
  vehicle: {{model: still}}
  mission: {{kind: search_and_report, altitude_m: 60.0, speed_mps: 12.0, time_limit_s: 2.0}}
  actors:
    - {{id: radar, asset: radar-vehicle, role: adversary, count: 1}}
    - {{id: people, asset: civilian, role: bystander, count: 3}}
  intelligence:
    - {{id: sighting, about: radar, priority: 1, uncertainty_m: 60.0, latency_s: 1.0}}
  budgets: {{reply_s: 3600.0, connect_s: 3600.0}}
decomposition: search-and-report
agents: [{{manifest: null-idle}}]
budgets: {{retry_s: 0.0, wall_s: 86400.0}}
design: {{seed: 18, replicates: {count}}}
"""


@dataclass(slots=True)
class Havoc:
    """What was killed, and how often the campaign was run until it was complete."""

    killed: Counter[str] = field(default_factory=Counter)
    runs: int = 0


def run_through_chaos(campaign: Path, folder: Path, seed: int, share: float) -> Havoc:
    """Run the campaign again and again until it is complete. After a `share` of the results, something is killed."""
    chance = random.Random(seed)
    havoc = Havoc()
    ended = False
    while not ended:
        havoc.runs += 1
        with subprocess.Popen(_command(campaign, folder), stdout=PIPE, stderr=PIPE, text=True) as runner:
            try:
                _disturb(runner, chance, share, havoc)
            finally:
                runner.kill()
            ended = runner.wait() == 0
    return havoc


def _disturb(runner: subprocess.Popen[str], chance: random.Random, share: float, havoc: Havoc) -> None:
    assert runner.stderr is not None
    # One worker in the life of a runner: two lost attempts at one realization are charged to an unconfined agent.
    kinds = [*KINDS]
    for _ in runner.stderr:  # a line for every result, and some others
        # Each kind is killed once in any case: where a busy host ends few sessions, a share of them may be none.
        if all(havoc.killed[kind] for kind in KINDS) and chance.random() >= share:
            continue
        with suppress(subprocess.TimeoutExpired):
            # From the moment in which a result comes in to the middle of the next session.
            runner.wait(chance.choice([0.0, chance.uniform(0.0, 0.4)]))
        # Those that were spared so far come first, so that a short campaign meets all three.
        fewest = min(havoc.killed[kind] for kind in kinds)
        kind = chance.choice([kind for kind in kinds if havoc.killed[kind] == fewest])
        while not (processes := _processes(runner.pid, kind)) and runner.poll() is None:
            time.sleep(0.01)  # between two sessions there may be none
        if _kill(processes, chance):
            havoc.killed[kind] += 1
            if kind == "worker":
                kinds.remove(kind)


def _processes(runner: int, kind: str) -> list[int]:
    """The processes of a kind that descend from a runner now; other ones, such as those that measure, are none."""
    if kind == "runner":
        return [runner]
    mark = {"worker": b"execution._worker", "agent": b"agent_adapters.null"}[kind]
    matches = []
    for process in descendants(runner):
        with suppress(OSError):
            if mark in Path(f"/proc/{process}/cmdline").read_bytes():
                matches.append(process)
    return matches


def _kill(processes: list[int], chance: random.Random) -> bool:
    if not processes:
        return False
    with suppress(ProcessLookupError):
        os.kill(chance.choice(processes), signal.SIGKILL)
        return True
    return False


def _command(campaign: Path, folder: Path) -> list[str]:
    options = ["--out", str(folder), "--workers", "2"]
    return [sys.executable, "-m", "bench.cli", "run", str(campaign), *options]


def results(folder: Path) -> dict[str, SessionResult]:
    paths = CampaignFolder(folder)
    with open_journal(paths.journal) as journal:
        names = [entry.id for entry in journal.entries()]
    found = {name: read_result(paths.run(name), name) for name in names}
    return {name: result for name, result in found.items() if result is not None}


def complete_attempts(folder: Path) -> list[str]:
    """The realization of each attempt that flew to the end, as often as there is one."""
    with open_journal(folder / "journal.sqlite") as journal:
        rows = journal._database.execute("SELECT realization FROM attempts WHERE outcome = 'time_limit'")
        return [realization for (realization,) in rows]


@pytest.mark.parametrize(
    ("sessions", "share", "seed"),
    [(6, 0.1, 1), pytest.param(60, 0.2, 2, marks=pytest.mark.slow)],
)
def test_a_campaign_in_chaos_ends_as_an_undisturbed_one(
    tmp_path: Path, sessions: int, share: float, seed: int
) -> None:
    """One result for each session, with the scores and the recording of an undisturbed run. A session whose agent was
    killed in flight is the agent's, as it is whoever kills it: it alone may differ.
    """
    campaign, calm, chaos = tmp_path / "chaos.yaml", tmp_path / "calm", tmp_path / "chaos"
    campaign.write_text(_CAMPAIGN.format(count=sessions))
    undisturbed = Collaborators(finish=to_scores, open_executor=open_in_process())
    run_campaign_sync(load_campaign(campaign), calm, collaborators=undisturbed)

    havoc = run_through_chaos(campaign, chaos, seed, share)

    assert havoc.killed["runner"] >= 1
    assert havoc.killed["worker"] >= 1
    expected, actual = results(calm), results(chaos)
    assert len(actual) == len(expected) == sessions
    crashed = {name for name, result in actual.items() if result.outcome is Outcome.AGENT_CRASHED}
    assert len(crashed) <= havoc.killed["agent"]
    for name in actual.keys() - crashed:
        assert actual[name].outcome is expected[name].outcome is Outcome.TIME_LIMIT
        assert actual[name].observations == expected[name].observations
        assert actual[name].recording_sha256 == expected[name].recording_sha256
    scores = [
        pl.read_parquet(folder / "scores.parquet").filter(~pl.col("realization").is_in(crashed))
        for folder in (calm, chaos)
    ]
    assert scores[0].height > 0
    assert scores[0].equals(scores[1])
    assert verify_folder(chaos) == []
    attempts = complete_attempts(chaos)
    # One missing here is a result that the runner had written and, killed, not noted: the next one took it up.
    assert len(attempts) == len(set(attempts)) <= sessions
