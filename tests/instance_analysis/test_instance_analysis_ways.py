"""Where groups go and when, and whom the drone escorts."""

from __future__ import annotations

from typing import Any

import pytest

from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose

VOCABULARY = load_vocabulary()
CONVOY = "A convoy of three civilian cars drives from (-200, 0) to (200, 0) at 5 m/s."


def values(result: BaseSimSpec) -> dict[str, Any]:
    return {receipt.path: receipt.value for receipt in result.receipts if receipt.source == "prose"}


def listed(result: BaseSimSpec) -> str:
    return " | ".join(passage.quote for passage in (*result.not_understood, *result.not_expressible))


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("Two trucks depart 90 s after start, proceed eastwards at 6 m/s and come to a final halt at 210 s.", {"depart_s": 90, "speed_mps": 6, "halt_s": 210, "kind": "patrol"}),
        ("Two trucks start to drive at t=30 s with 4,5 m/s and don't make pause.", {"depart_s": 30, "speed_mps": 4.5, "pause_s": 0}),
        ("Two trucks, SP at H+2 min, 5 m/s without halts.", {"depart_s": 120, "speed_mps": 5, "pause_s": 0}),
        ("Two trucks drive at 5 m/s and stop after 3 minutes.", {"halt_s": 180}),
    ],
)  # fmt: skip
def test_when_a_group_moves(text: str, fields: dict[str, Any]) -> None:
    """It sets off and stops for good at stated times, and rests or not."""
    read = values(read_prose(text, VOCABULARY))
    assert {name: read.get(f"actors[truck].motion.{name}") for name in fields} == fields


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("Two trucks move eastwards.", [(-300, 0), (300, 0)]),
        ("Two trucks transit E to W.", [(300, 0), (-300, 0)]),
        ("A road from (0, -100) to (0, 100). Two trucks drive on the road towards the south.", [(0, 100), (0, -100)]),
        ("Two trucks move along route COPPER, direction NE.", [(-125, -125), (125, 125)]),
    ],
)  # fmt: skip
def test_a_direction_of_motion_is_a_way(text: str, ends: list[tuple[float, float]]) -> None:
    """Along the road of the group, or else through the area; a road without a course runs with the group."""
    result = read_prose(text, VOCABULARY)
    [group] = result.simspec.actors
    assert [(point.east_m, point.north_m) for point in group.motion.route] == ends


@pytest.mark.parametrize(
    "text",
    [
        "A truck waits north of a house.",
        "A soldier. A truck, north.",
        "Two trucks drive by, a house north of them.",
    ],
)
def test_a_direction_of_a_place_is_no_way(text: str) -> None:
    """Somebody who stands north of something goes nowhere."""
    assert all(not group.motion.route for group in read_prose(text, VOCABULARY).simspec.actors)


@pytest.mark.parametrize(
    "text",
    [
        f"{CONVOY} The UAV shall remain within 70 m of it. Any adversary shall be reported before the convoy is within 90 m of it.",
        "CIV convoy, three cars, transits W to E. Escort convoy within 70 m, warn before it closes to 90 m of TGT.",
        "Escort the relief cvy, 3 civ cars, E along MSR GOLD. UAV to remain within 70 m of cvy. Warn before any EN closes to 90 m.",
        f"{CONVOY} The drone accompanies the cars within 70 m. It must warn from enemy before column is on 90 m near him.",
    ],
)  # fmt: skip
def test_an_escort_is_read(text: str) -> None:
    """The group, its distance and the warning; people sit in the cars, which do not rest."""
    simspec = read_prose(text, VOCABULARY).simspec
    escort, [cars] = simspec.mission.escort, simspec.actors
    assert escort is not None
    assert (escort.group, escort.within_m, escort.warn_before_m) == ("car", 70, 90)
    assert (cars.role, cars.count, cars.motion.kind, cars.motion.pause_s) == ("bystander", 3, "patrol", 0)


@pytest.mark.parametrize(
    ("text", "quote"),
    [
        ("A house. The drone shall guard the house.", "guard the house"),
        ("Two civilian cars are parked. The drone escorts them within 50 m.", "escorts them within 50 m"),
        (f"{CONVOY} A truck. The drone stays within 50 m of the truck.", "within 50 m of the truck"),
        ("A radar, guarded by four soldiers. The drone warns before it is within 90 m.", "before it is within 90 m"),
    ],
)  # fmt: skip
def test_what_is_no_escort_is_listed(text: str, quote: str) -> None:
    """Houses, groups that stand still, targets, and a warning of nobody."""
    result = read_prose(text, VOCABULARY)
    assert result.simspec.mission.escort is None
    assert quote in listed(result)


def test_the_convoy_gives_no_orders_to_the_drone() -> None:
    """Whoever holds in a sentence about a convoy, it is not the drone."""
    result = read_prose(f"{CONVOY} The convoy holds at 60 s. At 90 s the convoy stops.", VOCABULARY)
    assert not result.simspec.orders


def test_parked_cars_are_clutter_and_driven_ones_are_not() -> None:
    """What a moving car's role is made of is said."""
    result = read_prose("Two cars parked on the road. A road. Three cars drive at 5 m/s.", VOCABULARY)
    assert {group.id: group.role for group in result.simspec.actors} == {
        "car": "clutter",
        "car-2": "bystander",
    }
    assert any("role is bystander" in remark.why for remark in result.remarks)


def test_two_names_of_roads_are_two_roads() -> None:
    """A name is passed over only where there is no other."""
    assert "SILVER" not in listed(read_prose("Two trucks on road SILVER. Road SILVER runs N-S.", VOCABULARY))
    assert "SILVER" in listed(read_prose("Two trucks on road SILVER. Road GOLD runs N-S.", VOCABULARY))


def test_whom_the_drone_escorts_in_the_passive() -> None:
    """The drone is no place to stand by; times of the convoy are no orders."""
    text = "Convoy of two vans escorted by the drone, halts at t+240, 6 m/s, from (-200, 0) to (200, 0)."
    simspec = read_prose(text, VOCABULARY).simspec
    assert simspec.mission.escort is not None
    assert (simspec.mission.escort.group, simspec.actors[0].motion.halt_s) == ("van", 240)
    assert simspec.actors[0].placement.near is None
    assert not simspec.orders


def test_targets_are_not_escorted() -> None:
    """Nobody accompanies an enemy."""
    result = read_prose("Two soldiers, accompanied by the drone.", VOCABULARY)
    assert result.simspec.mission.escort is None
    assert "accompanied by the drone" in listed(result)
