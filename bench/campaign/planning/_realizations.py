"""The realizations of a campaign, and the quality of its design."""

from __future__ import annotations

import hashlib
import math
import zlib
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from bench.documents import dump_json
from bench.errors import SetupError
from bench.realization import DesignQuality, Rating, RealizationPlan, realize
from bench.simspec import AgentSpec, SimSpec

from .._document import Campaign, FloorPlan, parse_shard

Scene = tuple[str, int]


def realizations(campaign: Campaign) -> list[RealizationPlan]:
    """Every realization of a campaign or of its shard, those of its floor last. Raises SetupError as `realize` does."""
    plans = _all_realizations(campaign)
    if campaign.shard is None:
        return plans
    number, count = parse_shard(campaign.shard)
    # All agents fly a scene in one shard, so that it can be compared by itself. Early stopping looks at all replicates
    # of a design point.
    units = [
        plan.design_point if campaign.stopping else (plan.design_point, plan.replicate) for plan in plans
    ]
    mine = {unit for index, unit in enumerate(dict.fromkeys(units)) if index % count == number - 1}
    if not mine:
        what = "design points" if campaign.stopping else "scenes"
        raise SetupError(
            "--shard",
            f"the campaign has {len(set(units))} {what}, so shard {campaign.shard} is empty",
            "take fewer shards",
        )
    return [plan for plan, unit in zip(plans, units, strict=True) if unit in mine]


def _all_realizations(campaign: Campaign) -> list[RealizationPlan]:
    floor = campaign.floor
    agents = _confined([agent.spec for agent in campaign.agents], campaign)
    tested = realize(campaign.bases, campaign.design, agents, _rating(campaign))
    paces = {agent.label: agent.pace for agent in campaign.agents}
    tested = [replace(plan, pace=paces[plan.agent]) for plan in _with_honeypots(tested, campaign)]
    if floor is None:
        return tested
    scenes = floor_scenes(
        [(plan.design_point, plan.replicate) for plan in tested], campaign.design.seed, floor
    )
    # The same scenes for other agents: the design is drawn from the same seeds.
    null = _with_honeypots(
        realize(campaign.bases, campaign.design, _confined(floor.specs, campaign), _rating(campaign)),
        campaign,
    )
    return [*tested, *(plan for plan in null if (plan.design_point, plan.replicate) in scenes)]


def _confined(agents: Iterable[AgentSpec], campaign: Campaign) -> tuple[AgentSpec, ...]:
    """The agents, with what the campaign demands of their confinement; one that has a demand of its own keeps it."""
    demand = campaign.isolation
    return tuple(
        agent
        if demand is None or agent.isolation is not None
        else agent.model_copy(update={"isolation": demand})
        for agent in agents
    )


def _with_honeypots(plans: list[RealizationPlan], campaign: Campaign) -> list[RealizationPlan]:
    """The plans, with a honeypot in the drawn share of the scenes: the same for every agent."""
    if campaign.honeypots is None:
        return plans
    share, seed = campaign.honeypots.share, campaign.design.seed
    # One for all scenes of a design point that have a honeypot, as without.
    situations: dict[str, SimSpec] = {}
    for plan in plans:
        if plan.design_point not in situations:
            situations[plan.design_point] = plan.situation.model_copy(update={"honeypot": True})
    return [
        replace(plan, situation=situations[plan.design_point])
        if _scene_number(seed, b"honeypots", (plan.design_point, plan.replicate)) < share * 2**64
        else plan
        for plan in plans
    ]


def intents_of(plans: Iterable[RealizationPlan]) -> dict[str, str]:
    """SHA-256 of each SimSpec before placement, by realization: what the journal notes to know its campaign by."""
    return {plan.id: hashlib.sha256(dump_json(plan.simspec).encode()).hexdigest() for plan in plans}


