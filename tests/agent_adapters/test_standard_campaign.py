"""The standard benchmark: what docs/standard-1.md and docs/standard.md promise of its versions, read from the SimSpecs alone."""

from __future__ import annotations

from collections import Counter, defaultdict
from functools import cache
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from bench.campaign import load_campaign, question_sha256, situation_tensions
from bench.difficulty import features_of, shipped_scale
from bench.realization import RealizationPlan, check_placement, place, realize
from bench.scoring import Difficulty, difficulty_of
from bench.simspec import Seeds, SimSpec
from decompositions import load_decomposition

ROOT = Path(__file__).parents[2]
CAMPAIGNS = {name: load_campaign(ROOT / "campaigns" / f"{name}.yaml") for name in ("standard", "standard_2")}
FIRST, SECOND = CAMPAIGNS.values()
FIRST_PAGE = ROOT / "docs" / "standard-1.md"
DECOMPOSITION = load_decomposition(FIRST.decomposition)

FROZEN_DECOMPOSITION = "84ee1a9b972bcd7357b57202aae10a5ca4f7b67099a5358f652453cd1aeb3f46"
FROZEN_QUESTIONS = {
    "standard": "777eefb7ad947fa554b60e0ba7e350d11c675651171d7398d5292f56df3b4eaf",
    "standard_2": "e2d4872531dce683f46cfe24d16a3dae816e7ed644ea31fd065bfaa49b776779",
}
NEW_VERSION = (
    "rebar-standard-1 and rebar-standard-2 are frozen, and results on them are compared between laboratories. Keep their "
    "files as they are: put the change into a new version (rebar-standard-3, with its own campaign file, page and digests)"
)
STEPS = (32.0, 46.0, 52.0, 57.0, 67.0)


@cache
def plans(name: str) -> tuple[RealizationPlan, ...]:
    """Every scene, once. Of the first version, the first scene of each situation."""
    campaign = CAMPAIGNS[name]
    every = realize(campaign.bases, campaign.design, campaign.agents[:1])
    return tuple(plan for plan in every if plan.replicate == 1 or name == "standard_2")


@cache
def placed(name: str) -> tuple[SimSpec, ...]:
    """The same scenes, placed."""
    return tuple(place(plan.simspec) for plan in plans(name))


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_it_is_frozen(name: str) -> None:
    """What is asked of an agent has the published digest, whoever flies; so has the decomposition."""
    campaign, page = (
        CAMPAIGNS[name],
        {"standard": FIRST_PAGE, "standard_2": ROOT / "docs" / "standard.md"}[name],
    )
    assert question_sha256(campaign) == FROZEN_QUESTIONS[name], NEW_VERSION
    assert load_decomposition(campaign.decomposition).digest == FROZEN_DECOMPOSITION, NEW_VERSION
    assert FROZEN_QUESTIONS[name] in page.read_text()
    assert FROZEN_DECOMPOSITION in page.read_text()
    others = {"agents": campaign.agents[:1], "description": "", "floor": None, "name": "of-somebody-else"}
    assert question_sha256(campaign.model_copy(update=others)) == FROZEN_QUESTIONS[name]


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_every_scene_has_a_place_for_everybody(name: str) -> None:
    for scene in placed(name):
        assert check_placement(scene) == [], scene.name


def test_it_has_twenty_situations_over_three_applications() -> None:
    assert FIRST.name == "rebar-standard-1"
    names = [situation.name for situation in FIRST.situations]
    assert len(names) == len(plans("standard")) == 20
    assert Counter(name.split("-")[0] for name in names) == {"search": 7, "missing": 7, "escort": 6}
    assert sorted(names) == sorted(path.stem for path in (ROOT / "campaigns" / "standard").glob("*.yaml"))
    for situation in FIRST.situations:
        assert situation.base is not None
        assert situation.base.name == situation.name
        # A paragraph: what is going on, for whom, and what happens in flight.
        assert situation.base.description.count(".") >= 3
    # A copy under another name would count one situation twice.
    same = {"name": "", "description": "", "seeds": Seeds()}
    assert len({plan.simspec.model_copy(update=same).model_dump_json() for plan in plans("standard")}) == 20


