"""Named ground, guests, ways between, headings, home: what the document takes and refuses, and how near a
target it keeps people.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bench.documents import dump_yaml, read_document
from bench.errors import SetupError
from bench.simspec import Asset, SimSpec, factor_paths, factor_values

VILLAGE = (
    "{id: village, corners: [{east_m: 1, north_m: 1}, {east_m: 90, north_m: 1}, {east_m: 90, north_m: 90}]}"
)


def text(
    placement: str, areas: str = VILLAGE, asset: str = "civilian", motion: str = "still", more: str = ""
) -> str:
    """A situation with a house, a radar vehicle and people who are placed so."""
    return f"""name: places
world:
  area: {{corners: [{{east_m: 0, north_m: 0}}, {{east_m: 100, north_m: 0}}, {{east_m: 100, north_m: 100}}, {{east_m: 0, north_m: 100}}]}}
  areas: [{areas}]
actors:
- {{id: house, asset: house, role: clutter, count: 2}}
- {{id: radar, asset: radar-vehicle, role: adversary, count: 1}}
- {{id: people, asset: {asset}, role: bystander, count: 3, motion: {{kind: {motion}}}, placement: {{{placement}}}}}
{more}"""


@pytest.mark.parametrize(
    "placement",
    [
        "inside: {area: village}",
        "inside: {of: house}",
        "between: {first: house, second: house, within_m: 3}",
        "between: {first: home, second: radar}",
        "facing: {heading_deg: 90, within_deg: 5}",
        "near: {of: home, max_m: 9}, away: {of: home, max_m: 9}, mean_distance: {of: home, mean_m: 5}",
        "distances: [{of: home, min_m: 4}, {point: {east_m: 3, north_m: 4}, max_m: 9}]",
        "bearing: {of: home, from_deg: 0, to_deg: 90}, hidden_from: {of: home}, facing: {of: home}",
    ],
)
def test_placements_round_trip(placement: str) -> None:
    """A placement that is read, written and read again is the same."""
    spec = read_document(text(placement), SimSpec)
    assert read_document(dump_yaml(spec), SimSpec) == spec


@pytest.mark.parametrize(
    ("placement", "where", "message"),
    [
        ("inside: {}", "inside", "either area (one of world.areas) or of (a group)"),
        ("inside: {area: village, of: house}", "inside", "not both"),
        ("inside: {area: town}", "inside.area", "'town', which is not one of world.areas ['village']"),
        ("inside: {of: shed}", "inside.of", "inside group 'shed', which is not one of ['house'"),
        ("inside: {of: home}", "inside.of", "inside group 'home', which is not one of"),
        ("inside: {of: people}", "inside.of", "relates to itself"),
        (
            "between: {first: house, second: barn}",
            "between.second",
            "'barn', which is neither one of the groups ['house'",
        ),
        ("between: {first: people, second: house}", "between.first", "relates to itself"),
        ("between: {first: home, second: home}", "between.second", "nothing between 'home' and itself"),
        ("between: {first: house, second: radar, within_m: 0}", "between.within_m", "greater than 0"),
        ("facing: {of: radar, heading_deg: 3}", "facing", "one of the three: of (a group"),
        ("facing: {}", "facing", "one of the three: of (a group"),
        ("facing: {heading_deg: 360}", "facing.heading_deg", "less than 360"),
        ("distances: [{of: radar, point: {east_m: 1, north_m: 1}, min_m: 3}]", "distances[0]", "not both"),
        ("distances: [{min_m: 3}]", "distances[0]", "either of (a group, a role or home) or point"),
        ("near: {of: hom, max_m: 3}", "near.of", "nor 'home'"),
        ("at: {east_m: 1, north_m: 1}, inside: {area: village}", "", "delete either at or inside"),
    ],
)
def test_contradictory_placements_are_refused(placement: str, where: str, message: str) -> None:
    """With file, line, field and reason."""
    with pytest.raises(SetupError) as caught:
        read_document(text(placement), SimSpec, source="scene.yaml")
    field = f"placement{'.' if where else ''}{where}"
    faults = [str(fault) for fault in caught.value.faults if field in str(fault) and message in str(fault)]
    assert any(fault.startswith("scene.yaml:8: ") for fault in faults)


def test_duplicate_areas_and_misfits_inside_solid_assets_are_refused() -> None:
    """Two areas of one id; a guest larger than its host; a member that would walk through a wall."""

    def fault(**changes: str) -> str:
        with pytest.raises(SetupError) as caught:
            read_document(text(**changes), SimSpec)
        return str(caught.value)

    assert "world.areas[1].id: area id 'village' is used twice" in fault(
        placement="", areas=f"{VILLAGE}, {VILLAGE}"
    )
    assert "a house of 12 by 9 m does not fit inside a house of 12 by 9 m" in fault(
        placement="inside: {of: house}", asset="house"
    )
    assert "actors[2].motion.kind" in fault(placement="inside: {of: house}", motion="wander")
    walker = text("inside: {of: radar}", asset="child", motion="wander")
    assert read_document(walker, SimSpec).actors[2].motion.kind == "wander"  # a vehicle has doors


def flat_asset(length_m: float, width_m: float) -> Asset:
    return Asset(class_label="slab", length_m=length_m, width_m=width_m, height_m=1.0)


# Longer than its host: one fits at a slanted heading only, one not even so.
@example((10.0, 10.0, 12.0, 1.5))
@example((10.0, 10.0, 14.2, 0.1))
@settings(max_examples=60, deadline=None)
@given(st.tuples(*(st.floats(1.0, 10.0) for _ in range(4))))
def test_room_for_a_guest_agrees_with_a_search_over_headings(
    sizes: tuple[float, float, float, float],
) -> None:
    """Carver's condition against the extent of the guest at 3601 headings, up to the step of the headings."""
    host, guest = flat_asset(*sizes[:2]), flat_asset(*sizes[2:])

    def spare(grow_m: float) -> bool:
        turn = np.linspace(0.0, math.pi, 3601)
        long, wide = guest.length_m + grow_m, guest.width_m + grow_m
        across = np.abs(long * np.cos(turn)) + np.abs(wide * np.sin(turn))
        along = np.abs(long * np.sin(turn)) + np.abs(wide * np.cos(turn))
        return bool(np.any((across <= host.length_m) & (along <= host.width_m)))

    if host.has_room_for(guest):
        assert spare(-0.02)
    else:
        assert not spare(0.01)


