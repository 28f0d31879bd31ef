"""`rebar run --dry-run`: what would be flown, and what surrogates expect of it."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import Fault, SetupError

from ._run_request import RunRequest
from ._tables import print_lines

if TYPE_CHECKING:
    from bench.campaign import Campaign, CampaignEstimate
    from bench.realization import DesignQuality, RealizationPlan


def print_plan(path: Path, request: RunRequest) -> None:
    """Print it. Raises SetupError with everything that would keep the sessions from flying."""
    from bench.campaign import campaign_quality, load_measurable_decomposition, realizations

    campaign = request.changes.load(path)
    # Only for its faults: they come before anything is printed.
    load_measurable_decomposition(campaign.decomposition)
    if wrong := faults_before_takeoff(campaign):
        raise SetupError(wrong)
    plans = realizations(campaign)
    quality = campaign_quality(campaign)
    if request.as_json:
        _print_json(campaign, plans, quality, request)
    else:
        _print_lines(campaign, plans, quality, request)


def faults_before_takeoff(campaign: Campaign) -> list[Fault]:
    """What would keep the campaign's sessions from flying, or its design from being realized."""
    from bench.campaign import realizations, takeoff_faults

    # Surrogates fly without the agents' programs, and say for themselves what they cannot fly.
    if campaign.fidelity == "overhead":
        return []
    try:
        return takeoff_faults(plan.simspec for plan in realizations(campaign))
    except SetupError as error:
        return list(error.faults)


def _print_json(
    campaign: Campaign, plans: Sequence[RealizationPlan], quality: DesignQuality, request: RunRequest
) -> None:
    from bench.campaign import situation_difficulties, situation_tensions

    estimate, faults = _estimate(campaign, request)
    document: dict[str, object] = {
        "campaign": campaign.name,
        "realizations": len(plans),
        "most_simulated_s": sum(plan.simspec.mission.time_limit_s for plan in plans),
        "design": quality.model_dump(mode="json"),
    }
    if campaign.situations:
        document["tensions"] = situation_tensions(campaign)
        document["measured"] = situation_difficulties(campaign)
    document["estimate"] = estimate and estimate.model_dump(mode="json")
    if estimate is None:
        document["no_estimate"] = faults
    print(json.dumps(document, indent=1))


def _print_lines(
    campaign: Campaign, plans: Sequence[RealizationPlan], quality: DesignQuality, request: RunRequest
) -> None:
    points = {plan.design_point for plan in plans}
    print_lines(
        f"{campaign.name}: {len(plans)} realizations of {len(points)} design points, {len(campaign.agents)} agent(s)"
    )
    if campaign.floor is not None:
        beside = sum(plan.agent in campaign.floor_labels for plan in plans)
        print(f"{beside} of them by null agents and the oracle, for the floor")
    # Each realization has its own limit: situations, and factors, may differ in it.
    limits_s = [plan.simspec.mission.time_limit_s for plan in plans]
    least, most = f"{min(limits_s):g}", f"{max(limits_s):g}"
    each = least if least == most else f"{least} to {most}"
    print(f"at most {sum(limits_s) / 3600:.1f} simulated hours ({each} s each)")
    print_lines(*quality.lines(), *_tension_lines(campaign))
    estimate, faults = _estimate(campaign, request)
    print_lines(*(estimate.lines() if estimate else (f"no estimate: {fault}" for fault in faults)))


def _tension_lines(campaign: Campaign) -> list[str]:
    from bench.campaign import situation_difficulties, situation_tensions

    built_for = {situation.name: situation.tension for situation in campaign.situations}
    measured = situation_difficulties(campaign)
    lines = []
    for name, tensions in situation_tensions(campaign).items():
        reached = " to ".join(map(str, dict.fromkeys((min(tensions), max(tensions))))) if tensions else "none"
        built = f", built for {built_for[name]}" if built_for[name] else ""
        found = f"; measured difficulty {measured[name]:.0f}" if name in measured else ""
        lines.append(f"situation {name}: tension {reached}{built}{found}")
    return lines


def _estimate(campaign: Campaign, request: RunRequest) -> tuple[CampaignEstimate | None, list[str]]:
    """What surrogates expect of a campaign, or the faults for which they cannot fly it."""
    from bench.campaign import estimate_campaign

    count = request.workers or campaign.budgets.workers or len(os.sched_getaffinity(0))
    try:
        return estimate_campaign(campaign, count, request.session_s), []
    except SetupError as error:
        return None, [str(fault) for fault in error.faults]
