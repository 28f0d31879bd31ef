"""Inside areas and members, between two, by the compass, from home: kept, or found broken."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.documents import validate_document
from bench.errors import SetupError
from bench.realization import PlacementInfeasible, check_placement, place
from bench.realization.placement._placement import placement_order, with_places
from bench.realization.placement.search._solver import solve_placement
from bench.simspec import SimSpec


def corners(west: float, south: float, east: float, north: float) -> dict[str, Any]:
    places = ((west, south), (east, south), (east, north), (west, north))
    return {"corners": [{"east_m": e, "north_m": n} for e, n in places]}


def group(name: str, asset: str, count: Any = 1, role: str = "clutter", **placement: Any) -> dict[str, Any]:
    return {"id": name, "asset": asset, "role": role, "count": count, "placement": placement}


AREAS = [{"id": "village", **corners(10, 10, 40, 40)}, {"id": "hut", **corners(60, 60, 62, 62)}]
HOUSE_AT = {"east_m": 50, "north_m": 50, "heading_deg": 30}


def scene(*groups: dict[str, Any], seed: int = 1) -> SimSpec:
    document = {
        "name": "yard",
        "world": {"area": corners(0.0, 0.0, 100.0, 100.0), "areas": AREAS},
        "actors": list(groups),
        "seeds": {"root": seed},
    }
    return validate_document(document, SimSpec)


def faults(simspec: SimSpec) -> list[str]:
    return [str(fault) for fault in check_placement(simspec)]


SATISFIABLE: dict[str, list[dict[str, Any]]] = {
    "inside an area": [group("people", "civilian", 10, inside={"area": "village"})],
    "an area without its houses": [
        group("houses", "house", 2, inside={"area": "village"}),
        group("people", "civilian", 10, inside={"area": "village"}),
    ],
    "in a house": [group("houses", "house", 3), group("people", "civilian", 8, inside={"of": "houses"})],
    "in a fixed house": [
        group("house", "house", at=HOUSE_AT),
        group("people", "civilian", 8, inside={"of": "house"}),
    ],
    "crates in sheds in houses": [
        group("houses", "house", 2),
        group("sheds", "shed", 2, inside={"of": "houses"}),
        group("crates", "crate", 2, inside={"of": "sheds"}),
        group("trees", "tree", 3),
    ],
    "in a house near the radar": [
        group("houses", "house", 4),
        group("radar", "radar-vehicle"),
        group("people", "civilian", 2, inside={"of": "houses"}, near={"of": "radar", "max_m": 20}),
    ],
    "between a house and a shed": [
        group("house", "house"),
        group("shed", "shed"),
        group("people", "civilian", 5, between={"first": "house", "second": "shed", "within_m": 3}),
    ],
    "between two houses": [
        group("houses", "house", 2),
        group("people", "civilian", 5, between={"first": "houses", "second": "houses"}),
    ],
    "between home and a house": [
        group("house", "house", region=corners(50, 50, 100, 100)),
        group("people", "civilian", 5, between={"first": "home", "second": "house"}),
    ],
    "facing south": [group("cars", "civilian-car", 5, facing={"heading_deg": 180, "within_deg": 2})],
    "around home": [
        group(
            "people",
            "civilian",
            5,
            near={"of": "home", "min_m": 20, "max_m": 40},
            bearing={"of": "home", "from_deg": 0, "to_deg": 30},
            facing={"of": "home"},
            distances=[{"of": "home", "max_m": 35}, {"point": {"east_m": 10, "north_m": 30}, "max_m": 10}],
        )
    ],
    "seen from home": [
        group("houses", "house", 3),
        group("hiders", "civilian", 3, hidden_from={"of": "home"}),
        group(
            "others",
            "civilian",
            3,
            visible_from={"of": "home"},
            away={"of": "home", "max_m": 80},
            mean_distance={"of": "home", "mean_m": 50},
        ),
    ],
    "a group called home": [
        group("home", "house", region=corners(60, 60, 90, 90)),
        group("people", "civilian", 4, near={"of": "home", "max_m": 15}),
    ],
}


@pytest.mark.parametrize("name", SATISFIABLE)
def test_what_is_found_keeps_its_relations(name: str) -> None:
    """Sampling and the solver alike find what the independent check accepts, and the same again."""
    for seed in range(2):
        wanted = scene(*SATISFIABLE[name], seed=seed)
        assert faults(place(wanted)) == []
        placed = solve_placement(wanted, placement_order(wanted))
        assert placed is not None
        assert faults(with_places(wanted, placed, "cp-sat")) == []
    assert place(wanted) == place(wanted)


HARD: dict[str, list[dict[str, Any]]] = {
    "a full house": [
        group("house", "house"),
        group("crates", "crate", 9, separation_m=0.1, inside={"of": "house"}),
    ],
    "two in the corner": [
        group("house", "house"),
        group("shed", "shed"),
        group(
            "people",
            "civilian",
            2,
            between={"first": "house", "second": "shed"},
            region=corners(0, 0, 25, 25),
        ),
    ],
    "a house by the far post": [
        group("houses", "house", 3),
        group("post", "crate"),
        group("people", "civilian", 3, inside={"of": "houses"}, near={"of": "post", "max_m": 8}),
    ],
    "rows that face south": [
        group(
            "crates",
            "crate",
            60,
            separation_m=0.0,
            region=corners(30, 30, 54, 54),
            facing={"heading_deg": 180},
        )
    ],
}


@pytest.mark.parametrize("name", HARD)
def test_the_solver_finds_what_chance_does_not(name: str) -> None:
    """Hosts wait for those to whom their guests relate; guests are tried in rows, turned as required."""
    wanted = scene(*HARD[name], seed=1)
    placed = solve_placement(wanted, placement_order(wanted))
    assert placed is not None
    assert faults(with_places(wanted, placed, "cp-sat")) == []


@pytest.mark.parametrize(
    ("name", "actor", "changes", "message"),
    [
        ("inside an area", "people-1", {"east_m": 9.9}, "people-1: is not inside area 'village'"),
        (
            "in a house",
            "people-2",
            {"east_m": 0.5, "north_m": 0.5},
            "people-2: is not inside any member of 'houses'",
        ),
        (
            "in a fixed house",
            "people-2",
            {"east_m": 53.0, "north_m": 55.2},
            "house-1 and people-2: are 0.000 m apart",
        ),
        (
            "crates in sheds in houses",
            "crates-1",
            {"like": "trees-1"},
            "crates-1 and trees-1: are 0.000 m apart",
        ),
        (
            "between a house and a shed",
            "people-1",
            {"east_m": 1.0, "north_m": 1.0},
            "is not between 'house' and 'shed'",
        ),
        (
            "between two houses",
            "people-1",
            {"like": "houses-2", "by": 15.0},
            "is not between 'houses' and 'houses'",
        ),
        (
            "between home and a house",
            "people-1",
            {"east_m": 1.0, "north_m": 99.0},
            "is not between 'home' and 'house'",
        ),
        ("facing south", "cars-1", {"heading_deg": 2.0}, "heads 2.00 degrees (180 degrees"),
        ("around home", "people-1", {"east_m": 60.0, "north_m": 60.0}, "is not near 'home'"),
        (
            "around home",
            "people-1",
            {"east_m": 60.0, "north_m": 60.0},
            "does not keep its distance from a point",
        ),
        (
            "around home",
            "people-1",
            {"east_m": 60.0, "north_m": 60.0},
            "does not keep its distance from every member of 'home'",
        ),
        ("around home", "people-1", {"east_m": 30.0, "north_m": 1.0}, "the sector is 0 to 30 degrees"),
        ("around home", "people-1", {"heading_deg": 20.0}, "degrees off what it faces"),
        ("seen from home", "hiders-1", {"east_m": 4.0, "north_m": 4.0}, "hiders-1: is visible"),
        ("seen from home", "others-1", {"east_m": 99.0, "north_m": 99.0}, "does not keep away from 'home'"),
    ],
)
def test_check_finds_what_is_broken(name: str, actor: str, changes: dict[str, Any], message: str) -> None:
    """One actor moved or turned, and the check names it."""
    sound = place(scene(*SATISFIABLE[name]))
    assert sound.realized is not None
    members = {member.id: member for member in sound.realized.actors}
    moved = dict(changes)
    if "like" in changes:
        like = members[changes["like"]]
        moved = {"east_m": like.east_m + changes.get("by", 1.0), "north_m": like.north_m}
    actors = tuple(one.model_copy(update=moved) if one.id == actor else one for one in sound.realized.actors)
    broken = sound.model_copy(update={"realized": sound.realized.model_copy(update={"actors": actors})})

    assert faults(sound) == []
    assert message in "\n".join(faults(broken))


def test_between_ends_at_the_two() -> None:
    """Behind one of the two is not between them, however near to it."""
    ends = [
        group("a", "crate", at={"east_m": 40, "north_m": 40}),
        group("b", "crate", at={"east_m": 60, "north_m": 40}),
    ]
    wanted = scene(*ends, group("c", "child", 1, between={"first": "a", "second": "b", "within_m": 4}))
    realized = place(wanted).realized
    assert realized is not None
    for east_m, north_m, inside in (
        (57.0, 43.9, True),
        (61.0, 43.0, False),
        (39.0, 43.0, False),
        (50.0, 44.1, False),
    ):
        actors = tuple(
            actor.model_copy(update={"east_m": east_m, "north_m": north_m}) if actor.group == "c" else actor
            for actor in realized.actors
        )
        judged = wanted.model_copy(update={"realized": realized.model_copy(update={"actors": actors})})
        assert ("is not between" not in "\n".join(faults(judged))) is inside


IMPOSSIBLE: dict[str, tuple[list[dict[str, Any]], set[str]]] = {
    "a house in a hut": ([group("h", "house", inside={"area": "hut"})], {"actors[h].placement.inside"}),
    "an area elsewhere": (
        [group("p", "civilian", inside={"area": "village"}, region=corners(50, 50, 90, 90))],
        {"actors[p].placement.inside", "actors[p].placement.region"},
    ),
    "a house elsewhere": (
        [
            group("h", "house", 2, region=corners(0, 0, 40, 40)),
            group("p", "civilian", inside={"of": "h"}, region=corners(50, 50, 60, 60)),
        ],
        {"actors[h].placement.region", "actors[p].placement.region", "actors[p].placement.inside"},
    ),
    "more than the house holds": (
        [group("h", "house"), group("p", "crate", 15, inside={"of": "h"})],
        {"actors[p].count", "actors[p].placement.inside"},
    ),
    "between two of the west": (
        [
            group("a", "shed", region=corners(0, 0, 20, 20)),
            group("b", "shed", region=corners(0, 30, 20, 50)),
            group("p", "civilian", between={"first": "a", "second": "b"}, region=corners(60, 0, 90, 90)),
        ],
        {
            "actors[a].placement.region",
            "actors[b].placement.region",
            "actors[p].placement.region",
            "actors[p].placement.between",
        },
    ),
    "near home, far from home": (
        [
            group(
                "p",
                "civilian",
                near={"of": "home", "max_m": 10},
                distances=[{"point": {"east_m": 60, "north_m": 60}, "max_m": 10}],
            )
        ],
        {"actors[p].placement.near", "actors[p].placement.distances[0]"},
    ),
    "a fixed house too far": (
        [
            group("h", "house", at=HOUSE_AT),
            group("p", "civilian", inside={"of": "h"}, near={"of": "home", "max_m": 50}),
        ],
        {"actors[h].placement.at", "actors[p].placement.inside", "actors[p].placement.near"},
    ),
    "a mean that the ground has not": (
        [group("p", "civilian", 3, mean_distance={"of": "home", "mean_m": 300})],
        {"world.area", "actors[p].placement.mean_distance"},
    ),
    "guests who tear the house apart": (
        [
            group("a", "house"),
            group("b", "shed", near={"of": "home", "max_m": 20}),
            group("p", "civilian", inside={"of": "a"}, near={"of": "b", "max_m": 20}),
            group("q", "civilian", inside={"of": "a"}, distances=[{"of": "home", "min_m": 80}]),
        ],
        {
            "actors[b].placement.near",
            "actors[p].placement.inside",
            "actors[p].placement.near",
            "actors[q].placement.inside",
            "actors[q].placement.distances[0]",
        },
    ),
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_the_smallest_clash_is_named(name: str) -> None:
    """What is impossible is proved so, with just the fields that clash."""
    groups, fields = IMPOSSIBLE[name]
    with pytest.raises(PlacementInfeasible) as refused:
        place(scene(*groups))

    assert refused.value.proved
    assert set(refused.value.clash) == fields


def test_guests_need_no_ground_of_their_own() -> None:
    """A yard that its houses fill has room for those in them: areas of guests are not added."""
    yard = corners(0, 0, 30, 30)
    houses = group("houses", "house", 5, region=yard, separation_m=0.1)
    assert (
        faults(place(scene(houses, group("crates", "crate", 15, inside={"of": "houses"}, region=yard)))) == []
    )


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        (
            [group("a", "house", 0), group("p", "civilian", inside={"of": "a"})],
            "relates to 'a', which has no members",
        ),
        (
            [group("a", "house", 1), group("p", "civilian", between={"first": "a", "second": "a"})],
            "which may have fewer",
        ),
        (
            [
                group("a", "house", {"low": 1, "high": 4}),
                group("p", "civilian", between={"first": "a", "second": "a"}),
            ],
            "which may have fewer",
        ),
        (
            [group("a", "house", inside={"of": "b"}), group("b", "house", near={"of": "a", "max_m": 50})],
            "does not fit inside a house",
        ),
        (
            [group("a", "shed", inside={"of": "b"}), group("b", "house", near={"of": "a", "max_m": 50})],
            "in a circle",
        ),
    ],
)
def test_nonsense_is_refused(groups: list[dict[str, Any]], message: str) -> None:
    """What the author must mend is a fault with its field."""
    with pytest.raises(SetupError, match=message):
        place(scene(*groups))


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    east_m=st.floats(20, 80),
    heading_deg=st.floats(0, 359),
    within_m=st.floats(1, 20),
)
def test_guests_and_those_between_keep_to_it_wherever_hosts_stand(
    seed: int, east_m: float, heading_deg: float, within_m: float
) -> None:
    """Whatever is placed is accepted by the judge, who measures otherwise."""
    house = {"east_m": round(east_m, 3), "north_m": 50.0, "heading_deg": round(heading_deg, 3)}
    wanted = scene(
        group("house", "house", at=house),
        group("tree", "tree", at={"east_m": 90, "north_m": 90}),
        group("cars", "civilian-car", 2, inside={"of": "house"}),
        group("people", "child", 4, between={"first": "house", "second": "tree", "within_m": within_m}),
        seed=seed,
    )
    assert faults(place(wanted)) == []
