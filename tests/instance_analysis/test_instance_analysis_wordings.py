"""Everyday wordings of places, distances, weather and orders, and near misses that stay unread."""

from __future__ import annotations

from typing import Any

import pytest

from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose
from bench.simspec import ASSETS

VOCABULARY = load_vocabulary()


def values(result: BaseSimSpec) -> dict[str, Any]:
    return {receipt.path: receipt.value for receipt in result.receipts if receipt.source == "prose"}


def listed(result: BaseSimSpec) -> str:
    """What is listed or left open, as one text."""
    unread = [passage.quote for passage in (*result.not_understood, *result.not_expressible)]
    return " | ".join([*unread, *(choice.quote for choice in result.choices)])


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("Two tents, a police officer, an ambulance, three cows and a school bus.", {"tent.count": 2, "police-officer.role": "bystander", "ambulance.asset": "ambulance", "cow.count": 3, "bus.count": 1}),
        ("A truck concealed by 40 %. A radar hidden by one third.", {"truck.concealment": 0.4, "radar.concealment": 0.333}),
        ("A truck with half its body covered.", {"truck.concealment": 0.5}),
        ("Three houses, the distance between the houses is more than 25 m.", {"house.placement.spread_m": 25}),
        ("Four trucks, spacing min 20 m.", {"truck.placement.spread_m": 20}),
        ("A truck shall be parked beside the road, no more than 12 m off.", {"truck.placement.along.within_m": 12}),
        ("Nine houses along the access road, from three to ten metres off the tarmac.", {"house.placement.along.at_least_m": 3, "house.placement.along.within_m": 10}),
        ("A house. Six adults, keeping clear of the house by 30 m or more.", {"civilian.placement.distances[0].min_m": 30}),
        ("Ten houses. A radar lies 30 m to 50 m from at least one house.", {"radar.placement.near.of": "house", "house.count": 10}),
        ("A radar 120 m north of us.", {"radar.placement.near.of": "home"}),
        ("Three crates 5 m beside the helipad.", {"crate.placement.near.of": "home"}),
        ("Seven residents; five of the residents are children. ", {"civilian.count": 2, "child.count": 5}),
        ("A house. Four rescuers with two dogs stand within 20 m of the house.", {"aid-worker.placement.near.of": "house", "dog.placement.near.of": "house"}),
        ("A house. A truck with two soldiers within 20 m of the house.", {"truck.placement.near.of": None, "soldier.placement.near.of": "house"}),
    ],
)  # fmt: skip
def test_what_is_said_of_groups(text: str, fields: dict[str, Any]) -> None:
    """New assets, shares of concealment, gaps, and whom a relation is about."""
    read = values(read_prose(text, VOCABULARY))
    assert {path: read.get(f"actors[{path.replace('.', '].', 1)}") for path in fields} == fields


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("The area is 800 m E-W by 500 m N-S.", {"world.area.corners[1].east_m": 400, "world.area.corners[2].north_m": 250}),
        ("The area is 120 m long east-west and 90 m deep.", {"world.area.corners[1].east_m": 60, "world.area.corners[2].north_m": 45}),
        ("Fog is set to level 6. Precipitation is moderate.", {"environment.fog_level": 6, "environment.rain_level": 4}),
        ("The operator stops all reports at second 100 and allows them again 80 seconds later.", {"orders[resume-reporting-2].at_s": 180}),
        ("The pilot assumes control at 180 s and relinquishes it at 240 s.", {"orders[hand-over-1].at_s": 180, "orders[take-back-2].at_s": 240}),
        ("No loitering above one bystander beyond 8 s.", {"rules.max_loiter_over_bystander_s": 8}),
        ("The battery starts only with 55 percents.", {"vehicle.battery.initial_fraction": 0.55}),
    ],
)  # fmt: skip
def test_ground_weather_and_orders(text: str, fields: dict[str, Any]) -> None:
    """Sides of the area by their direction, levels that are set, orders in other words."""
    read = values(read_prose(text, VOCABULARY))
    assert {path: read.get(path) for path in fields} == fields


@pytest.mark.parametrize(
    ("text", "quote"),
    [
        ("A house. A truck, the distance between the house is more than 25 m.", "more than 25 m"),
        ("Six adults, keeping clear of trouble.", "trouble"),
        ("Two trucks. It takes the operator 20 m from the tarmac.", "20 m"),
        ("Half its body is tired. A truck.", "Half"),
    ],
)
def test_near_misses_are_listed(text: str, quote: str) -> None:
    """The same words about something else set nothing without a mark."""
    assert quote in listed(read_prose(text, VOCABULARY))


def test_every_asset_word_is_in_the_catalogue() -> None:
    """Each group of the vocabulary stands for an asset that a SimSpec may have."""
    assert {words.asset for words in VOCABULARY.assets.values()} <= set(ASSETS)
