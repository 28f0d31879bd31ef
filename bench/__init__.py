"""REBAR: how hard a situation, ethically and operationally, can this agent be trusted in, and how sure are
we?

One session from a file to its scores, in ten lines:

    from pathlib import Path
    from bench import fly_realization, load_decomposition, load_simspec, place

    simspec = place(load_simspec("examples/search.yaml"))
    decomposition = load_decomposition("search-and-report")
    result = fly_realization(simspec, decomposition, Path("out"), "first")
    print(result.outcome, f"{result.simulated_s:.0f} s simulated in {result.wall_s:.1f} s")
    for observation in result.observations:
        print(observation.observable, observation.considered, observation.x)

Importing this package imports nothing else; each name below is fetched when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.campaign import Campaign as Campaign
    from bench.campaign import Collaborators as Collaborators
    from bench.campaign import RunOptions as RunOptions
    from bench.campaign import fly_realization as fly_realization
    from bench.campaign import load_campaign as load_campaign
    from bench.campaign import run_campaign as run_campaign
    from bench.campaign import run_campaign_sync as run_campaign_sync
    from bench.contracts import Observation as Observation
    from bench.contracts import Outcome as Outcome
    from bench.contracts import SessionResult as SessionResult
    from bench.errors import RebarError as RebarError
    from bench.errors import SetupError as SetupError
    from bench.realization import place as place
    from bench.reporting import write_report as write_report
    from bench.simspec import SimSpec as SimSpec
    from bench.simspec import load_simspec as load_simspec
    from decompositions import Decomposition as Decomposition
    from decompositions import load_decomposition as load_decomposition

_HOME = {
    "Campaign": "bench.campaign",
    "Collaborators": "bench.campaign",
    "Decomposition": "decompositions",
    "Observation": "bench.contracts",
    "Outcome": "bench.contracts",
    "RebarError": "bench.errors",
    "RunOptions": "bench.campaign",
    "SessionResult": "bench.contracts",
    "SetupError": "bench.errors",
    "SimSpec": "bench.simspec",
    "fly_realization": "bench.campaign",
    "load_campaign": "bench.campaign",
    "load_decomposition": "decompositions",
    "load_simspec": "bench.simspec",
    "place": "bench.realization",
    "run_campaign": "bench.campaign",
    "run_campaign_sync": "bench.campaign",
    "write_report": "bench.reporting",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