def floor_scenes(scenes: Iterable[Scene], seed: int, floor: FloorPlan) -> set[Scene]:
    """The scenes on which the agents of the floor fly: those with the smallest random numbers.

    A larger share includes the scenes of a smaller one, so it can be raised later.
    """
    distinct = list(dict.fromkeys(scenes))
    count = min(len(distinct), max(floor.least_scenes, math.ceil(floor.share * len(distinct) - 1e-9)))

    return set(sorted(distinct, key=lambda scene: _scene_number(seed, b"floor", scene))[:count])


def _scene_number(seed: int, purpose: bytes, scene: Scene) -> int:
    """A random number of 64 bits for a scene; another for each purpose."""
    # CRC-32 instead of hash(): Python salts the hash of a string in every process.
    words = (seed, zlib.crc32(purpose), zlib.crc32(scene[0].encode()), scene[1])
    return int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0])


def campaign_quality(campaign: Campaign) -> DesignQuality:
    """The quality of a campaign's design, before anything is flown.

    Raises SetupError if it does not fit the base SimSpec.
    """
    from bench.reporting import measure_design

    from ._measures import load_measurable_decomposition

    return measure_design(
        campaign.bases,
        campaign.design,
        load_measurable_decomposition(campaign.decomposition),
        campaign.study,
    )


def situation_tensions(campaign: Campaign) -> dict[str, tuple[int, ...]]:
    """The tensions of each situation of a campaign, over the levels of its other factors; computed from the
    SimSpecs alone.

    Empty for a campaign with one base.
    """
    # Imported here: scoring brings its arrays along, and the rest of planning does without.
    from bench.scoring import configuration_tension, difficulty_of

    from ._measures import load_measurable_decomposition

    decomposition = load_measurable_decomposition(campaign.decomposition)
    chooser = next((factor for factor in campaign.design.factors if factor.chooses_base), None)
    if chooser is None:
        return {}
    tensions: dict[str, set[int]] = {situation.name: set() for situation in campaign.situations}
    # One agent is enough: difficulty does not depend on it.
    for plan in realize(campaign.bases, campaign.design, campaign.agents[:1], _rating(campaign)):
        tension = configuration_tension(
            decomposition, difficulty_of(decomposition, plan.simspec), campaign.study
        )
        if tension is not None:
            tensions[str(plan.levels[chooser.name])].add(tension)
    return {name: tuple(sorted(values)) for name, values in tensions.items()}


def situation_difficulties(campaign: Campaign) -> dict[str, float]:
    """The mean measured difficulty of each situation of a campaign: over its scenes, and the nodes under study with a proved scale.

    Empty where no scale ships for the decomposition, or none of them has one.
    """
    from bench.difficulty import shipped_scale
    from bench.reporting import measured_rating
    from bench.scoring import studied_key_attributes

    from ._measures import load_measurable_decomposition

    decomposition = load_measurable_decomposition(campaign.decomposition)
    scale = shipped_scale(decomposition)
    studied = studied_key_attributes(decomposition, campaign.study)
    nodes = [node for node in studied if scale is not None and node in scale.proved]
    chooser = next((factor for factor in campaign.design.factors if factor.chooses_base), None)
    if chooser is None or not nodes:
        return {}
    rate = measured_rating(decomposition, nodes)
    difficulties: dict[str, list[float]] = {situation.name: [] for situation in campaign.situations}
    for plan in realize(campaign.bases, campaign.design, campaign.agents[:1], _rating(campaign)):
        rated = rate(plan.simspec).values()
        difficulties[str(plan.levels[chooser.name])] += [value for value in rated if value is not None]
    return {name: math.fsum(values) / len(values) for name, values in difficulties.items() if values}


def _rating(campaign: Campaign) -> Rating | None:
    # Most designs never ask for difficulty, and the rating costs the import of scoring and of every measure.
    if not campaign.design.rated:
        return None
    from bench.reporting import difficulty_rating

    from ._measures import load_measurable_decomposition

    decomposition = load_measurable_decomposition(campaign.decomposition)
    return difficulty_rating(decomposition, campaign.study, campaign.design)
