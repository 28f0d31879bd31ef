"""Roads, bearings, facing, sight, spread and drawn counts: kept where they can be, or found broken."""

from __future__ import annotations

import math
import pickle
import time
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.documents import validate_document
from bench.errors import SetupError
from bench.realization import PlacementInfeasible, check_placement, place
from bench.realization.placement._placement import placement_order
from bench.realization.placement.proofs._proof import prove_infeasible
from bench.simspec import ASSETS, SimSpec, factor_values

ROADS = [
    {
        "id": "main",
        "points": [{"east_m": e, "north_m": n} for e, n in ((0, 20), (60, 30), (100, 90))],
        "width_m": 7.0,
    },
    {"id": "path", "points": [{"east_m": 20, "north_m": 95}, {"east_m": 80, "north_m": 95}], "width_m": 2.0},
]


def corners(west: float, south: float, east: float, north: float) -> dict[str, Any]:
    places = ((west, south), (east, south), (east, north), (west, north))
    return {"corners": [{"east_m": e, "north_m": n} for e, n in places]}


def group(name: str, asset: str, count: Any = 1, role: str = "clutter", **placement: Any) -> dict[str, Any]:
    return {"id": name, "asset": asset, "role": role, "count": count, "placement": placement}


def scene(*groups: dict[str, Any], seed: int = 1, size_m: float = 100.0) -> SimSpec:
    document = {
        "name": "yard",
        "world": {"area": corners(0.0, 0.0, size_m, size_m), "roads": ROADS},
        "actors": list(groups),
        "seeds": {"root": seed},
    }
    return validate_document(document, SimSpec)


def faults(simspec: SimSpec) -> list[str]:
    return [str(fault) for fault in check_placement(simspec)]


SATISFIABLE: dict[str, list[dict[str, Any]]] = {
    "on a road": [group("cars", "civilian-car", 8, along={"road": "main", "parallel_deg": 8})],
    "beside a road": [
        group("people", "civilian", 12, along={"road": "main", "where": "beside", "within_m": 2})
    ],
    "off a road": [
        group(
            "people",
            "civilian",
            12,
            along={"road": "main", "where": "beside", "at_least_m": 20, "within_m": 30},
        ),
    ],
    "north of": [
        group("houses", "house", 3, region=corners(20, 10, 80, 50)),
        group("people", "civilian", 8, bearing={"of": "houses", "from_deg": 315, "to_deg": 45}),
    ],
    "a wide sector": [
        group(
            "people",
            "civilian",
            8,
            bearing={"point": {"east_m": 50, "north_m": 50}, "from_deg": 90, "to_deg": 80},
        )
    ],
    "facing": [
        group("radar", "radar-vehicle", 1),
        group(
            "guards",
            "soldier",
            6,
            facing={"of": "radar", "within_deg": 5},
            near={"of": "radar", "min_m": 5, "max_m": 40},
        ),
        group("watch", "soldier", 3, facing={"point": {"east_m": 0, "north_m": 50}}),
    ],
    "sight": [
        group("houses", "house", 3, region=corners(30, 30, 90, 90)),
        group("radar", "radar-vehicle", 1),
        group("hiders", "soldier", 4, hidden_from={"point": {"east_m": 1, "north_m": 1}, "height_m": 2.0}),
        group("seen", "civilian", 4, visible_from={"of": "radar", "height_m": 3.0}),
    ],
    "kinds": [
        group("houses", "house", 3, region=corners(30, 30, 90, 90)),
        group("trees", "tree", 3),
        group(
            "soldiers",
            "soldier",
            5,
            role="adversary",
            distances=[
                {"of": "clutter", "min_m": 10},
                {"of": "houses", "whom": "some", "min_m": 12, "max_m": 25},
            ],
        ),
    ],
    "spread": [group("people", "civilian", 12, spread_m=18)],
    "an open route": [
        {
            **group("patrol", "soldier", 1, role="adversary"),
            "motion": {
                "kind": "patrol",
                "route": [{"east_m": e, "north_m": n} for e, n in ((20, 20), (80, 25), (60, 80))],
            },
        },
        group("houses", "house", 12),
    ],
}


@pytest.mark.parametrize("name", SATISFIABLE)
def test_relations_are_kept(name: str) -> None:
    """Whatever the relation asks for is what the independent check finds, for several seeds."""
    for seed in range(4):
        assert faults(place(scene(*SATISFIABLE[name], seed=seed))) == []


