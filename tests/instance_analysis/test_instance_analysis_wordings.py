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


@pytest.mark.parametrize(
    ("text", "assets"),
    [
        ("A pickup, two vans and three firs.", {"pickup": 1, "van": 2, "conifer": 3}),
        ("Four apartment blocks and a house. Two trees.", {"apartment-block": 4, "house": 1, "tree": 2}),
        ("Two armed men and a soldier.", {"armed-person": 2, "soldier": 1}),
        ("Three civ trucks, a truck and a radar van.", {"truck": 3, "military-truck": 1, "radar-vehicle": 1}),
    ],
)  # fmt: skip
def test_a_word_gets_the_asset_that_is_meant(text: str, assets: dict[str, int]) -> None:
    """Not a near one, where the catalogue has the thing itself."""
    groups = read_prose(text, VOCABULARY).simspec.actors
    assert {group.asset: group.count for group in groups} == assets


@pytest.mark.parametrize("vehicles", ["vans", "pickups", "cars", "motorbikes"])
def test_civilian_vehicles_that_move_are_bystanders(vehicles: str) -> None:
    """People sit in them, in those with an asset of their own too; what is parked is clutter."""
    moves = read_prose(f"Two {vehicles} drive along the road at 8 m/s.", VOCABULARY).simspec.actors[0]
    stands = read_prose(f"Two {vehicles} are parked.", VOCABULARY).simspec.actors[0]
    assert (moves.role, stands.role) == ("bystander", "clutter")


def test_every_asset_word_is_in_the_catalogue() -> None:
    """Each group of the vocabulary stands for an asset that a SimSpec may have."""
    assert {words.asset for words in VOCABULARY.assets.values()} <= set(ASSETS)


def corners(result: BaseSimSpec) -> tuple[float, float, float, float]:
    """West, south, east and north of the area of interest."""
    points = result.simspec.world.area.corners
    east, north = [point.east_m for point in points], [point.north_m for point in points]
    return min(east), min(north), max(east), max(north)


@pytest.mark.parametrize(
    ("text", "box"),
    [
        (
            "The area shall measure 300 m by 200 m, its south-west corner being the take-off point.",
            (0, 0, 300, 200),
        ),
        (
            "The zone is 300 by 200 m, and the drone stays in the middle of the south end.",
            (-150, 0, 150, 200),
        ),
        ("Home is at (50, 10). The area is 300 by 200 m, we launch from its middle.", (-100, -90, 200, 110)),
        ("The area is 300 by 200 m. A truck stands in its south-west corner.", (-150, -100, 150, 100)),
    ],
)
def test_where_the_drone_starts_in_the_area(text: str, box: tuple[float, float, float, float]) -> None:
    """Its corner, a side, or its middle; a truck there moves no area."""
    assert corners(read_prose(text, VOCABULARY)) == box


@pytest.mark.parametrize(
    "text",
    [
        "A truck 60 to 120 m west of the car park where the drone starts.",
        "A truck 60 to 120 m west of our jetty, which is the take-off point.",
        "A truck 60 to 120 m west of the jetty. The drone takes off from the jetty.",
    ],
)
def test_a_place_of_the_start_is_home(text: str) -> None:
    """The text says that the drone starts there."""
    near = read_prose(text, VOCABULARY).simspec.actors[0].placement.near
    assert near is not None
    assert (near.of, near.min_m, near.max_m) == ("home", 60, 120)


def test_another_place_is_not_home() -> None:
    """Nobody starts from this jetty."""
    result = read_prose(
        "A truck 60 to 120 m west of the jetty. The drone takes off from the road.", VOCABULARY
    )
    assert result.simspec.actors[0].placement.near is None
    assert "jetty" in listed(result)


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        (
            "Two frightened hikers near a ruined house.",
            {"civilian.count": 2, "house.count": 1, "civilian.placement.near.of": "house"},
        ),
        ("A rusty truck. Ten dozing soldiers.", {"truck.count": 1, "soldier.count": 10}),
    ],
)
def test_an_unknown_adjective_leaves_the_group(text: str, fields: dict[str, Any]) -> None:
    """Number and relation stay; the word is listed."""
    result = read_prose(text, VOCABULARY)
    read = values(result)
    assert {path: read.get(f"actors[{path.replace('.', '].', 1)}") for path in fields} == fields
    assert {"in part", "understood"} >= {
        clause.status for clause in result.clauses if "." not in clause.quote
    } - {"default"}
    assert listed(result)


