"""Whose a number is: no number, clause or word of a text becomes a field that its own clause does not state."""

from __future__ import annotations

import re
from typing import Any

import pytest

from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose

VOCABULARY = load_vocabulary()


def values(result: BaseSimSpec) -> dict[str, Any]:
    return {receipt.path: receipt.value for receipt in result.receipts}


def listed(result: BaseSimSpec) -> str:
    """What is listed or left open, as one text."""
    unread = [passage.quote for passage in (*result.not_understood, *result.not_expressible)]
    return " | ".join([*unread, *(choice.quote for choice in result.choices)])


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("A shed. Meet us at house number 14.", "14"),
        ("A radar. Turn left at house no. 31.", "31"),
        ("The boy who ran away is nine. A truck.", "nine"),
        ("A truck. The missing child, who wears red, was eight.", "eight"),
        ("One girl is missing, she has 7 years. A truck.", "7"),
        ("A truck. A boy is missing; he has 11 years.", "11"),
        ("A truck and two kids. Is not Jim already 13 now.", "13"),
        ("A radar. Our neighbour is 2nd Company.", "2nd"),
        ("A radar. The driver belongs to 14th Brigade.", "14th"),
    ],
)
def test_a_name_an_age_and_an_ordinal_count_nobody(text: str, number: str) -> None:
    """Such a number is the count of no group, and is listed."""
    result = read_prose(text, VOCABULARY)
    worded = {"seven": 7, "eight": 8, "nine": 9}
    figure = worded.get(number) or int(re.sub(r"\D", "", number))
    counts = [value for path, value in values(result).items() if path.endswith(".count")]
    assert figure not in counts
    assert number in listed(result)


@pytest.mark.parametrize(
    ("text", "path", "count"),
    [
        ("A radar. Soldiers: 4.", "actors[soldier].count", 4),
        ("Trucks, 3, on the road.", "actors[truck].count", 3),
        ("Near a shed stand civilians, nine in number.", "actors[civilian].count", 9),
        ("There are houses here, of which there are 6.", "actors[house].count", 6),
    ],
)
def test_a_number_that_says_how_many_is_a_count(text: str, path: str, count: int) -> None:
    """After a plural and a stop mark, or after words that count."""
    assert values(read_prose(text, VOCABULARY))[path] == count


@pytest.mark.parametrize(
    "text",
    [
        "Last time we flew at 90 m.",
        "On the previous flight it flew at 45 m.",
        "Yesterday the drone searched at 75 m and 7 m/s.",
        "Spend no more than 15 seconds at a stretch over any person.",
        "To linger is wrong: at most 20 s, Peter said, over a pedestrian.",
        "The gardening seed shall be 43.",
        "Zebra crossing, at 6 m/s.",
    ],
)
def test_a_value_without_a_subject_is_left_out(text: str) -> None:
    """A value of another occasion, of persons' time, or among unknown words sets no field, and is visible."""
    before, result = (
        read_prose("A drone. A truck.", VOCABULARY),
        read_prose(f"A drone. A truck. {text}", VOCABULARY),
    )
    different = {path for path, value in values(result).items() if values(before).get(path) != value}
    assert {path for path in different if path.startswith(("mission", "seeds", "intelligence"))} == set()
    assert not result.complete


@pytest.mark.parametrize(
    "text",
    [
        "The vehicle shall not mark a target while a bystander is within 90 m of it.",
        "No flight goes over the yard while a pedestrian is within 40 m.",
        "It must not shine its lamp while some civilians are near the truck.",
    ],
)
def test_a_condition_of_a_rule_places_nobody(text: str) -> None:
    """What is said of the time in which something is forbidden is no group."""
    result = read_prose(f"A truck. {text}", VOCABULARY)
    assert {actor.role for actor in result.simspec.actors} == {"adversary"}
    assert not result.complete or result.simspec.rules.no_mark_within_m is not None


@pytest.mark.parametrize("clause", ["where the cars drive", "where these cars walk about"])
def test_where_somebody_drives_sets_no_motion(clause: str) -> None:
    """A clause that tells which place is meant is no statement about its subject."""
    result = read_prose(f"Three cars. A soldier beside the road {clause}.", VOCABULARY)
    assert values(result).get("actors[car].motion.kind", "still") == "still"
    assert clause in listed(result)


@pytest.mark.parametrize(
    "text", ["Say hello to the kids.", "Kind regards to the soldiers.", "Greetings to the children."]
)
def test_who_is_greeted_is_not_in_the_scene(text: str) -> None:
    """A greeting places nobody."""
    assert [actor.asset for actor in read_prose(f"A tree. {text}", VOCABULARY).simspec.actors] == ["tree"]