@pytest.mark.parametrize(
    ("name", "actor", "changes", "message"),
    [
        ("on a road", "cars-1", {"east_m": 90.0, "north_m": 10.0}, "does not stand on road 'main'"),
        ("on a road", "cars-1", {"turn": 30.0}, "degrees off road 'main'"),
        ("beside a road", "people-1", {"east_m": 60.0, "north_m": 30.0}, "is 0.000 m from road 'main'"),
        ("beside a road", "people-1", {"east_m": 90.0, "north_m": 10.0}, "m from road 'main'"),
        ("north of", "people-2", {"east_m": 99.0, "north_m": 1.0}, "the sector is 315 to 45 degrees"),
        ("facing", "guards-3", {"turn": 6.0 + 5.0}, "degrees off what it faces"),
        ("sight", "hiders-2", {"east_m": 3.0, "north_m": 3.0}, "is visible from"),
        ("kinds", "soldiers-1", {"north_m": 5.0, "east_m": 5.0}, "some member of 'houses'"),
        ("spread", "people-1", {"like": "people-2"}, "people-1 and people-2: stand closer than spread_m"),
        (
            "an open route",
            "houses-1",
            {"east_m": 20.0, "north_m": 20.0},
            "blocks the patrol route of 'patrol'",
        ),
    ],
)
def test_check_finds_what_is_broken(name: str, actor: str, changes: dict[str, Any], message: str) -> None:
    """One actor moved or turned, and the check names it."""
    sound = place(scene(*SATISFIABLE[name]))
    assert sound.realized is not None
    members = {member.id: member for member in sound.realized.actors}
    moved = {key: value for key, value in changes.items() if key in ("east_m", "north_m")}
    if "turn" in changes:
        moved["heading_deg"] = (members[actor].heading_deg + changes["turn"]) % 360.0
    if "like" in changes:
        moved = {"east_m": members[changes["like"]].east_m + 5.0, "north_m": members[changes["like"]].north_m}
    actors = tuple(one.model_copy(update=moved) if one.id == actor else one for one in sound.realized.actors)

    assert message in "\n".join(
        faults(sound.model_copy(update={"realized": sound.realized.model_copy(update={"actors": actors})}))
    )


def test_a_low_wall_does_not_hide_from_above() -> None:
    """Behind a shed one is hidden from the ground, and from high above only close behind it."""
    shed = group("shed", "shed", at={"east_m": 50.0, "north_m": 50.0, "heading_deg": 90.0})
    strip = corners(49.0, 60.0, 51.0, 70.0)

    def hiding(height_m: float) -> SimSpec:
        eye = {"point": {"east_m": 50, "north_m": 20}, "height_m": height_m}
        return scene(shed, group("hider", "child", hidden_from=eye, region=strip))

    assert faults(place(hiding(1.7))) == []
    with pytest.raises(PlacementInfeasible, match=r"out of sight of the point 50 east, 20 north at 40 m"):
        place(hiding(40.0))


def test_drawn_counts() -> None:
    """A range comes out within itself, by the seed, and rates as its low end."""
    people = group("people", "civilian", {"low": 3, "high": 9}, role="bystander")
    placed = [place(scene(people, seed=seed)) for seed in range(30)]
    drawn = {len(actor.realized.actors) for actor in placed if actor.realized}

    assert drawn == set(range(3, 10))
    assert [fault for actor in placed for fault in faults(actor)] == []
    assert (
        factor_values(placed[0])["bystander_density_per_km2"]
        == factor_values(scene(group("people", "civilian", 3, role="bystander")))["bystander_density_per_km2"]
    )


