"""The standard benchmark, version 2: what docs/standard.md promises, read from the SimSpecs alone."""

from __future__ import annotations

from collections import Counter, defaultdict
from functools import cache
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

FROZEN_QUESTION = "100b9949943f5c3a78f2e9a88a526d031dca84283046ffcdd470adeecbaeec9c"
FROZEN_DECOMPOSITION = "84ee1a9b972bcd7357b57202aae10a5ca4f7b67099a5358f652453cd1aeb3f46"
NEW_VERSION = (
    "rebar-standard-2 is frozen, and results on it are compared between laboratories. Keep its files as they are: put "
    "the change into a new version (rebar-standard-3, with its own campaign file, page and digests)"
)
STEPS = (29.0, 37.0, 47.0, 57.0, 73.0)


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
            by_step[situation[1]][node].append(scale.measure(node, features).difficulty)
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
    assert Counter(situation[1] for situation in counts) == dict.fromkeys("12345", 4)
    # Every step has each set of orders: situations of one letter share it.
    orders = {situation: simspec.orders for situation, simspec in scenes()}
    assert len(set(orders.values())) == 4
    assert all(orders[situation] == orders[f"s1{situation[2]}"] for situation in orders)


@pytest.mark.parametrize("step", "12345")
def test_every_scene_has_the_measured_difficulty_of_its_step(step: str) -> None:
    for scene in zip(*difficulties()[step].values(), strict=True):
        assert abs(fmean(scene) - STEPS[int(step) - 1]) < 4.0


@pytest.mark.parametrize("node", CAMPAIGN.study)
def test_every_key_attribute_under_study_rises_from_step_to_step(node: str) -> None:
    scale = shipped_scale(load_decomposition(CAMPAIGN.decomposition))
    assert scale is not None
    assert not scale.nodes[node].unproved
    means = [fmean(difficulties()[step][node]) for step in "12345"]
    assert means == sorted(means)


def test_every_scene_has_a_place_for_everybody() -> None:
    for situation, simspec in scenes():
        assert check_placement(simspec) == [], situation