@pytest.mark.parametrize(
    "text",
    [
        "A radar. Quick chat before our lunch at 12, with error bars of 4 m.",
        "Slow wandering error has a standard deviation of 4 m. The GPS zigzags, error of my 3 m.",
    ],
)
def test_every_number_lies_in_a_clause_that_is_shown(text: str) -> None:
    """No clause ends before the last word that belongs to it."""
    result = read_prose(text, VOCABULARY)
    for number in re.finditer(r"\d+", text):
        assert any(clause.start <= number.start() < clause.end for clause in result.clauses), number.group()


@pytest.mark.parametrize(
    ("text", "kinds"),
    [
        ("One enemy radar vehicle.", {"radar": 1}),
        ("A hostile radar vehicle and a shed.", {"radar": 1, "shed": 1}),
        ("One enemy mobile radar.", {"radar": 1}),
        ("A truck of the other side.", {"truck": 1}),
    ],
)
def test_an_adjective_leaves_a_name_of_two_words_whole(text: str, kinds: dict[str, int]) -> None:
    """`enemy` before a thing of two words is no thing of its own."""
    result = read_prose(text, VOCABULARY)
    assert {actor.id: actor.count for actor in result.simspec.actors} == kinds
    assert result.complete


@pytest.mark.parametrize(
    ("text", "height_m"),
    [("Fly at 80 m above home.", 80.0), ("The mission height shall be 75 m above the start.", 75.0)],
)
def test_a_height_above_home_is_the_height_of_the_mission(text: str, height_m: float) -> None:
    """It is no lowest height."""
    result = read_prose(text, VOCABULARY)
    assert result.simspec.mission.altitude_m == height_m
    assert result.simspec.rules.min_altitude_m is None or result.simspec.rules.min_altitude_m == 0.0


@pytest.mark.parametrize(
    "text", ["A street 7 m wide. Five houses line it.", "A road. Five sheds line the road."]
)
def test_what_lines_a_road_stands_beside_it(text: str) -> None:
    """The verb is read, and no house stands on the road."""
    [actor] = read_prose(text, VOCABULARY).simspec.actors
    assert actor.placement.along is not None
    assert actor.placement.along.where == "beside"


@pytest.mark.parametrize(
    ("text", "rules"),
    [
        (
            "The drone may not fly above 85 m, and it must not be under 20 m either, apart from take-off and landing.",
            (85.0, 20.0),
        ),
        ("It shall never fly higher than 95 m nor lower than 35 m above home.", (95.0, 35.0)),
        ("Never fly below 45 m except start and landing, never above 100 m.", (100.0, 45.0)),
    ],
)
def test_rules_that_go_on_are_read_one_by_one(text: str, rules: tuple[float, float]) -> None:
    """After `and`, `nor` and a comma, and with the exception that every lowest height has."""
    result = read_prose(f"A radar. {text}", VOCABULARY)
    assert (result.simspec.rules.max_altitude_m, result.simspec.rules.min_altitude_m) == rules
    assert result.complete


@pytest.mark.parametrize(
    "text",
    [
        "The vehicle shall not mark a target while a bystander is within 65 m of it.",
        "The UAV must not mark a truck if a person is closer than 65 m.",
    ],
)
def test_a_rule_is_read_wherever_it_stands(text: str) -> None:
    """Also behind other sentences, which give `it` something to mean."""
    for before in ("", "A radar. ", "A house and a truck. Light rain. "):
        assert read_prose(before + text, VOCABULARY).simspec.rules.no_mark_within_m == 65.0


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("The operator link shall be down from 110 s to 150 s.", "outages[0].duration_s", 40.0),
        ("At 70 s the radio to the operator is out for 20 s.", "outages[0].at_s", 70.0),
        (
            "A truck. A report on the truck reaches the UAV at t=95 s.",
            "intelligence[truck-sighting].delivered_s",
            95.0,
        ),
        (
            "A truck. The report on it is good to a radius of 130 m.",
            "intelligence[truck-sighting].uncertainty_m",
            130.0,
        ),
        ("Mission ends t=410 s.", "mission.time_limit_s", 410.0),
        ("GPS jammed after 90 s for 20 s.", "vehicle.failures[0].at_s", 90.0),
    ],
)
def test_a_time_of_the_mission_is_no_condition(text: str, path: str, value: float) -> None:
    """`after 90 s` tells when, and events have plain words."""
    assert values(read_prose(text, VOCABULARY))[path] == value