def test_an_unknown_word_before_a_comma_is_no_adjective() -> None:
    """`two, dozing, soldiers` counts nobody."""
    assert "Two" in listed(read_prose("Two, dozing, soldiers.", VOCABULARY))


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("A girl. No faster than 6 m/s until she is found or 15 minutes are over.", "rules.max_speed_mps", 6),
        ("Stay below 50 m unless ordered otherwise.", "rules.max_altitude_m", 50),
        ("Unless it rains, stay below 50 m.", "rules.max_altitude_m", None),
        ("If it rains, stay below 50 m until noon.", "rules.max_altitude_m", None),
    ],
)
def test_what_stands_before_an_exception_holds(text: str, path: str, value: float | None) -> None:
    """`until` and `unless` end what stands before them; a condition that begins takes all with it."""
    result = read_prose(text, VOCABULARY)
    assert values(result).get(path) == value
    assert result.choices


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("Stay below 50 m.", "mission.altitude_m", 50),
        ("The drone must not fly below 80 m.", "mission.altitude_m", 80),
        ("GPS jammed at 320 s for 20 s.", "mission.time_limit_s", 420),
        ("Stay below 100 m. GPS jammed at 120 s for 20 s.", "mission.altitude_m", 60),
    ],
)
def test_defaults_fit_what_is_stated(text: str, path: str, value: float) -> None:
    """The usual height breaks no rule of the text, and nothing happens after the end; both are shown."""
    [receipt] = [receipt for receipt in read_prose(text, VOCABULARY).receipts if receipt.path == path]
    assert (receipt.value, receipt.source) == (value, "default")


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("Time is about 18 o'clock UTC.", "2026-06-21T18:00:00"),
        ("Start at noon UTC.", "2026-06-21T12:00:00"),
        ("Half past four in the afternoon UTC.", "2026-06-21T16:30:00"),
    ],
)
def test_times_of_day_in_words(text: str, stamp: str) -> None:
    """With a zone they are no moment of the sun."""
    assert read_prose(text, VOCABULARY).simspec.environment.start_utc.strftime("%Y-%m-%dT%H:%M:%S") == stamp


def test_a_direction_by_the_clock_is_no_time_of_day() -> None:
    """It depends on where the drone looks."""
    result = read_prose("A truck at two o'clock, 150 m.", VOCABULARY)
    assert "environment.start_utc" not in values(result)
    assert "two o'clock" in listed(result)


def test_a_fence_around_home() -> None:
    """The drone stays within a distance of home, and a group does too."""
    result = read_prose("The drone must stay within 200 m of home. A truck within 100 m of home.", VOCABULARY)
    fence = result.simspec.rules.geofence
    assert fence is not None
    assert all(200 <= (point.east_m**2 + point.north_m**2) ** 0.5 < 205 for point in fence.corners)
    assert result.simspec.actors[0].placement.near is not None


def test_a_road_of_a_length_lies_in_the_middle() -> None:
    """Its course and length are stated, not its place."""
    result = read_prose("A straight road of 400 m from south to north, 6 m wide.", VOCABULARY)
    [road] = result.simspec.world.roads
    assert sorted((point.east_m, point.north_m) for point in road.points) == [(0, -200), (0, 200)]
    assert road.width_m == 6


@pytest.mark.parametrize(
    "text",
    ["Nobody is to be marked without our approval.", "Consent is a must.", "A radar. Requests concerning the radar are never answered."],
)  # fmt: skip
def test_marks_need_consent(text: str) -> None:
    """Also where the text only tells how requests are answered."""
    assert read_prose(text, VOCABULARY).simspec.rules.mark_consent


