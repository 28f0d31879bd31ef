"""Scenes, of the shipped campaigns and small ones, flown by an agent and measured in memory."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from bench.agents import load_manifest, open_agent
from bench.campaign import load_campaign, load_measurable_decomposition, measure_all, measures_of
from bench.contracts import Observation, Record, SessionResult, Tape
from bench.realization import RealizationPlan, place, realize
from bench.recording import TapeBuilder
from bench.simspec import AgentSpec, SimSpec
from bench.simulation import HostClock, SessionPlan, run_session

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
DECOMPOSITION = "search-and-report-full"


@cache
def _plans(campaign: str) -> tuple[RealizationPlan, ...]:
    loaded = load_campaign(CAMPAIGNS / f"{campaign}.yaml")
    return tuple(realize(loaded.bases, loaded.design, loaded.agents[:1]))


def scenes(campaign: str) -> list[str]:
    """The design points of a shipped campaign."""
    return [plan.design_point for plan in _plans(campaign) if plan.replicate == 1]


def scene(campaign: str, name: str, replicate: int = 1) -> RealizationPlan:
    """One scene of a shipped campaign, by its design point or its situation."""
    return next(
        plan
        for plan in _plans(campaign)
        if name in (plan.design_point, plan.levels.get("situation")) and plan.replicate == replicate
    )


def small_scene(
    agent: str | dict[str, Any],
    *actors: tuple[str, str, float, float] | tuple[str, str, float, float, float],
    area: tuple[float, float, float, float] = (-60.0, -60.0, 60.0, 60.0),
    **document: Any,
) -> SimSpec:
    """Actors (id, asset, east and north in metres, heading) in an area (west, south, east, north), and a vehicle.

    Civilians are bystanders, all others adversaries.
    """
    west, south, east, north = area
    corners = ((west, south), (east, south), (east, north), (west, north))
    groups = [
        {
            "id": name,
            "asset": asset,
            "role": "bystander" if asset == "civilian" else "adversary",
            "count": 1,
            "placement": {"at": {"east_m": e, "north_m": n, "heading_deg": turned[0] if turned else 30.0}},
        }
        for name, asset, e, n, *turned in actors
    ]
    scene = {
        "name": "scene",
        "world": {"area": {"corners": [{"east_m": e, "north_m": n} for e, n in corners]}},
        "vehicle": {"home": {"east_m": 0.0, "north_m": 0.0, "heading_deg": 90.0}},
        "actors": groups,
        "agent": {"manifest": agent} if isinstance(agent, str) else agent,
    }
    return SimSpec.model_validate(scene | document)


def run_scene(spec: SimSpec, tap: Callable[[Record], None], clock: HostClock | None = None) -> SessionResult:
    """How a session with the agent of a placed SimSpec ended."""
    manifest, at = load_manifest(spec.agent.manifest)
    with tempfile.TemporaryDirectory() as folder:
        plan = SessionPlan(spec, manifest, at, open_agent, Path(folder), tap, clock=clock or HostClock())
        return run_session(plan)


def taped(spec: SimSpec) -> tuple[SessionResult, Tape]:
    """The same, and what was recorded."""
    builder = TapeBuilder(spec)
    return run_scene(spec, builder), builder.tape()


def fly(
    plan: RealizationPlan, agent: str, decomposition: str = DECOMPOSITION
) -> tuple[SimSpec, SessionResult, Sequence[Observation]]:
    """The placed SimSpec, how the session ended, and every observation of the decomposition."""
    spec = place(plan.simspec.model_copy(update={"agent": AgentSpec(manifest=agent)}))
    end, tape = taped(spec)
    return spec, end, measure_all(measures_of(load_measurable_decomposition(decomposition)), tape, spec)