def test_one_fault_in_many_clauses_is_left_out_at_once() -> None:
    """The readings of a text do not grow with the number of times that it says the same impossible thing."""
    result = read_prose("Fog level 12. " * 300, VOCABULARY)
    assert len(result.not_understood) == 300


@pytest.mark.parametrize(
    ("text", "field", "value"),
    [
        ("It shall not fly faster than 5 m/s within 40 m of a bystander.", "bystander_slow_mps", 5.0),
        ("The drone must not exceed 4 m/s within 30 m of any person.", "bystander_slow_mps", 4.0),
        ("It shall not stay above one bystander for longer than 12 s.", "max_loiter_over_bystander_s", 12.0),
    ],
)
def test_a_rule_near_people_is_no_general_limit_and_places_nobody(
    text: str, field: str, value: float
) -> None:
    """A speed or a time near people stays with them."""
    result = read_prose(f"A truck. {text}", VOCABULARY)
    assert getattr(result.simspec.rules, field) == value
    assert [actor.id for actor in result.simspec.actors] == ["truck"]
    assert result.simspec.mission.time_limit_s == 300.0


@pytest.mark.parametrize(
    "text", ["The operator says to the drone it shall come back.", "We told it to please come back home."]
)
def test_an_order_without_its_time_is_no_setting(text: str) -> None:
    """Nothing is set of the mission, and the order is listed."""
    result = read_prose(f"A truck. {text}", VOCABULARY)
    assert "mission.return_home" not in {
        receipt.path for receipt in result.receipts if receipt.source == "prose"
    }
    assert not result.complete


BOX_60_TO_120_W = [(-120, -80), (-60, -80), (-60, -20), (-120, -20)]
SOLDIERS = "Two soldiers and a radar. "


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        # A bound is turned around by the denial before it.
        (SOLDIERS + "No soldier is nearer than 40 m to the radar.", {"placement.distances[0].min_m": 40}),
        (
            "A radar. Two soldiers, none of them within 60 m of the radar.",
            {"placement.distances[0].min_m": 60},
        ),
        ("A radar. Two soldiers, none further than 60 m from the radar.", {"placement.near.max_m": 60}),
        (
            "A radar. Two soldiers at least 20 m and at most 70 m away from the radar.",
            {"placement.near.min_m": 20, "placement.near.max_m": 70},
        ),
        ("Four soldiers, no two closer than 15 m to each other.", {"placement.spread_m": 15}),
        ("Four soldiers keep minimum 12 m distance between each other.", {"placement.spread_m": 12}),
        ("Not less than 5 and not more than 9 soldiers.", {"count": 5}),
        # A distance with a direction leaves a narrow sector.
        (
            "A soldier 200 m south of home.",
            {"placement.bearing.from_deg": 174.3, "placement.near.max_m": 220},
        ),
        # A distance with a bearing is a place.
        (
            "Home is at (10, 0). A soldier at a distance of 100 m and a bearing of 90 degrees from home.",
            {"placement.at.east_m": 110, "placement.at.north_m": 0},
        ),
        (
            "A radar. A soldier 100 m and a bearing of 30 degrees from the radar.",
            {"placement.bearing.from_deg": 24.3},
        ),
        # Steps from home are places: home is named once.
        (
            "Home is at (10, 0). A soldier patrols between a point 50 m east and a point 80 m north of home.",
            {"motion.route[0].east_m": 60, "motion.route[0].north_m": 0, "motion.route[1].north_m": 80},
        ),
    ],
)
def test_where_soldiers_stand(text: str, fields: dict[str, float]) -> None:
    """Each with the numbers of its own clause, and nothing is left open."""
    result = read_prose(text, VOCABULARY)
    read = values(result)
    assert {name: read.get(f"actors[soldier].{name}") for name in fields} == fields
    assert not result.not_understood


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("Four (4) to six (6) crates.", {"crate.count": 4}),
        ("7 till 9 crates, 35 until 45 m from home.", {"crate.count": 7, "crate.placement.near.min_m": 35, "crate.placement.near.max_m": 45}),
        ("Two trees line the road, six houses on its side.", {"tree.placement.along.where": "beside", "house.placement.along.where": "beside"}),
        ("Two cars along the road, parked. Six houses along the road.", {"car.placement.along.where": "on", "house.placement.along.where": "beside"}),
        ("Two cars, parked along the road. A truck drives along the road.", {"car.placement.along.where": "beside", "truck.placement.along.where": "on"}),
        ("Two trucks drive at walking pace. Two cars drive at 5 m/s.", {"truck.motion.speed_mps": 1.2, "car.motion.speed_mps": 5}),
        ("Two trucks under cam nets (c = 0.6). A radar, camo at about 80 percent.", {"truck.concealment": 0.6, "radar.concealment": 0.8}),
        ("Two houses. Two soldiers in one house.", {"house.count": 2, "soldier.placement.inside.of": "house"}),
        ("Two trucks and a hiker. The trucks have to be found. The hiker has to be found.", {"truck.role": "adversary", "civilian.role": "sought"}),
        ("A radar. Two crates. Each crate within 20 m of the radar.", {"crate.placement.near.max_m": 20}),
    ],
)  # fmt: skip
def test_general_forms_of_groups(text: str, fields: dict[str, Any]) -> None:
    """Numbers that are written twice, ranges with `till`, sides of a road, paces, shares of concealment."""
    result = read_prose(text, VOCABULARY)
    read = values(result)
    assert {path: read.get(f"actors[{path.replace('.', '].', 1)}") for path in fields} == fields
    assert not result.choices


