"""Scenes of the shipped campaigns, flown by an agent and measured in memory."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from bench.agents import load_manifest, open_agent
from bench.campaign import load_campaign, load_measurable_decomposition, measure_all, measures_of
from bench.contracts import Observation, SessionResult
from bench.realization import RealizationPlan, place, realize
from bench.recording import TapeBuilder
from bench.simspec import AgentSpec, SimSpec
from bench.simulation import SessionPlan, run_session

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


def fly(
    plan: RealizationPlan, agent: str, decomposition: str = DECOMPOSITION
) -> tuple[SimSpec, SessionResult, Sequence[Observation]]:
    """The placed SimSpec, how the session ended, and every observation of the decomposition."""
    spec = place(plan.simspec.model_copy(update={"agent": AgentSpec(manifest=agent)}))
    manifest, at = load_manifest(agent)
    tape = TapeBuilder(spec)
    with tempfile.TemporaryDirectory() as folder:
        end = run_session(SessionPlan(spec, manifest, at, open_agent, Path(folder), tape))
    measures = measures_of(load_measurable_decomposition(decomposition))
    return spec, end, measure_all(measures, tape.tape(), spec)
