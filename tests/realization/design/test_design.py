"""Designs and what they make of a base SimSpec."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bench.documents import dump_json, parse_text, validate_document
from bench.errors import SetupError
from bench.realization import Design, realize
from bench.simspec import AgentSpec, SimSpec

PAPER: dict[str, Any] = parse_text((Path(__file__).parents[3] / "campaigns" / "paper.yaml").read_text())[0]
BASE = validate_document(PAPER["base"], SimSpec)
AGENTS = (AgentSpec(manifest="reference-naive"), AgentSpec(manifest="reference-bystander-aware"))


def design(*factors: dict[str, Any], **fields: Any) -> Design:
    return validate_document({"factors": list(factors), **fields}, Design)


FOG = {"name": "fog", "unit": "level", "levels": [0.0, 2, 4.5], "sets": ["environment.fog_level"]}
CROWD = {"name": "crowd", "levels": [2, 3], "sets": ["actors[houses].count"]}


def faults(*factors: dict[str, Any], **fields: Any) -> str:
    """What realizing such a design is refused with."""
    with pytest.raises(SetupError) as refusal:
        realize(BASE, design(*factors, **fields), AGENTS)
    return str(refusal.value)


def test_paper_experiment() -> None:
    """The paper's design: 72 combinations, of whose 216 pairs with a replicate 215 are drawn."""
    points = validate_document(PAPER["design"], Design)
    plans = realize(BASE, points, AGENTS[:1])

    assert len(points.points()) == 72
    assert len(plans) == 215
    assert len({(plan.design_point, plan.replicate) for plan in plans}) == 215
    assert len({plan.simspec.seeds.root for plan in plans}) == 215
    assert {plan.levels["approach"] for plan in plans} == {"N", "E", "S", "W"}
    west = next(plan for plan in plans if plan.levels["approach"] == "W")
    assert (west.simspec.vehicle.home.east_m, west.simspec.vehicle.home.heading_deg) == (-320.0, 90.0)
    assert west.simspec.group("civilians").density_per_km2 == west.levels["density"]
    members = {plan.simspec.group("civilians").member_count(BASE.world.area.area_m2) for plan in plans}
    assert members == {47, 59, 68}
    # Nobody else stands there: who is near a target follows from the paper's two factors.
    bystanders = {group.id for plan in plans for group in plan.simspec.actors if group.role == "bystander"}
    assert bystanders == {"civilians"}
    assert {plan.simspec.rules.no_mark_within_m for plan in plans} == {25.0}


def test_levels_reach_their_fields() -> None:
    """Every level stands where its path points, whole numbers stay whole, and the rest is the base."""
    plans = realize(BASE, design(FOG, CROWD), AGENTS[:1])

    values = [(plan.simspec.environment.fog_level, plan.simspec.group("houses").count) for plan in plans]
    assert values == [(0.0, 2), (0.0, 3), (2.0, 2), (2.0, 3), (4.5, 2), (4.5, 3)]
    assert [plan.id for plan in plans][:2] == ["p001-r1-reference-naive", "p002-r1-reference-naive"]
    assert all(plan.simspec.mission == BASE.mission and plan.simspec.name == plan.id for plan in plans)


def test_source_and_options_of_perception_are_factors() -> None:
    sources = ["truth", "simulated", "detector", "agent"]
    source = {"name": "source", "levels": sources, "sets": ["perception.source"]}
    floor = {"name": "floor", "levels": [0.3, 0.5], "sets": ["perception.detector_options.floor"]}
    with_floor = BASE.perception.model_copy(update={"detector_options": {"floor": 0.1}})
    plans = realize(BASE.model_copy(update={"perception": with_floor}), design(source, floor), AGENTS[:1])

    flown = [plan.simspec.perception for plan in plans]
    assert [perception.source for perception in flown[::2]] == sources
    assert [perception.detector_options for perception in flown[:2]] == [{"floor": 0.3}, {"floor": 0.5}]


def test_agents_share_their_scene() -> None:
    """All agents of one design point and replicate have the same seeds; other replicates have others."""
    plans = realize(BASE, design(FOG, replicates=2), AGENTS)

    roots = {(plan.design_point, plan.replicate, plan.simspec.seeds.root) for plan in plans}
    assert (len(plans), len(roots), len({root for *_, root in roots})) == (12, 6, 6)
    assert {plan.agent for plan in plans} == {"reference-naive", "reference-bystander-aware"}