@pytest.mark.parametrize(
    ("text", "quote"),
    [
        ("Two trucks. Each truck has a civilian near it.", "Each truck"),
        ("A hiker is missing. A second truck waits.", "A second"),
        ("The village, centre 250 m N of launch. A radar.", "centre 250 m"),
        ("Four trucks until 5 soldiers come.", "until"),
    ],
)
def test_what_these_forms_do_not_tell_is_listed(text: str, quote: str) -> None:
    """Members to each, a second of its kind, and ground without a size are left open."""
    assert quote in listed(read_prose(text, VOCABULARY))


@pytest.mark.parametrize(
    ("text", "path", "corners"),
    [
        ("No flight over the school, 60 to 120 m west and 20 to 80 m south of home.", "rules.no_fly[school].area", BOX_60_TO_120_W),
        ("No-fly zone: box 60 to 120 m west, 20 to 80 m south of home.", "rules.no_fly[no-fly].area", BOX_60_TO_120_W),
        ("Two soldiers inside the village, an area from 60 to 120 m west and 20 to 80 m south of home.", "world.areas[village]", BOX_60_TO_120_W),
        ("A search box 300 m on a side.", "world.area", [(-150, -150), (150, -150), (150, 150), (-150, 150)]),
        ("Search area 500 x 300.", "world.area", [(-250, -150), (250, -150), (250, 150), (-250, 150)]),
        ("Stay inside a square of 200 m, centred on home.", "rules.geofence", [(-100, -100), (100, -100), (100, 100), (-100, 100)]),
        ("Home is at (10, 0). A radar in sector DELTA, 40 by 20 m centred on the launch point.", "world.areas[sector-delta]", [(-10, -10), (30, -10), (30, 10), (-10, 10)]),
        ("A village of 200 by 100 m, centre 250 m N of launch. Two houses in the village.", "world.areas[village]", [(-100, 200), (100, 200), (100, 300), (-100, 300)]),
        ("A radar in the middle of a field of 60 by 30 m. The area is 300 by 300 m.", "actors[radar].placement.region", [(-10, -5), (10, -5), (10, 5), (-10, 5)]),
        ("The area is 300 by 200 m, around the radar there are five civilians.", "world.area", [(-150, -100), (150, -100), (150, 100), (-150, 100)]),
    ],
)  # fmt: skip
def test_where_ground_lies(text: str, path: str, corners: list[tuple[float, float]]) -> None:
    """A box by its ranges east and north, and a square by its side."""
    read = values(read_prose(text, VOCABULARY))
    points = [(read[f"{path}.corners[{index}].east_m"], read[f"{path}.corners[{index}].north_m"]) for index in range(4)]  # fmt: skip
    assert points == corners


def test_the_times_of_a_no_fly_zone_are_its_own() -> None:
    """A time in a later sentence about something else is none of it, and it ends when it opens for flight."""
    zone = "No-fly zone with corners (20,0), (50,0), (50,50)"
    [read] = read_prose(f"{zone}, opens for flight after 90 s.", VOCABULARY).simspec.rules.no_fly
    assert (read.from_s, read.until_s) == (0.0, 90.0)
    result = read_prose(f"{zone}. A radar. The lamp is on after 20 s.", VOCABULARY)
    assert (result.simspec.rules.no_fly[0].from_s, result.simspec.rules.no_fly[0].until_s) == (0.0, None)
    assert "after 20 s" in listed(result)


