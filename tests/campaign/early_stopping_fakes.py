"""Fake sessions that pass or fail at random, for campaigns that stop design points early."""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.contracts import Observation, Outcome, SessionResult

# Every worker imports this module for its job: the functions of the runner's side import what they alone use.
if TYPE_CHECKING:
    from bench.campaign import Campaign, CampaignSummary
    from decompositions import Decomposition

JOB = "early_stopping_fakes:drawn_flight"
PASSED = {"p001": 0.95, "p002": 0.05, "p003": 0.5}
"""Pass rate of the agent `fake` at each design point.

For any other agent passing and failing are exchanged.
"""


def drawn(realization: str) -> float:
    """A number in [0, 1) that depends on the name alone."""
    return int.from_bytes(hashlib.sha256(realization.encode()).digest()[:6], "big") / 2**48


def passes(realization: str) -> bool:
    """Whether the realization passes."""
    rate = PASSED[realization[:4]]
    return drawn(realization) < (rate if realization.endswith("-fake") else 1.0 - rate)


def drawn_flight(simspec: Any, decomposition: Decomposition, folder: Path, realization: str) -> SessionResult:
    """Odd replicates take longer, so that two workers end sessions in another order than they are begun."""
    del simspec
    time.sleep(0.004 if int(realization.split("-")[1][1:]) % 2 else 0.0)
    (folder / "recording.mcap").write_bytes(f"all of {realization}".encode())
    x = 1.0 if passes(realization) else 0.0
    considered = "-r2-" not in realization
    observations = [
        Observation(observable=name, considered=considered, x=x if considered else None)
        for name in sorted(decomposition.observables)
    ]
    return SessionResult(
        realization=realization, outcome=Outcome.COMPLETED, simulated_s=1.0, observations=tuple(observations)
    )


def made_up_decomposition(folder: Path) -> Path:
    """A decomposition of two observables under one key attribute, written into a folder."""
    fog = {
        "factor": "fog_level",
        "unit": "level",
        "values": [0, 9],
        "ratings": [0, 100],
        "reason": "Made up.",
    }
    leaf = {
        "measure": "targets_reported",
        "options": {"within_m": 20.0},
        "threshold": 0.5,
        "threshold_reason": "Made up.",
        "considered": "Made up.",
        "key_factors": [fog],
    }

    def inner(name: str, *children: str) -> dict[str, Any]:
        return {"id": name, "title": name, "asks": "Made up.", "children": list(children)}

    document = {
        "format": "rebar.decomposition/1",
        "name": "made-up",
        "title": "Made up",
        "principles": [inner("P", "KA-01")],
        "key_attributes": [inner("KA-01", "VAB-001")],
        "vabs": [inner("VAB-001", "OBS-001", "OBS-002")],
        "observables": [
            {"id": name, "title": name, "asks": "Made up.", **leaf} for name in ("OBS-001", "OBS-002")
        ],
    }
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "asked.json"
    path.write_text(json.dumps(document))
    return path


def stopping_campaign(
    decomposition: Path, replicates: int = 20, points: int = 3, **stopping: Any
) -> Campaign:
    """A campaign that stops design points once KA-01 is decided at one half.

    `stopping` replaces fields of the rule.
    """
    from campaign_fakes import small_campaign

    from bench.campaign import CampaignAgent, Stopping

    rule = Stopping(**({"node": "KA-01", "threshold": 0.5} | stopping))
    update = {
        "decomposition": str(decomposition),
        "stopping": rule,
        "agents": (CampaignAgent(manifest="fake"),),
    }
    return small_campaign(points, replicates).model_copy(update=update)


def fly_drawn(folder: Path, campaign: Campaign, workers: int = 1, **collaborators: Any) -> CampaignSummary:
    """Run such a campaign, by default without its scores and in this process: a worker takes a second to start."""
    from in_process_executor import open_in_process

    from bench.campaign import Collaborators, Jobs, RunOptions, run_campaign_sync

    collaborators.setdefault("open_executor", open_in_process())
    return run_campaign_sync(
        campaign, folder, RunOptions(workers=workers), Collaborators(jobs=Jobs(JOB), **collaborators)
    )


def main(folder: str, decomposition: str) -> None:
    """A runner in a process of its own, to be interrupted."""
    from campaign_fakes import print_results

    from bench.campaign import open_local_pool

    campaign = stopping_campaign(Path(decomposition), 14, 2)
    fly_drawn(Path(folder), campaign, 2, observers=[print_results()], open_executor=open_local_pool)