def test_growing_reshuffles_nothing() -> None:
    """More replicates, and a larger draw, contain every earlier realization unchanged."""

    def scenes_of(**fields: Any) -> dict[str, str]:
        return {
            plan.id: dump_json(plan.simspec)
            for plan in realize(BASE, design(FOG, CROWD, seed=3, **fields), AGENTS)
        }

    assert scenes_of(replicates=2).items() <= scenes_of(replicates=5).items()
    drawn = scenes_of(replicates=4, method={"kind": "full_factorial", "take": 7})
    assert len(drawn) == 14
    assert drawn.items() <= scenes_of(replicates=4, method={"kind": "full_factorial", "take": 15}).items()


def test_seed_decides() -> None:
    """The same seed draws the same pairs and scenes, another one others."""

    def ids(seed: int) -> list[tuple[str, int]]:
        points = design(FOG, CROWD, seed=seed, replicates=9, method={"kind": "full_factorial", "take": 9})
        return [(plan.id, plan.simspec.seeds.root) for plan in realize(BASE, points, AGENTS)]

    assert ids(1) == ids(1)
    assert ids(1) != ids(2)


def test_seed_of_its_own_is_kept() -> None:
    """A stream that the base gives a seed of its own is the same in every realization."""
    pinned = BASE.model_copy(update={"seeds": BASE.seeds.model_copy(update={"motion": 5})})

    assert {plan.simspec.seeds.motion for plan in realize(pinned, design(FOG, replicates=2), AGENTS)} == {5}


def test_latin_hypercube_fills_its_strata() -> None:
    """Each of n equal strata of each range holds exactly one of n points; levels are even."""
    plan = design(
        {"name": "wind", "range": {"low": 0.0, "high": 10.0}, "sets": ["environment.wind.speed_mps"]},
        {"name": "trees", "range": {"low": 0, "high": 19, "integer": True}, "sets": ["actors[trees].count"]},
        FOG,
        method={"kind": "latin_hypercube", "points": 12},
    )
    points = [point.levels for point in plan.points()]

    assert sorted(int(float(levels["wind"]) / 10.0 * 12) for levels in points) == list(range(12))
    assert all(isinstance(levels["trees"], int) for levels in points)
    assert sorted([levels["fog"] for levels in points].count(level) for level in (0.0, 2, 4.5)) == [4, 4, 4]
    assert plan.points() == plan.points()


def test_one_by_one() -> None:
    """The first levels, then each other level alone."""
    points = design(FOG, CROWD, method={"kind": "one_by_one"})

    levels = [tuple(point.levels.values()) for point in points.points()]
    assert levels == [(0.0, 2), (2, 2), (4.5, 2), (0.0, 3)]


def test_no_factors_is_the_base_itself() -> None:
    """A design without factors flies the base, as often as it has replicates."""
    names = [plan.id for plan in realize(BASE, design(replicates=2), AGENTS[:1])]
    assert names == ["p001-r1-reference-naive", "p001-r2-reference-naive"]


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("environment.fog_levl", "fog_levl: environment has no field 'fog_levl' (did you mean fog_level?)"),
        ("actors[house].count", "actors has no member 'house' (did you mean houses?)"),
        ("actors[99].count", "actors has no member '99'"),
        ("environment[sky].fog_level", "environment is not a list"),
        ("environment.fog_level.deep", "environment.fog_level is a plain value"),
        ("actors[cars].placement.near.max_m", "actors[6].placement.near is not given in the base SimSpec"),
        ("environment..fog_level", "'' is not a step of a path"),
        ("seeds.root", "seeds.root is written by realization itself"),
        ("agent.options.gain", "agent is written by realization itself"),
    ],
)
def test_paths_that_lead_nowhere(path: str, message: str) -> None:
    """A path that is wrong is named with its factor, what is wrong and the mend."""
    said = faults(FOG | {"sets": [path], "unit": None})
    assert f"factor 'fog': path {path}: " in said
    assert message in said