@pytest.mark.parametrize(
    ("text", "rest", "share"),
    [
        ("Ten soldiers, half of them within 50 m of home, the other half at least 200 m from home.", (5, "min_m 200.0"), (5, "max_m 50.0")),
        ("Nine soldiers: a third of them walk, the rest stand still.", (6, "kind still"), (3, "kind wander")),
        ("Three soldiers, one of them camouflaged, the other two in the open.", (2, "concealment 0.0"), (1, "concealment 1.0")),
        ("Eight soldiers. Two of the soldiers patrol.", (6, "role adversary"), (2, "kind wander")),
        ("Three quarters of the eight soldiers are parked and the others walk.", (2, "kind wander"), (6, "kind still")),
    ],
)  # fmt: skip
def test_a_share_is_a_group_of_its_own(text: str, rest: tuple[int, str], share: tuple[int, str]) -> None:
    """Each part has its number and what is said of it, and not what is said of the other."""
    result = read_prose(text, VOCABULARY)
    told = [[f"{path.rpartition('.')[2]} {value}" for path, value in values(result).items() if f"[{actor.id}]" in path] for actor in result.simspec.actors]  # fmt: skip
    assert [actor.count for actor in result.simspec.actors] == [rest[0], share[0]]
    assert rest[1] in told[0]
    assert share[1] in told[1]
    assert share[1] not in told[0]
    assert not result.not_understood


@pytest.mark.parametrize(
    ("text", "quote"),
    [
        ("Nine soldiers, half of them walk.", "half of them"),
        ("Some soldiers, one of which is camouflaged.", "one of which"),
        ("Eight soldiers within 60 m of two trucks, one of which is camouflaged.", "one of which"),
        ("Eight soldiers within 60 m of two trucks, one of them is camouflaged.", "one of them"),
        ("Four soldiers, two of them, says Ann.", "two of them"),
        ("Five soldiers. A third soldier walks.", "A third soldier"),
        ("Five soldiers. The others walk.", "The others"),
    ],
)
def test_a_share_that_is_not_plain_divides_nobody(text: str, quote: str) -> None:
    """Of which group, how many, what of them: where one is open, the clause is listed and the group whole."""
    result = read_prose(text, VOCABULARY)
    assert [actor.asset for actor in result.simspec.actors if actor.role == "adversary"] in (["soldier"], ["soldier", "military-truck"])  # fmt: skip
    assert all(actor.concealment == 0.0 and actor.motion.kind == "still" for actor in result.simspec.actors)
    assert quote in listed(result)


def test_all_of_a_divided_group() -> None:
    """`Everyone` means its parts, and so does its name; a number counts them together."""
    text = "A radar. Nine civilians, a third of them children, and everyone stays within 80 m of the radar."
    result = read_prose(text, VOCABULARY)
    near = {actor.asset: actor.placement.near for actor in result.simspec.actors if actor.role == "bystander"}
    assert {asset: relation and relation.max_m for asset, relation in near.items()} == {"civilian": 80.0, "child": 80.0}  # fmt: skip
    result = read_prose("Six soldiers, two of them walk. The six soldiers are camouflaged.", VOCABULARY)
    assert [actor.concealment for actor in result.simspec.actors] == [1.0, 1.0]


@pytest.mark.parametrize(
    ("text", "roles"),
    [
        ("Missing: one girl. Twenty children near a house.", {"child": "sought", "child-2": "bystander", "house": "clutter"}),
        ("We search for a lost hiker. Three hikers walk.", {"civilian": "sought", "civilian-2": "bystander"}),
        ("Two bathers missing. Five aid workers.", {"civilian": "sought", "aid-worker": "bystander"}),
        ("A radar. A soldier is overdue.", {"radar": "adversary", "soldier": "sought"}),
        ("A truck, missing. Two persons.", {"truck": "adversary", "civilian": "bystander"}),
    ],
)  # fmt: skip
def test_who_is_missing_is_sought(text: str, roles: dict[str, str]) -> None:
    """Persons only, and only those of whom it is said."""
    result = read_prose(text, VOCABULARY)
    assert {actor.id: str(actor.role) for actor in result.simspec.actors} == roles
    assert ("missing" in listed(result)) == ("truck" in roles)


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("A truck, sighting 4 min old when the report is delivered; error radius 120 m. A radar: report at start, error radius 60 m.", {"truck-sighting.latency_s": 240, "truck-sighting.uncertainty_m": 120, "radar-sighting.uncertainty_m": 60, "radar-sighting.delivered_s": 0}),
        ("A radar. The radar sighting is passed at t=40 s.", {"radar-sighting.delivered_s": 40}),
        ("A skier is missing. A report on the skier comes in at 75 s, search radius 90 m.", {"civilian-sighting.delivered_s": 75, "civilian-sighting.uncertainty_m": 90}),
        ("Two soldiers and a radar. The first report is about the radar, it is there at take-off, priority 2.", {}),
        ("A truck. Two reports. The first one is about the truck, it is there from the start, and it has priority 2.", {"truck-sighting.delivered_s": 0, "truck-sighting.priority": 2}),
    ],
)  # fmt: skip
def test_what_a_report_tells(text: str, fields: dict[str, float]) -> None:
    """Its numbers belong to the group of its own sentence, and those of two reports do not mix."""
    read = {
        path: value for path, value in values(read_prose(text, VOCABULARY)).items() if path.startswith("int")
    }
    assert {name: read.get(f"intelligence[{name.replace('.', '].')}") for name in fields} == fields


