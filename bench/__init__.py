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

from typing import TYPE_CHECKING

from bench.lazy import declared_names, lazy_names

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

__all__ = sorted(declared_names(__name__))

__getattr__ = lazy_names(__name__)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