MURK = {"name": "murk", "levels": [0.01, 0.02], "sets": ["perception.model.fog_extinction_per_m"]}
BOTH = {"name": "both", "levels": [60.0, 90.0], "sets": ["mission.altitude_m", "mission.time_limit_s"]}
HEIGHT = {"name": "height", "levels": [60.0, 110.0], "sets": ["mission.altitude_m"]}
CEILING = {"name": "ceiling", "levels": [120.0, 80.0], "sets": ["rules.max_altitude_m"]}
PLACES = {"N": {"vehicle.home": {"east_m": 0.0, "north_m": 9.0}}}
HOME = {"name": "home", "levels": ["N"], "patches": PLACES}
TURNED = {"name": "turned", "levels": [0.0, 90.0], "sets": ["vehicle.home.heading_deg"]}


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ([FOG | {"unit": "m"}], "factor 'fog': path environment.fog_level: the factor's unit is 'm'"),
        # One per metre is no metre; a share has no unit; one number cannot be metres and seconds.
        ([MURK | {"unit": "m"}], "the field's unit is '1/m'"),
        ([CROWD | {"unit": "m"}], 'but the field has none (leave the unit out or write unit: "1"'),
        ([BOTH], "sets fields of different units: mission.altitude_m (m), mission.time_limit_s (s)"),
        ([BOTH | {"unit": "m"}], "the factor's unit is 'm', the field's unit is 's'"),
        # Right alone, but not together.
        ([HEIGHT, CEILING], "design point p004 (height=110.0, ceiling=80.0)"),
        # Two factors on one field, however each writes its path.
        (
            [CROWD, CROWD | {"name": "again", "sets": ["actors[3].count"]}],
            "is set by the factors crowd, again",
        ),
        ([HOME, TURNED], "is set by the factors turned, home"),
    ],
)
def test_units_and_levels_that_clash_are_refused(factors: list[dict[str, Any]], message: str) -> None:
    assert message in faults(*factors)


def test_the_unit_of_the_field_fits() -> None:
    assert realize(BASE, design(MURK | {"unit": "1/m"}), AGENTS)


def test_levels_that_do_not_fit() -> None:
    """A level out of bounds or of a wrong type names factor, level, path and bounds; all come together."""
    message = faults(FOG | {"levels": [12.0]}, CROWD | {"levels": ["many"]})

    assert "factor 'fog': level 12.0 for environment.fog_level" in message
    assert "less than or equal to 9" in message
    assert "factor 'crowd': level 'many' for actors[houses].count" in message


def test_agents_need_names_of_their_own() -> None:
    """No agents, two of one name, and a name too long for an id are refused."""
    for agents, message in (
        ((), "no agent is given"),
        ((AGENTS[0], AGENTS[0]), "two agents are called 'reference-naive'"),
        ((AgentSpec(manifest="a" * 41),), "more than 40 characters"),
    ):
        with pytest.raises(SetupError, match=message):
            realize(BASE, design(FOG), agents)


def test_pairs_of_fidelities_share_their_scene() -> None:
    """A point flown at high fidelity has the seeds of its twin at low; formulas reach their fields."""
    factors = [
        {"name": "rate", "levels": [2.0, 5.0], "sets": ["vehicle.camera.rate_hz"]},
        {"name": "wind", "range": {"low": 0.0, "high": 8.0}, "sets": ["environment.wind.speed_mps"]},
        {"name": "gusts", "formula": "wind / 2", "unit": "m/s", "sets": ["environment.wind.turbulence_mps"]},
    ]
    plans = realize(
        BASE,
        design(*factors, method={"kind": "nested", "points": 6, "high": 3, "fidelity": "rate"}, replicates=2),  # type: ignore[arg-type]
        AGENTS[:1],
    )

    low = {(plan.levels["wind"], plan.replicate): plan for plan in plans if plan.levels["rate"] == 2.0}
    high = [plan for plan in plans if plan.levels["rate"] == 5.0]
    assert (len(low), len(high)) == (12, 6)
    for plan in high:
        twin = low[plan.levels["wind"], plan.replicate].simspec
        assert plan.simspec.seeds == twin.seeds
        assert (plan.simspec.vehicle.camera.rate_hz, twin.vehicle.camera.rate_hz) == (5.0, 2.0)
    wind = plans[0].simspec.environment.wind
    assert wind.turbulence_mps == wind.speed_mps / 2
    assert len({plan.simspec.seeds.root for plan in plans}) == 12


def test_inactive_factors_change_nothing() -> None:
    """Where its condition fails a conditional factor leaves the base alone."""
    rain = {"name": "rain", "levels": [2.0, 3.0], "when": "fog > 1", "sets": ["environment.rain_level"]}
    plans = realize(BASE, design(FOG, rain), AGENTS[:1])

    values = [(plan.simspec.environment.fog_level, plan.simspec.environment.rain_level) for plan in plans]
    assert values == [(0.0, BASE.environment.rain_level), (2.0, 2.0), (2.0, 3.0), (4.5, 2.0), (4.5, 3.0)]