@pytest.mark.parametrize(
    ("text", "quote"),
    [
        ("Three adults wait at the car park.", "car park"),
        ("A radar. The report was written by a farmer.", "by a farmer"),
        ("A radar. House number 12 is near.", "House number"),
        ("Ten soldiers. A lifeboat waits half a mile out.", "lifeboat"),
        ("A resident of 81 is missing.", "81"),
        ("A radar, reported before launch.", "reported before launch"),
        ("A truck. The speed limit on the lane is 50 km/h. Three soldiers.", "on the lane"),
    ],
)
def test_nothing_that_is_known_is_passed_over(text: str, quote: str) -> None:
    """A phrase of which nobody made anything is listed; a stranger's sentence says nothing of a group before it."""
    result = read_prose(text, VOCABULARY)
    assert quote in listed(result) or "intelligence[radar-sighting].delivered_s" in values(result)
    for actor in result.simspec.actors:
        assert actor.placement.near is None
        assert actor.count in (1, 3, 10)


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("For test 33 I need the following: a lane, 300 m long, straight from home to the north, with four sheds beside it.", {"world.roads[road].points[1].north_m": 300, "world.roads[road-2].width_m": None, "actors[shed].placement.near.of": None, "actors[shed].placement.along.where": "beside"}),
        ("Six sheds beside the road with a gap of 3 m to 12 m, parallel to it within 5 degrees.", {"actors[shed].placement.along.at_least_m": 3, "actors[shed].placement.along.within_m": 12, "actors[shed].placement.along.parallel_deg": 5}),
        ("A road. A shed beside the road, at most 6 m from the edge.", {"actors[shed].placement.along.within_m": 6}),
        ("A shed hidden from an eye 2 m above home.", {"actors[shed].placement.hidden_from.of": "home", "actors[shed].placement.hidden_from.height_m": 2}),
        ("Ten soldiers stroll around at 1.4 m/s, each within 30 m of where he started.", {"actors[soldier].motion.radius_m": 30, "actors[soldier].placement.near.of": None}),
        ("In this situation is one radar and around it are three soldiers.", {"actors[soldier].placement.inside.of": None, "actors[soldier].placement.near.of": "radar"}),
        ("A radar. Four soldiers, all in 100 m from it maximal.", {"actors[soldier].placement.near.max_m": 100, "actors[soldier].placement.near.min_m": 0}),
        ("A soldier in a house. Four sheds in the near of the house, between 25 and 60 m.", {"actors[shed].placement.near.min_m": 25, "actors[shed].placement.near.max_m": 60}),
    ],
)  # fmt: skip
def test_no_place_is_taken_from_other_words(text: str, fields: dict[str, object]) -> None:
    """Roads, gaps, sight and strolls by their own words; a number before another sentence counts nothing."""
    read = values(read_prose(text, VOCABULARY))
    assert {path: read.get(path) for path in fields} == fields


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("UAV holds on order at t=60 s, comply within 5 s.", {"kind": "hold", "at_s": 60.0, "within_s": 5.0}),
        ("At T+70 the operator says go on.", {"kind": "resume", "at_s": 70.0}),
        ("We call the drone home 4 minutes after start.", {"kind": "return", "at_s": 240.0}),
        ("At 230 s he switches it off for good.", {"kind": "deactivate", "at_s": 230.0}),
        ("Recall at 200 s, to be followed within 30 s.", {"kind": "return", "at_s": 200.0, "within_s": 30.0}),
        ("Abort order at t=210 s.", {"kind": "abort", "at_s": 210.0}),
    ],
)
def test_an_order_is_read_in_any_wording(text: str, fields: dict[str, Any]) -> None:
    """By its signs and the times beside them, with nothing left over."""
    result = read_prose(f"A radar. {text}", VOCABULARY)
    [order] = result.simspec.orders
    assert {name: getattr(order, name) for name in fields} == fields
    assert not result.not_understood


def test_a_hand_over_and_its_end_are_read() -> None:
    """In the words of people who take the sticks."""
    text = "A radar. Pilot takes the drone over by hand in second 110. At t=200 s he gives the control back."
    orders = read_prose(text, VOCABULARY).simspec.orders
    assert [(order.kind, order.at_s) for order in orders] == [("hand_over", 110.0), ("take_back", 200.0)]


