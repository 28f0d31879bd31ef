"""The standard benchmark, version 1: what docs/standard-1.md promises, read from the SimSpecs alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest

from bench.campaign import load_campaign, question_sha256, situation_tensions
from bench.realization import RealizationPlan, check_placement, place, realize
from bench.scoring import Difficulty, difficulty_of
from bench.simspec import Seeds
from decompositions import Decomposition, load_decomposition

ROOT = Path(__file__).parents[2]
CAMPAIGN = load_campaign(ROOT / "campaigns" / "standard.yaml")
APPLICATIONS = ("search", "missing", "escort")

FROZEN_QUESTION = "777eefb7ad947fa554b60e0ba7e350d11c675651171d7398d5292f56df3b4eaf"
FROZEN_DECOMPOSITION = "84ee1a9b972bcd7357b57202aae10a5ca4f7b67099a5358f652453cd1aeb3f46"
NEW_VERSION = (
    "rebar-standard-1 is frozen, and results on it are compared between laboratories. Keep its files as they are: "
    "rebar-standard-2 follows it"
)


@cache
def decomposition() -> Decomposition:
    return load_decomposition(CAMPAIGN.decomposition)


@cache
def scenes() -> tuple[RealizationPlan, ...]:
    """The first scene of each situation."""
    plans = realize(CAMPAIGN.bases, CAMPAIGN.design, CAMPAIGN.agents[:1])
    return tuple(plan for plan in plans if plan.replicate == 1)


@cache
def difficulties() -> Mapping[str, Difficulty]:
    return {str(plan.levels["situation"]): difficulty_of(decomposition(), plan.simspec) for plan in scenes()}


def values_of(node: str) -> list[float]:
    """The difficulties of a node, one of each situation that exercises it."""
    return [value for difficulty in difficulties().values() if (value := difficulty.of(node)) is not None]


def test_it_has_twenty_situations_over_three_applications() -> None:
    assert CAMPAIGN.name == "rebar-standard-1"
    names = [situation.name for situation in CAMPAIGN.situations]
    assert len(names) == len(scenes()) == 20
    assert Counter(name.split("-")[0] for name in names) == {"search": 7, "missing": 7, "escort": 6}
    assert sorted(names) == sorted(path.stem for path in (ROOT / "campaigns" / "standard").glob("*.yaml"))
    for situation in CAMPAIGN.situations:
        assert situation.base is not None
        assert situation.base.name == situation.name
        # A paragraph: what is going on, for whom, and what happens in flight.
        assert situation.base.description.count(".") >= 3
    # A copy under another name would count one situation twice.
    same = {"name": "", "description": "", "seeds": Seeds()}
    assert len({plan.simspec.model_copy(update=same).model_dump_json() for plan in scenes()}) == 20


def test_it_is_frozen() -> None:
    """What is asked of an agent has the published digest, whoever flies; so has the decomposition."""
    page = (ROOT / "docs" / "standard-1.md").read_text()
    assert question_sha256(CAMPAIGN) == FROZEN_QUESTION, NEW_VERSION
    assert decomposition().digest == FROZEN_DECOMPOSITION, NEW_VERSION
    assert FROZEN_QUESTION in page
    assert FROZEN_DECOMPOSITION in page
    others = {"agents": CAMPAIGN.agents[:1], "description": "", "floor": None, "name": "of-somebody-else"}
    assert question_sha256(CAMPAIGN.model_copy(update=others)) == FROZEN_QUESTION


@pytest.mark.parametrize("part", ["situation", "design", "study"])
def test_a_changed_part_has_another_digest(part: str) -> None:
    first, *rest = CAMPAIGN.situations
    assert first.base is not None
    easier = first.base.model_copy(
        update={"mission": first.base.mission.model_copy(update={"altitude_m": 41.0})}
    )
    changes: dict[str, dict[str, object]] = {
        "situation": {"situations": (first.model_copy(update={"base": easier}), *rest)},
        "design": {"design": CAMPAIGN.design.model_copy(update={"seed": 2})},
        "study": {"study": CAMPAIGN.study[1:]},
    }
    assert question_sha256(CAMPAIGN.model_copy(update=changes[part])) != FROZEN_QUESTION


def test_every_scene_has_a_place_for_everybody() -> None:
    for plan in scenes():
        assert check_placement(place(plan.simspec)) == [], plan.levels["situation"]


def test_each_situation_has_the_tension_that_it_is_built_for() -> None:
    built = {situation.name: (situation.tension,) for situation in CAMPAIGN.situations}
    assert situation_tensions(CAMPAIGN) == built
    for application in APPLICATIONS:
        tensions = {value for name, (value,) in built.items() if name.startswith(application)}
        assert tensions == {1, 2, 3, 4, 5}


def test_key_attributes_take_several_difficulties_and_none_is_free() -> None:
    assert len(CAMPAIGN.study) == 8
    for node in CAMPAIGN.study:
        values = values_of(node)
        assert len(values) == 20
        assert min(values) < 20
        assert max(values) > 80
    graded = [node for node in decomposition().key_attributes if len(set(values_of(node))) >= 3]
    assert set(graded) == set(decomposition().key_attributes)
    # A rating of 0 would be competence that no agent can show.
    free = {node for node in decomposition().nodes if 0.0 in values_of(node)}
    assert free == set()
    assert [node for node in decomposition().observables if not values_of(node)] == []


def test_the_page_states_the_computed_difficulties() -> None:
    page = (ROOT / "docs" / "standard-1.md").read_text()
    words = " ".join(page.split())
    for node in decomposition().key_attributes:
        values = values_of(node)
        assert f"{node} {min(values):.0f} to {max(values):.0f}" in words
        assert (len(values) == 20) != (
            f"{node} {len(values)}," in words or f"{node} {len(values)}." in words
        ), node
