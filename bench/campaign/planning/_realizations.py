"""A campaign's design put to use: its realizations, and how good it is. Brings the decomposition in where difficulty decides."""

from __future__ import annotations

from bench.realization import DesignQuality, Rating, RealizationPlan, realize

from .._document import Campaign


def realizations(campaign: Campaign) -> list[RealizationPlan]:
    """Every realization that a campaign asks for. Raises SetupError as `realize` does."""
    return realize(campaign.situation, campaign.design, campaign.agents, _rating(campaign))


def campaign_quality(campaign: Campaign) -> DesignQuality:
    """How good a campaign's design is, before anything is flown. Raises SetupError where it does not fit the base SimSpec."""
    from bench.reporting import measure_design

    from ..results._measures import load_asked

    return measure_design(campaign.situation, campaign.design, load_asked(campaign.decomposition), campaign.study)


def _rating(campaign: Campaign) -> Rating | None:
    if not campaign.design.rated:
        return None
    from bench.reporting import rating

    from ..results._measures import load_asked

    return rating(load_asked(campaign.decomposition), campaign.study)