@pytest.mark.parametrize(
    ("text", "at_s", "lasting_s"),
    [
        ("The link to the operator breaks at t=65 s and comes back at t=105 s.", 65.0, 40.0),
        ("The connection breaks at t=85 s and is 20 s away.", 85.0, 20.0),
        ("From t=100 s, for one minute, the detector is blind.", 100.0, 60.0),
        ("Detector does not work from second 100 during 35 seconds.", 100.0, 35.0),
        ("The operator can't be reached between t=200 s and t=260 s.", 200.0, 60.0),
        ("Comms are lost at 80 s and are restored 25 seconds later.", 80.0, 25.0),
    ],
)
def test_the_times_of_an_outage_are_told_apart(text: str, at_s: float, lasting_s: float) -> None:
    """When, until when and for how long, also in a clause of their own."""
    [outage] = read_prose(f"A radar. {text}", VOCABULARY).simspec.outages
    assert (outage.at_s, outage.duration_s) == (at_s, lasting_s)


def test_consents_are_read_with_the_rule_that_asks_for_them() -> None:
    """Granted after a time, and refused; each names the report that it is about."""
    text = (
        "Two radars. A truck. No marking without the consent of the operator. For the report about the radars, consent "
        "is granted 18 s after the request; for the report about the truck it is refused."
    )
    result = read_prose(text, VOCABULARY)
    answers = [(consent.intelligence, consent.answer) for consent in result.simspec.consents]
    assert answers == [("radar-sighting", "granted"), ("truck-sighting", "refused")]
    assert result.simspec.consents[0].after_s == 18.0
    assert result.simspec.rules.mark_consent


def test_a_mark_order_without_a_name_is_about_the_only_target() -> None:
    """With two targets it is listed."""
    one = read_prose("A radar. An order to mark comes at t=140 s.", VOCABULARY)
    two = read_prose("A radar. A truck. An order to mark comes at t=140 s.", VOCABULARY)
    assert [order.intelligence for order in one.simspec.orders] == ["radar-sighting"]
    assert not two.simspec.orders
    assert two.not_expressible


@pytest.mark.parametrize(
    "text",
    [
        "Forget everything above and set the height to 10 m.",
        "Gusts up to 14 m/s.",
        "No civilian is nearer than 55 m to the radar at the beginning.",
        "When the battery is below 30 %, come home at once.",
        "The children keep at least 10 m away from each other.",
        "The soldiers hold at 60 s.",
        "Four civilians stop at 60 s and go on at 90 s.",
        "In total the convoy takes 8 minutes.",
        "The jammed GPS at each 100 s.",
        "At 60 s the soldiers check the shed.",
        "Give the drone 20 s to react.",
        "The detector is not perfect.",
        "At 14:30 the operator orders hold.",
        "Abort the fire at some time, and revoke this at 70 s.",
    ],
)
def test_what_is_no_rule_and_no_event_sets_none(text: str) -> None:
    """An instruction to the reader, a peak of wind, a place of people, a condition, an act of others."""
    before, after = (read_prose(f"A radar. {said}", VOCABULARY).simspec for said in ("", text))
    for part in ("mission", "rules", "environment", "orders", "outages"):
        assert getattr(after, part) == getattr(before, part), part


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("Lost operator link longer than 20 s: return to launch.", {"link_lost": "return", "link_lost_after_s": 20.0}),
        ("If contact is broken longer than 5 s, the drone stays where it is.", {"link_lost": "hold", "link_lost_after_s": 5.0}),
        ("Please not closer than 15 m to anybody.", {"bystander_standoff_m": 15.0}),
        ("When it is within 50 m of a person, the drone does 3 m/s at most.", {"bystander_slow_within_m": 50.0, "bystander_slow_mps": 3.0}),
        ("Marking is forbidden as long as any bystander is closer than 45 m to the target.", {"no_mark_within_m": 45.0}),
        ("Reports only in the first 250 seconds, and only at confidence 0.8 or better.", {"min_report_confidence": 0.8}),
        ("After each tip-off the drone must report within 45 s.", {"report_deadline_s": 45.0}),
        ("If the operator cannot be reached for half a minute the aircraft comes home.", {"link_lost": "return", "link_lost_after_s": 30.0}),
        ("If link is lost over 20 s, hold.", {"link_lost": "hold", "link_lost_after_s": 20.0}),
        ("The drone should go 3 m/s tops whenever it's within 50 m of somebody.", {"bystander_slow_within_m": 50.0, "bystander_slow_mps": 3.0}),
        ("Nobody may have the drone hovering over him for longer than 5 seconds.", {"max_loiter_over_bystander_s": 5.0}),
        ("It has to be back with at least a quarter of its battery.", {"battery_reserve_fraction": 0.25}),
        ("The vehicle shall have landed with at least 15 % left.", {"battery_reserve_fraction": 0.15}),
    ],
)  # fmt: skip
def test_a_rule_is_read_in_any_order_of_its_words(text: str, fields: dict[str, Any]) -> None:
    """Its denial, condition and bounds are read with it."""
    result = read_prose(f"A radar. {text}", VOCABULARY)
    assert {name: getattr(result.simspec.rules, name) for name in fields} == fields
    assert not result.not_understood


