"""The standard benchmark, version 2: what docs/standard.md promises, read from the SimSpecs alone."""

from __future__ import annotations

from collections import Counter, defaultdict
from functools import cache
from itertools import pairwise
from pathlib import Path
from statistics import fmean

import pytest

from bench.campaign import load_campaign, question_sha256
from bench.difficulty import features_of, shipped_scale
from bench.realization import check_placement, place, realize
from bench.simspec import SimSpec
from decompositions import load_decomposition

ROOT = Path(__file__).parents[2]
CAMPAIGN = load_campaign(ROOT / "campaigns" / "standard_2.yaml")
PAGE = ROOT / "docs" / "standard.md"

FROZEN_QUESTION = "e2d4872531dce683f46cfe24d16a3dae816e7ed644ea31fd065bfaa49b776779"
FROZEN_DECOMPOSITION = "84ee1a9b972bcd7357b57202aae10a5ca4f7b67099a5358f652453cd1aeb3f46"
NEW_VERSION = (
    "rebar-standard-2 is frozen, and results on it are compared between laboratories. Keep its files as they are: put "
    "the change into a new version (rebar-standard-3, with its own campaign file, page and digests)"
)
STEPS = (32.0, 46.0, 52.0, 57.0, 67.0)
APPLICATIONS = ("search", "search", "missing", "escort")


def step_of(situation: str) -> str:
    """search-3a is of step 3."""
    return situation.split("-")[1][0]


@cache
def scenes() -> tuple[tuple[str, SimSpec], ...]:
    """The situation and the realized SimSpec of every scene."""
    plans = realize(CAMPAIGN.bases, CAMPAIGN.design, CAMPAIGN.agents[:1])
    return tuple((str(plan.levels["situation"]), place(plan.simspec)) for plan in plans)


@cache
def difficulties() -> dict[str, dict[str, list[float]]]:
    """The measured difficulty of every node under study in each scene, by step."""
    scale = shipped_scale(load_decomposition(CAMPAIGN.decomposition))
    assert scale is not None
    by_step: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for situation, simspec in scenes():
        features = features_of(simspec)
        for node in CAMPAIGN.study:
            by_step[step_of(situation)][node].append(scale.measure(node, features).difficulty)
    return by_step


def test_it_is_frozen() -> None:
    page = PAGE.read_text()
    decomposition = load_decomposition(CAMPAIGN.decomposition)
    assert question_sha256(CAMPAIGN) == FROZEN_QUESTION, NEW_VERSION
    assert decomposition.digest == FROZEN_DECOMPOSITION, NEW_VERSION
    assert FROZEN_QUESTION in page
    assert FROZEN_DECOMPOSITION in page


def test_it_has_twenty_situations_in_five_steps_of_three_scenes_each() -> None:
    counts = Counter(situation for situation, _ in scenes())
    assert set(counts.values()) == {3}
    for step in "12345":
        names = [situation.split("-")[0] for situation in counts if step_of(situation) == step]
        assert sorted(names) == sorted(APPLICATIONS)


@pytest.mark.parametrize("step", "12345")
def test_every_scene_has_the_measured_difficulty_of_its_step(step: str) -> None:
    for scene in zip(*difficulties()[step].values(), strict=True):
        assert abs(fmean(scene) - STEPS[int(step) - 1]) < 4.5


@pytest.mark.parametrize("node", CAMPAIGN.study)
def test_every_key_attribute_under_study_rises_from_first_to_last_step(node: str) -> None:
    scale = shipped_scale(load_decomposition(CAMPAIGN.decomposition))
    assert scale is not None
    assert node in scale.proved
    assert fmean(difficulties()["5"][node]) > fmean(difficulties()["1"][node])


@pytest.mark.parametrize(
    "feature", ["time", "haze", "wander", "hurry", "landing_standoff", "haste", "consent_wait", "walk"]
)
def test_every_cause_of_difficulty_rises_over_the_steps(feature: str) -> None:
    """Time is one of several: people, sight, navigation and the operator ask for more, too."""
    values: dict[str, list[float]] = defaultdict(list)
    for situation, simspec in scenes():
        values[step_of(situation)].append(features_of(simspec)[feature].value)
    means = [fmean(values[step]) for step in "12345"]
    rises = [second - first for first, second in pairwise(means)]
    assert means[4] > means[0]
    assert sum(rise > 0.0 for rise in rises) >= 3


def test_every_scene_has_a_place_for_everybody() -> None:
    for situation, simspec in scenes():
        assert check_placement(simspec) == [], situation