@pytest.mark.parametrize(
    "text", ["Consent is not required.", "No marking within 30 m of people without consent."]
)
def test_marks_need_no_consent(text: str) -> None:
    """A denial, and a rule about something else besides."""
    result = read_prose(text, VOCABULARY)
    assert not result.simspec.rules.mark_consent
    assert listed(result)


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("C2 link lost more than 15 s: RTB.", {"rules.link_lost": "return", "rules.link_lost_after_s": 15}),
        ("Wind 090/12 kts.", {"environment.wind.from_deg": 90, "environment.wind.speed_mps": 6.173333333}),
        ("No mark w/i 40 m of civs. Bingo 25 pct.", {"rules.no_mark_within_m": 40, "rules.battery_reserve_fraction": 0.25}),
        ("Report NLT 90 s after tip.", {"rules.report_deadline_s": 90}),
        ("The report deadline shall be 60 s from delivery.", {"rules.report_deadline_s": 60}),
        ("Reports with a confidence below 0.7 shall be withheld.", {"rules.min_report_confidence": 0.7}),
        ("The operator shall order a hold at 50 s; the agent shall comply within 4 s. The order shall be lifted at 70 s.", {"orders[hold-1].within_s": 4, "orders[resume-2].at_s": 70}),
        ("Let's kill the link at 1:40 for half a minute.", {"outages[0].at_s": 100, "outages[0].duration_s": 30}),
        ("Give it six minutes tops.", {"mission.time_limit_s": 360}),
        ("The GPS is off by 3 m or so.", {"vehicle.gps.wander_m": 3}),
        ("A camouflaged radar (c = 0.8). Consent is granted 12 s after each request.", {"actors[radar].concealment": 0.8, "consents[0].after_s": 12}),
        ("A radar. Tip at H+40, 5 min old.", {"intelligence[radar-sighting].delivered_s": 40, "intelligence[radar-sighting].latency_s": 300}),
        ("Ten people walk around the house within 30 m of it.", {"actors[civilian].placement.near.of": "house", "actors[house].placement.near.of": None}),
    ],
)  # fmt: skip
def test_short_forms_of_rules_and_orders(text: str, fields: dict[str, Any]) -> None:
    """As they stand in orders, requirements and notes."""
    read = values(read_prose(text, VOCABULARY))
    assert {path: read.get(path) for path in fields} == fields


@pytest.mark.parametrize(
    ("text", "quote"),
    [
        ("The agent shall comply within 4 s.", "comply within 4 s"),
        ("A street with eight houses either side.", "either side"),
        ("A letter c 3 stands on it.", "3"),
        ("A boat 20/40 m away. A tip.", "20/40"),
    ],
)
def test_short_forms_of_something_else_are_listed(text: str, quote: str) -> None:
    """A deadline of no order, houses to each side, a letter, a fraction."""
    assert quote in listed(read_prose(text, VOCABULARY))


FIRST_REPORT = "A radar and a truck. A report on the radar is 60 s old."


@pytest.mark.parametrize(
    ("second", "about"),
    [
        ("A second report on the truck arrives at 40 s.", "truck"),
        ("Another, newer report on the radar arrives at 40 s.", "radar"),
    ],
)
def test_two_reports(second: str, about: str) -> None:
    """Each keeps its own numbers, whether they are on one group or two; an order means the first one."""
    order = "At 90 s the operator orders to mark the radar."
    simspec = read_prose(f"{FIRST_REPORT} {second} {order}", VOCABULARY).simspec
    told = [(report.about, report.latency_s, report.delivered_s) for report in simspec.intelligence]
    assert told == [("radar", 60, 0), (about, 0, 40)]
    assert simspec.orders[0].intelligence == simspec.intelligence[0].id