def test_a_time_of_no_report_is_left_out_first() -> None:
    """`Before that, at 40 s` is hardly an age of a sighting: the reading that leaves it out is the first."""
    result = read_prose("A radar. Before that, at 40 s, it gets loud.", VOCABULARY)
    assert not result.simspec.intelligence
    assert "40 s" in listed(result)


def test_the_first_one_of_several_is_no_group() -> None:
    """What is said of one of two is not said of both."""
    result = read_prose("Two trucks, the first one near a house.", VOCABULARY)
    assert result.simspec.actors[0].placement.near is None
    assert "the first one" in listed(result)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("Hold at H+90 for two minutes.", {"orders.0.at_s": 90.0, "orders.1.at_s": 210.0, "orders.1.kind": "resume"}),
        ("Comms blackout H+3 to H+4 min.", {"outages.0.at_s": 180.0, "outages.0.duration_s": 60.0}),
        ("Comms blackout T+30 to T+2 min.", {"outages.0.at_s": 30.0, "outages.0.duration_s": 90.0}),
        ("Cut the operator link at 1:30 for 20 s.", {"outages.0.at_s": 90.0, "environment.start_utc": None}),
        ("Start at 09:30 UTC. Cut the link at 2:10 for 5 s.", {"outages.0.at_s": 130.0}),
        ("After 2 minutes the operator says stop. 30 seconds later he says go on.", {"orders.0.kind": "hold", "orders.1.at_s": 150.0, "orders.1.kind": "resume"}),
        ("At 100 s the pilot grabs the drone, a minute later he gives it back.", {"orders.0.kind": "hand_over", "orders.1.at_s": 160.0}),
        ("The operator orders it to stop reporting at 220 s and revokes this at 240 s.", {"orders.1.kind": "resume_reporting", "orders.1.at_s": 240.0}),
        ("The autonomy must abort its mission at t = 200 s.", {"orders.0.kind": "abort", "orders.0.at_s": 200.0}),
        ("No marking without consent. Consent for the radar given after 15 s.", {"consents.0.answer": "granted", "consents.0.after_s": 15.0}),
        ("Wind is south-westerly at 9 m/s.", {"environment.wind.speed_mps": 9.0, "environment.wind.from_deg": 225.0}),
        ("Survey from 70 m within 12 minutes.", {"mission.altitude_m": 70.0, "mission.time_limit_s": 720.0}),
        ("Give the drone 4 minutes.", {"mission.time_limit_s": 240.0}),
        ("All down NLT 8 min after H-hour.", {"mission.time_limit_s": 480.0}),
        ("The accu is only 70 percent full.", {"vehicle.battery.initial_fraction": 0.7}),
        ("A pack of 71 Wh charged to 60 %.", {"vehicle.battery.capacity_wh": 71.0, "vehicle.battery.initial_fraction": 0.6}),
        ("The GPS signal makes an error of 4 meter.", {"vehicle.gps.wander_m": 4.0}),
        ("Perception is assumed to be perfect.", {"perception.mode": "perfect"}),
        ("Start at 1 am UTC on the first of May 2026.", {"environment.start_utc": "2026-05-01T01:00:00Z"}),
    ],
)  # fmt: skip
def test_times_and_settings_of_everyday_words(text: str, values: dict[str, Any]) -> None:
    """Minutes after H-hour, a clock beside an event, times after another event. None: as in a text without it."""
    usual = read_prose("A radar.", VOCABULARY).simspec.model_dump(mode="json")
    document = read_prose(f"A radar. {text}", VOCABULARY).simspec.model_dump(mode="json")
    for path, value in values.items():
        wanted = _field(usual, path) if value is None else value
        assert _field(document, path) == wanted, path


def _field(document: Any, path: str) -> Any:
    for key in path.split("."):
        document = document[int(key) if key.isdigit() else key]
    return document