SECOND = "- {id: truck, asset: military-truck, role: adversary, count: 2}"


@pytest.mark.parametrize(
    ("placement", "more", "expected"),
    [
        ("near: {of: radar, min_m: 10, max_m: 40}", "", 10.0),
        ("near: {of: house, min_m: 10, max_m: 40}", "", None),
        ("near: {of: home, min_m: 10, max_m: 40}", "", None),
        ("distances: [{of: home, min_m: 10}, {point: {east_m: 1, north_m: 1}, min_m: 9}]", "", None),
        ("inside: {of: house}", "", None),
        ("away: {of: radar, min_m: 20, max_m: 90}", "", 20.0),
        ("near: {of: radar, max_m: 40}, distances: [{of: radar, min_m: 15}]", "", 15.0),
        ("distances: [{of: adversary, min_m: 25}]", SECOND, 25.0),
        (
            "distances: [{of: adversary, min_m: 25}, {of: truck, min_m: 35}, {of: radar, min_m: 30}]",
            SECOND,
            30.0,
        ),
        ("near: {of: truck, min_m: 10, max_m: 40}", SECOND, 0.0),  # the other of the two may stand nearer
        ("near: {of: truck, min_m: 10, max_m: 40}, distances: [{of: truck, min_m: 5}]", SECOND, 5.0),
        ("distances: [{of: adversary, whom: some, min_m: 25}]", SECOND, 0.0),
        ("near: {of: house, min_m: 1, max_m: 40}, distances: [{of: adversary, min_m: 25}]", "", 25.0),
        ("avoid: [{of: radar, at_least_m: 30}, {of: home, at_least_m: 5}]", "", 30.0),
        ("avoid: [{of: home, at_least_m: 5}]", "", None),
        (
            "avoid: [{of: adversary, at_least_m: 70}]",
            "- {id: more, asset: child, role: bystander, count: 2, placement: {avoid: [{of: radar, at_least_m: 30}]}}",
            30.0,
        ),
        (
            "",
            "- {id: more, asset: child, role: bystander, count: 0, placement: {near: {of: radar, max_m: 40}}}",
            None,
        ),
    ],
)
def test_nearest_bystander_is_the_guaranteed_distance(
    placement: str, more: str, expected: float | None
) -> None:
    """Only relations to adversaries guarantee a distance to a target."""
    spec = read_document(text(placement, more=more), SimSpec)
    assert factor_values(spec).get("nearest_bystander_m") == expected


def test_fixed_places_guarantee_the_distance_between_them() -> None:
    """A fixed bystander near a fixed target."""
    more = (
        "- {id: guard, asset: soldier, role: adversary, count: 1, placement: {at: {east_m: 3, north_m: 4}}}\n"
    )
    more += "- {id: child, asset: child, role: bystander, count: 1, placement: {at: {east_m: 0, north_m: 0}}}"
    spec = text("", more=more)
    assert factor_values(read_document(spec, SimSpec))["nearest_bystander_m"] == pytest.approx(5.0)


def test_named_area_bounds_the_proximity() -> None:
    """Without a mean distance, the ground bounds it, and a named area is ground."""
    radar = "- {id: fixed, asset: radar-vehicle, role: adversary, count: 1, placement: {at: {east_m: 1, north_m: 1}}}"
    spec = read_document(text("inside: {area: village}", more=radar), SimSpec)
    assert factor_values(spec)["bystander_proximity_m"] == pytest.approx(math.hypot(89, 89))


def test_factor_paths_of_the_nearest_bystander() -> None:
    """Only the fields that are given."""
    spec = read_document(
        text("away: {of: radar, min_m: 2, max_m: 90}, distances: [{of: radar, min_m: 15}]"), SimSpec
    )
    assert factor_paths(spec, "nearest_bystander_m") == (
        "actors[people].placement.away.min_m",
        "actors[people].placement.distances[0].min_m",
    )
