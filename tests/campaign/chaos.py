"""A campaign of short real sessions, and somebody who kills its runner, its workers and its agents at drawn moments."""

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

from bench.campaign.execution._worker import descendants

KINDS = ("runner", "worker", "agent")

# The cheapest session with a recording, measures and an agent of its own: nothing flies, for two simulated seconds.
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
decomposition: search-and-report
agents: [{{manifest: null-idle}}]
budgets: {{retry_s: 0.0}}
design: {{seed: 18, replicates: {count}}}
"""


def write_campaign(path: Path, count: int) -> None:
    """Write the campaign with `count` sessions."""
    path.write_text(_CAMPAIGN.format(count=count))


def run_to_its_end(campaign: Path, folder: Path) -> None:
    """Run the campaign undisturbed."""
    subprocess.run(_command(campaign, folder), check=True, capture_output=True)


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