@pytest.mark.parametrize("part", ["situation", "design", "study"])
def test_a_changed_part_has_another_digest(part: str) -> None:
    first, *rest = FIRST.situations
    assert first.base is not None
    easier = first.base.model_copy(
        update={"mission": first.base.mission.model_copy(update={"altitude_m": 41.0})}
    )
    changes: dict[str, dict[str, object]] = {
        "situation": {"situations": (first.model_copy(update={"base": easier}), *rest)},
        "design": {"design": FIRST.design.model_copy(update={"seed": 2})},
        "study": {"study": FIRST.study[1:]},
    }
    assert question_sha256(FIRST.model_copy(update=changes[part])) != FROZEN_QUESTIONS["standard"]


@cache
def values_of(node: str) -> list[float]:
    """The difficulties of a node, one of each situation that exercises it."""
    rated = [difficulty.of(node) for difficulty in difficulties()]
    return [value for value in rated if value is not None]


@cache
def difficulties() -> list[Difficulty]:
    return [difficulty_of(DECOMPOSITION, plan.simspec) for plan in plans("standard")]


def test_each_situation_has_the_tension_that_it_is_built_for() -> None:
    built = {situation.name: (situation.tension,) for situation in FIRST.situations}
    assert situation_tensions(FIRST) == built
    for application in ("search", "missing", "escort"):
        tensions = {value for name, (value,) in built.items() if name.startswith(application)}
        assert tensions == {1, 2, 3, 4, 5}


def test_key_attributes_take_several_difficulties_and_none_is_free() -> None:
    assert len(FIRST.study) == 8
    for node in FIRST.study:
        values = values_of(node)
        assert len(values) == 20
        assert min(values) < 20
        assert max(values) > 80
    graded = [node for node in DECOMPOSITION.key_attributes if len(set(values_of(node))) >= 3]
    assert set(graded) == set(DECOMPOSITION.key_attributes)
    # A rating of 0 would be competence that no agent can show.
    free = {node for node in DECOMPOSITION.nodes if 0.0 in values_of(node)}
    assert free == set()
    assert [node for node in DECOMPOSITION.observables if not values_of(node)] == []


def test_the_page_states_the_computed_difficulties() -> None:
    words = " ".join(FIRST_PAGE.read_text().split())
    for node in DECOMPOSITION.key_attributes:
        values = values_of(node)
        assert f"{node} {min(values):.0f} to {max(values):.0f}" in words
        is_counted = any(f"{node} {len(values)}{sign}" in words for sign in ",.")
        assert is_counted is (len(values) != 20), node


def step_of(situation: str) -> str:
    """search-3a is of step 3."""
    return situation.split("-")[1][0]


@cache
def features_by_step() -> dict[str, list[Any]]:
    """Of every scene of the second version."""
    by_step = defaultdict(list)
    for plan, scene in zip(plans("standard_2"), placed("standard_2"), strict=True):
        by_step[step_of(str(plan.levels["situation"]))].append(features_of(scene))
    return by_step


@cache
def measured(step: str, node: str) -> list[float]:
    """The measured difficulty of a node in each scene of a step."""
    scale = shipped_scale(DECOMPOSITION)
    assert scale is not None
    return [scale.measure(node, features).difficulty for features in features_by_step()[step]]


def test_it_has_twenty_situations_in_five_steps_of_three_scenes_each() -> None:
    counts = Counter(str(plan.levels["situation"]) for plan in plans("standard_2"))
    assert set(counts.values()) == {3}
    for step in "12345":
        names = [situation.split("-")[0] for situation in counts if step_of(situation) == step]
        assert sorted(names) == ["escort", "missing", "search", "search"]


@pytest.mark.parametrize("step", "12345")
def test_every_scene_has_the_measured_difficulty_of_its_step(step: str) -> None:
    for scene in zip(*(measured(step, node) for node in SECOND.study), strict=True):
        assert abs(fmean(scene) - STEPS[int(step) - 1]) < 4.5


@pytest.mark.parametrize("node", SECOND.study)
def test_every_key_attribute_under_study_rises_from_first_to_last_step(node: str) -> None:
    scale = shipped_scale(DECOMPOSITION)
    assert scale is not None
    assert node in scale.proved
    assert fmean(measured("5", node)) > fmean(measured("1", node))


@pytest.mark.parametrize(
    "feature", ["time", "haze", "wander", "hurry", "landing_standoff", "haste", "consent_wait", "walk"]
)
def test_every_cause_of_difficulty_rises_over_the_steps(feature: str) -> None:
    """Time is one of several: people, sight, navigation and the operator ask for more, too."""
    means = [fmean(features[feature].value for features in features_by_step()[step]) for step in "12345"]
    assert means[4] > means[0]
    assert sum(second > first for first, second in pairwise(means)) >= 3
