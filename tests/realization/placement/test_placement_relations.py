"""Relations of all kinds, by the scenes of `yards.yaml`: kept where they can be, or found broken."""

from __future__ import annotations

import pickle
from typing import Any

import pytest
from yards import YARDS, corners, faults, group, scene, written

from bench.errors import SetupError
from bench.realization import PlacementInfeasible, place
from bench.realization.placement._placement import placement_order, with_places
from bench.realization.placement.proofs._proof import prove_infeasible
from bench.realization.placement.search._solver import solve_placement
from bench.simspec import SimSpec, factor_values


@pytest.mark.parametrize("name", YARDS["kept"])
def test_relations_are_kept(name: str) -> None:
    """Sampling and the solver alike find what the independent check accepts, and the same again."""
    for seed in range(2):
        wanted = scene(*written(YARDS["kept"][name]), seed=seed)
        assert faults(place(wanted)) == []
        placed = solve_placement(wanted, placement_order(wanted))
        assert placed is not None
        assert faults(with_places(wanted, placed, "cp-sat")) == []
    assert place(wanted) == place(wanted)


@pytest.mark.parametrize("name", YARDS["hard"])
def test_the_solver_finds_what_chance_does_not(name: str) -> None:
    """Hosts wait for those to whom their guests relate; guests are tried in rows, turned as required."""
    wanted = scene(*written(YARDS["hard"][name]))
    placed = solve_placement(wanted, placement_order(wanted))
    assert placed is not None
    assert faults(with_places(wanted, placed, "cp-sat")) == []


def test_guests_need_no_ground_of_their_own() -> None:
    """A yard that its houses fill has room for those in them: areas of guests are not added."""
    yard = corners(0, 0, 30, 30)
    houses = group("houses", "house", 5, region=yard, separation_m=0.1)
    crates = group("crates", "crate", 15, inside={"of": "houses"}, region=yard)
    assert faults(place(scene(houses, crates))) == []


@pytest.mark.parametrize("case", YARDS["broken"], ids=lambda case: f"{case['scene']}: {case['says']}")
def test_check_finds_what_is_broken(case: dict[str, Any]) -> None:
    """One actor moved or turned, and the check names it."""
    sound = place(scene(*written(YARDS["kept"][case["scene"]])))
    assert sound.realized is not None
    members = {member.id: member for member in sound.realized.actors}
    moved = dict(case["moved"])
    if "turn" in moved:
        moved = {"heading_deg": (members[case["actor"]].heading_deg + moved["turn"]) % 360.0}
    if "like" in moved:
        like = members[moved["like"]]
        moved = {"east_m": like.east_m + moved["by"], "north_m": like.north_m}
    members[case["actor"]] = members[case["actor"]].model_copy(update=moved)
    realized = sound.realized.model_copy(update={"actors": tuple(members.values())})

    assert faults(sound) == []
    assert case["says"] in "\n".join(faults(sound.model_copy(update={"realized": realized})))


@pytest.mark.parametrize(
    ("east_m", "north_m", "between"),
    [(57.0, 43.9, True), (61.0, 43.0, False), (39.0, 43.0, False), (50.0, 44.1, False)],
)
def test_between_ends_at_the_two(east_m: float, north_m: float, between: bool) -> None:
    """Behind one of the two is not between them, however near to it."""
    first, second = (
        group(name, "crate", at={"east_m": e, "north_m": 40}) for name, e in (("a", 40), ("b", 60))
    )
    child = group("c", "child", between={"first": "a", "second": "b", "within_m": 4})
    placed = place(scene(first, second, child))
    assert placed.realized is not None
    *ends, actor = placed.realized.actors
    moved = actor.model_copy(update={"east_m": east_m, "north_m": north_m})
    realized = placed.realized.model_copy(update={"actors": (*ends, moved)})
    said = "\n".join(faults(placed.model_copy(update={"realized": realized})))
    assert ("is not between" not in said) is between


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
    assert {len(one.realized.actors) for one in placed if one.realized} == set(range(3, 10))
    assert [fault for one in placed for fault in faults(one)] == []
    densities = [
        factor_values(one)["bystander_density_per_km2"]
        for one in (placed[0], scene(group("people", "civilian", 3, role="bystander")))
    ]
    assert densities[0] == densities[1]


def test_a_range_leaves_the_places_alone() -> None:
    """A drawn number of members stands where the same number, written, would stand."""
    drawn = place(scene(group("people", "civilian", {"low": 3, "high": 9}))).realized
    assert drawn is not None
    assert drawn == place(scene(group("people", "civilian", len(drawn.actors)))).realized


@pytest.mark.parametrize("case", YARDS["nonsense"], ids=lambda case: case["says"])
def test_nonsense_is_refused(case: dict[str, Any]) -> None:
    """What the author must mend is a fault with its field."""
    with pytest.raises(SetupError, match=case["says"]):
        place(scene(*written(case["groups"])))


def refusal(name: str) -> PlacementInfeasible:
    with pytest.raises(PlacementInfeasible) as refused:
        place(scene(*written(YARDS["impossible"][name]["groups"])))
    return refused.value


def in_full(field: str) -> str:
    """`g.near` as the refusal names it."""
    name, _, rest = field.partition(".")
    return field if name == "world" else f"actors[{name}].{rest if rest == 'count' else f'placement.{rest}'}"


@pytest.mark.parametrize("name", YARDS["impossible"])
def test_the_smallest_clash_is_named(name: str) -> None:
    """What is impossible is proved so, with just the fields that clash."""
    refused = refusal(name)
    fields = {in_full(field) for field in YARDS["impossible"][name]["clash"]}

    assert refused.proved
    assert set(refused.clash) == fields
    if "and proved so" in str(refused):  # else what is said of areas, in words of its own
        assert all(field in str(refused) for field in fields)


@pytest.mark.parametrize("dropped", ["a", "b"])
def test_a_clash_needs_each_of_its_groups(dropped: str) -> None:
    """With either of two groups that share ground left out, nothing is proved; trees never mattered."""
    crowded = YARDS["impossible"]["too many for a shared region"]
    rest = scene(*(actor for actor in written(crowded["groups"]) if actor["id"] != dropped))

    assert prove_infeasible(rest, placement_order(rest)) is None
    assert not any(field.startswith("c.") for field in crowded["clash"])


def test_a_refusal_travels_between_processes() -> None:
    """What was proved survives the way from a worker."""
    refused = refusal("too narrow")
    unpickled = pickle.loads(pickle.dumps(refused))

    assert (str(unpickled), unpickled.proved, unpickled.clash) == (str(refused), True, refused.clash)