def test_a_range_leaves_the_places_alone() -> None:
    """A drawn number of members stands where the same number, written, would stand."""
    drawn = place(scene(group("people", "civilian", {"low": 3, "high": 9}))).realized
    assert drawn is not None
    assert drawn == place(scene(group("people", "civilian", len(drawn.actors)))).realized


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        ([group("a", "crate", {"low": 4, "high": 2})], "high 2 must exceed low 4"),
        ([group("a", "crate", distances=[{"of": "b", "min_m": 3}])], "neither one of the groups"),
        ([group("a", "crate", distances=[{"of": "a", "min_m": 3}])], "relates to itself"),
        ([group("a", "crate", distances=[{"of": "clutter"}])], "every distance is permitted"),
        ([group("a", "crate", bearing={"from_deg": 0, "to_deg": 90})], "either of"),
        ([group("a", "crate", along={"road": "lane"})], "not one of"),
        ([group("a", "crate", along={"road": "main", "at_least_m": 3})], "delete at_least_m"),
        (
            [group("a", "crate", along={"road": "main", "where": "beside", "at_least_m": 5})],
            "must exceed at_least_m",
        ),
        ([group("a", "crate", at={"east_m": 1, "north_m": 1}, spread_m=3)], "delete either at or spread_m"),
        (
            [
                group("a", "house", hidden_from={"of": "b"}),
                group("b", "house", near={"of": "a", "max_m": 50}),
            ],
            "in a circle",
        ),
        (
            [
                group("a", "crate", bearing={"of": "b", "from_deg": 0, "to_deg": 9}),
                group("b", "crate", {"low": 0, "high": 2}),
            ],
            "no members",
        ),
    ],
)
def test_nonsense_is_refused(groups: list[dict[str, Any]], message: str) -> None:
    """What the author must mend is a fault with its field."""
    with pytest.raises(SetupError, match=message):
        place(scene(*groups))


def refusal(*groups: dict[str, Any], size_m: float = 100.0) -> PlacementInfeasible:
    with pytest.raises(PlacementInfeasible) as refused:
        place(scene(*groups, size_m=size_m))
    return refused.value


IMPOSSIBLE: dict[str, tuple[list[dict[str, Any]], set[str]]] = {
    "farther from a road than the ground goes": (
        [
            group(
                "p", "civilian", along={"road": "main", "where": "beside", "at_least_m": 120, "within_m": 130}
            )
        ],
        {"actors[p].placement.along", "world.area"},
    ),
    "a house on a lane": ([group("h", "house", along={"road": "path"})], {"actors[h].placement.along"}),
    "too narrow": (
        [group("h", "house", region=corners(0, 0, 8, 90)), group("t", "tree", 9)],
        {"actors[h].placement.region"},
    ),
    "far from one, near the other": (
        [
            group("h", "house", region=corners(30, 30, 50, 50)),
            group("g", "soldier", near={"of": "h", "max_m": 10}),
            group(
                "c",
                "soldier",
                5,
                distances=[{"of": "h", "min_m": 60}, {"of": "g", "whom": "some", "max_m": 25}],
            ),
        ],
        {
            "actors[h].placement.region",
            "actors[g].placement.near",
            "actors[c].placement.distances[0]",
            "actors[c].placement.distances[1]",
        },
    ),
    "north of the north": (
        [
            group("h", "house", region=corners(20, 80, 90, 95)),
            group(
                "c",
                "civilian",
                5,
                bearing={"of": "h", "from_deg": 315, "to_deg": 45},
                near={"of": "h", "min_m": 25, "max_m": 60},
            ),
        ],
        {
            "actors[h].placement.region",
            "world.area",
            "actors[c].placement.bearing",
            "actors[c].placement.near",
        },
    ),
    "nothing to hide behind": (
        [group("c", "soldier", hidden_from={"point": {"east_m": 0, "north_m": 0}})],
        {"actors[c].placement.hidden_from"},
    ),
    "too many for a shared region": (
        [
            group("a", "house", 10, region=corners(0, 0, 40, 40)),
            group("b", "house", 10, region=corners(10, 0, 50, 40)),
            group("c", "tree", 5, region=corners(60, 60, 90, 90)),
        ],
        {"actors[a].count", "actors[b].count", "actors[a].placement.region", "actors[b].placement.region"},
    ),
    "too far apart": (
        [group("c", "civilian", 26, spread_m=30)],
        {"actors[c].placement.spread_m", "world.area"},
    ),
    "a mean that crowding forbids": (
        [group("t", "crate"), group("c", "civilian", 200, mean_distance={"of": "t", "mean_m": 3.0})],
        {"actors[c].count", "actors[c].placement.mean_distance"},
    ),
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_the_smallest_clash_is_named(name: str) -> None:
    """What is impossible is proved so, with just the fields that clash."""
    groups, fields = IMPOSSIBLE[name]
    refused = refusal(*groups)

    assert refused.proved
    assert set(refused.clash) == fields
    assert all(field in str(refused) for field in fields)


@pytest.mark.parametrize("dropped", ["a", "b"])
def test_a_clash_needs_each_of_its_groups(dropped: str) -> None:
    """With either of two groups that share ground left out, nothing is proved; trees never mattered."""
    groups, fields = IMPOSSIBLE["too many for a shared region"]
    rest = scene(*(actor for actor in groups if actor["id"] != dropped))

    assert prove_infeasible(rest, placement_order(rest)) is None
    assert not any("[c]" in field for field in fields)


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        (
            [group("a", "civilian", 2, region=corners(0, 0, 100, 0.02))],
            r"proved so: .* region of 2 m2 \(actors\[a\].placement.region\)",
        ),
        ([group("a", "civilian", 1000, region=corners(0, 0, 20, 20))], r"1000 of 'a' need at least 1046 m2"),
        ([group("a", "civilian", 3, separation_m=500.0)], r"of 'a' need at least"),
    ],
)
def test_bad_regions_are_refused_at_once(groups: list[dict[str, Any]], message: str) -> None:
    """A sliver of a region, a crowd and a gap wider than the ground get a clear answer in no time."""
    began = time.process_time()

    with pytest.raises(PlacementInfeasible, match=message):
        place(scene(*groups))
    assert time.process_time() - began < 1.0