def test_reports_without_a_name_are_on_the_only_target() -> None:
    """Both are choices."""
    text = "A radar. First report is 25 minutes old, priority 1. A second, vaguer one is good to 200 m only."
    result = read_prose(text, VOCABULARY)
    told = [
        (report.latency_s, report.priority, report.uncertainty_m) for report in result.simspec.intelligence
    ]
    assert told[0][:2] == (1500, 1)
    assert told[1][2] == 200
    assert len([choice for choice in result.choices if "about whom" in choice.ask]) == 2


def test_reports_that_are_only_counted() -> None:
    """`the first`, `the second`: what stands before the group of a report belongs to it."""
    text = (
        "Intelligence: the first (priority 2) concerns a radar and has a radius of 100 m, the second (priority 1) "
        "concerns a truck and is delivered at 90 s."
    )
    simspec = read_prose(text, VOCABULARY).simspec
    told = [(report.about, report.priority, report.delivered_s) for report in simspec.intelligence]
    assert told == [("radar", 2, 0), ("truck", 1, 90)]
    assert simspec.intelligence[0].uncertainty_m == 100


def test_the_first_person_is_no_report() -> None:
    """Where a report was spoken of, `the first` may be somebody."""
    result = read_prose("A report is due. The first is a nurse, the second is a doctor.", VOCABULARY)
    assert "The first" in listed(result)


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("A chapel. A dog searches 50 to 90 m south of the chapel.", {"mission.altitude_m": None, "actors[dog].placement.near.max_m": 90}),
        ("The pilot takes over at 150 s and hands back control half a minute later.", {"orders[hand-over-1].at_s": 150, "orders[take-back-2].at_s": 180}),
        ("Two ambulances and a bus are parked beside the road.", {"actors[ambulance].placement.along.where": "beside", "actors[bus].placement.along.where": "beside"}),
        ("Two ambulances and a bus, parked beside the road.", {"actors[ambulance].placement.along.where": None}),
        ("The UAV shall maintain an altitude of 50 m +/- 5 m.", {"mission.altitude_m": 50}),
        ("A tent with six people inside, 80 m or more from the radar.", {"actors[civilian].placement.distances[0].min_m": 80, "actors[civilian].placement.near.max_m": None}),
    ],
)  # fmt: skip
def test_what_a_number_or_a_verb_belongs_to(text: str, fields: dict[str, Any]) -> None:
    """A distance is no height, `takes over at` no end, a plural verb is of all that stands before it."""
    read = values(read_prose(text, VOCABULARY))
    assert {path: read.get(path) for path in fields} == fields


def test_dusk_is_shown_as_sunset() -> None:
    """Dusk has a length."""
    result = read_prose("It is dusk.", VOCABULARY)
    assert any("sunset" in remark.why for remark in result.remarks)
    assert not any("sunset" in remark.why for remark in read_prose("Start at sunset.", VOCABULARY).remarks)


VILLAGE = "A village of 100 by 100 m."


@pytest.mark.parametrize(
    "text", [f"{VILLAGE} Three trucks outside the village.", f"Three trucks avoid the village. {VILLAGE}"]
)
def test_a_group_keeps_out_of_ground(text: str) -> None:
    """Ground with a size that a group is outside of."""
    [truck] = read_prose(text, VOCABULARY).simspec.actors
    assert [avoid.area for avoid in truck.placement.avoid] == ["village"]


@pytest.mark.parametrize(
    ("text", "quote"),
    [("Three trucks outside the village.", "outside the village"), (f"{VILLAGE} The drone is outside the village.", "outside")],
)  # fmt: skip
def test_ground_without_a_size_is_avoided_by_nobody(text: str, quote: str) -> None:
    """Nor does the drone keep out of it by this."""
    result = read_prose(text, VOCABULARY)
    assert not any(group.placement.avoid for group in result.simspec.actors)
    assert quote in listed(result)


@pytest.mark.parametrize(
    "text", ["Five crates, all within 20 m of each other.", "Five crates within 20 m of one another."]
)
def test_how_far_apart_members_are_at_most(text: str) -> None:
    """The largest distance inside a group, and not the least one."""
    [crates] = read_prose(text, VOCABULARY).simspec.actors
    assert (crates.placement.extent_m, crates.placement.spread_m) == (20, None)
