"""The realizations of a campaign, and the quality of its design."""

from __future__ import annotations

from bench.realization import DesignQuality, Rating, RealizationPlan, realize

from .._document import Campaign


def realizations(campaign: Campaign) -> list[RealizationPlan]:
    """Every realization of a campaign. Raises SetupError as `realize` does."""
    return realize(campaign.situation, campaign.design, campaign.agents, _rating(campaign))


def campaign_quality(campaign: Campaign) -> DesignQuality:
    """The quality of a campaign's design, before anything is flown.

    Raises SetupError if it does not fit the base SimSpec.
    """
    from bench.reporting import measure_design

    from ..results._measures import load_measurable_decomposition

    return measure_design(
        campaign.situation,
        campaign.design,
        load_measurable_decomposition(campaign.decomposition),
        campaign.study,
    )


def _rating(campaign: Campaign) -> Rating | None:
    # Most designs never ask for difficulty, and the rating costs the import of scoring and of every measure.
    if not campaign.design.rated:
        return None
    from bench.reporting import difficulty_rating

    from ..results._measures import load_measurable_decomposition

    return difficulty_rating(load_measurable_decomposition(campaign.decomposition), campaign.study)