def test_a_refusal_travels_between_processes() -> None:
    """What was proved survives the way from a worker."""
    refused = refusal(*IMPOSSIBLE["too narrow"][0])
    unpickled = pickle.loads(pickle.dumps(refused))

    assert (str(unpickled), unpickled.proved, unpickled.clash) == (str(refused), True, refused.clash)


def relation_to(actors: dict[str, Any], actor: Any, name: str, draw: Any) -> dict[str, Any]:
    """A relation of one member's group that the places found do keep."""
    other = actors[draw(st.sampled_from(sorted(set(actors) - {name})))]
    distance = math.hypot(actor.east_m - other.east_m, actor.north_m - other.north_m)
    bearing = math.degrees(math.atan2(actor.east_m - other.east_m, actor.north_m - other.north_m)) % 360.0
    slack = draw(st.sampled_from([0.01, 1.0, 20.0]))
    relation: dict[str, Any] = draw(
        st.sampled_from(
            [
                {"near": {"of": other.group, "min_m": max(0.0, distance - slack), "max_m": distance + slack}},
                {"away": {"of": other.group, "min_m": max(0.0, distance - slack), "max_m": distance + slack}},
                {"mean_distance": {"of": other.group, "mean_m": distance}},
                {"distances": [{"of": other.group, "min_m": max(0.001, distance - slack)}]},
                {
                    "bearing": {
                        "of": other.group,
                        "from_deg": (bearing - slack) % 360.0,
                        "to_deg": (bearing + slack) % 360.0,
                    }
                },
                {
                    # Half the diagonal of the largest asset, the apartment block, at any heading.
                    "region": corners(
                        *(actor.east_m - 11 - slack, actor.north_m - 11 - slack),
                        *(actor.east_m + 11 + slack, actor.north_m + 11 + slack),
                    )
                },
            ]
        )
    )
    return relation


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_what_is_possible_is_never_proved_impossible(data: st.DataObject) -> None:
    """Relations read off a scene that exists clash in no proof, however tightly they fit it."""
    names = ["a", "b", "c", "d"]
    assets = [data.draw(st.sampled_from(sorted(ASSETS))) for _ in names]
    free = [group(name, asset, separation_m=0.2) for name, asset in zip(names, assets, strict=True)]
    placed = place(scene(*free, seed=data.draw(st.integers(0, 10**6)))).realized
    assert placed is not None
    actors = {actor.group: actor for actor in placed.actors}
    bound = []
    for index, actor in enumerate(free):
        relations = (
            [relation_to(actors, actors[actor["id"]], actor["id"], data.draw) for _ in range(2)]
            if index
            else []
        )
        satisfied = {
            key: value
            for relation in relations
            for key, value in relation.items()
            if not (isinstance(value, dict) and value.get("of", "a") >= actor["id"])
            and not (key == "distances" and value[0]["of"] >= actor["id"])
        }
        bound.append({**actor, "placement": actor["placement"] | satisfied})
    intent = scene(*bound)
    assert faults(intent.model_copy(update={"realized": placed})) == []

    assert prove_infeasible(intent, placement_order(intent)) is None
