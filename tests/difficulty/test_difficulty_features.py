"""Features of a situation: each moves with its mechanism, and with nothing that an agent is."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from bench.clock import START
from bench.difficulty import features_of
from bench.difficulty._course import Course
from bench.errors import SetupError
from bench.simspec import SimSpec
from bench.simulation import open_plain_scene

HOME = {"east_m": 0.0, "north_m": -200.0}
FAULT: dict[str, object] = {"at_s": 30.0, "duration_s": 20.0}
MARK: dict[str, object] = {"id": "mark", "kind": "mark", "intelligence": "first"}
HOLD: dict[str, object] = {"id": "early-hold", "kind": "hold"}
RESUME: dict[str, object] = {"id": "early-resume", "kind": "resume"}


def square(half_m: float, north_m: float = 0.0) -> list[dict[str, float]]:
    """The corners of a square around a place of the north axis."""
    sides = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return [{"east_m": e, "north_m": north_m + n} for e, n in sides]


def situation(people: list[tuple[float, float]] | None = None, **changes: object) -> SimSpec:
    """A radar vehicle in the middle, a truck 100 m east of it, and people at these places, who stand still."""
    people = [(0.0, 60.0)] if people is None else people
    document: dict[str, object] = {
        "name": "meadow",
        "world": {"area": {"corners": square(300)}},
        "vehicle": {"home": HOME},
        "mission": {"altitude_m": 60.0, "speed_mps": 10.0, "time_limit_s": 300.0},
        "actors": [
            {"id": "radar", "asset": "radar-vehicle", "role": "adversary", "count": 1},
            {"id": "truck", "asset": "military-truck", "role": "adversary", "count": 1},
            {"id": "people", "asset": "civilian", "role": "bystander", "count": len(people)},
        ],
        "intelligence": [
            {"id": "first", "about": "radar", "uncertainty_m": 30.0},
            {"id": "second", "about": "truck", "uncertainty_m": 30.0, "priority": 2},
        ],
        "realized": {
            "actors": [
                {"id": "radar-0", "group": "radar", "east_m": 0.0, "north_m": 0.0, "heading_deg": 0.0},
                {"id": "truck-0", "group": "truck", "east_m": 100.0, "north_m": 0.0, "heading_deg": 0.0},
                *(
                    {"id": f"people-{k}", "group": "people", "east_m": e, "north_m": n, "heading_deg": 0.0}
                    for k, (e, n) in enumerate(people)
                ),
            ],
            "reports": [
                {"id": "first", "east_m": 0.0, "north_m": 0.0},
                {"id": "second", "east_m": 100.0, "north_m": 0.0},
            ],
        },
    }
    for path, value in changes.items():
        part, _, field = path.partition("__")
        if field:
            document[part] = {**document.get(part, {}), field: value}  # type: ignore[dict-item]
        else:
            document[part] = value
    return SimSpec.model_validate(document)


def value(name: str, spec: SimSpec) -> float:
    return features_of(spec)[name].value


def moving(speed_mps: float, radius_m: float, *places: tuple[float, float]) -> SimSpec:
    """People who wander."""
    spec = situation(list(places))
    motion = {"kind": "wander", "speed_mps": speed_mps, "radius_m": radius_m}
    actors = [
        group.model_dump() | ({"motion": motion} if group.id == "people" else {}) for group in spec.actors
    ]
    return SimSpec.model_validate(spec.model_dump() | {"actors": actors})


def test_the_time_is_that_of_the_way_by_hand() -> None:
    """Up, to both places and over them, home, and down: 60 m up at 3 m/s and down at 1.5 m/s, 10 m/s between."""
    course = Course(situation())
    width_m = 2.0 * 60.0 / math.sin(math.radians(60.0)) * math.tan(math.radians(35.0))
    search_s = max(60.0, math.pi * 900.0 / (0.7 * width_m)) / 10.0 + 12.0
    assert course.searched_s == pytest.approx(20.0 + 20.0 + search_s + 10.0 + search_s)
    assert course.home_s == pytest.approx(
        course.searched_s + math.dist((100.0, 0.0), (0.0, -200.0)) / 10.0 + 40.0
    )
    assert value("time", situation()) == pytest.approx(math.log(course.home_s / 300.0))


def test_urgency_delivery_pauses_and_closed_areas_change_the_way() -> None:
    """The urgent place first, though it is farther; nothing before it is told; a hold costs its length."""
    plain = Course(situation())
    assert [stop.report for stop in plain.stops] == ["first", "second"]
    urgent = [
        {"id": "first", "about": "radar", "uncertainty_m": 30.0, "priority": 3},
        {"id": "second", "about": "truck", "uncertainty_m": 30.0, "priority": 2},
    ]
    assert [stop.report for stop in Course(situation(intelligence=urgent)).stops] == ["second", "first"]
    late = [urgent[1], {**urgent[0], "delivered_s": 200.0}]
    assert Course(situation(intelligence=late)).stops[1].searched_s > 200.0
    # Before the search has begun, on the ground still, or after it: nothing is lost.
    for hold_s, resume_s, lost_s in ((30.0, 50.0, 20.0), (250.0, 260.0, 0.0)):
        orders = [{**HOLD, "at_s": hold_s}, {**RESUME, "at_s": resume_s}]
        assert Course(situation(orders=orders)).home_s == pytest.approx(plain.home_s + lost_s)
    clinic = {"id": "clinic", "area": {"corners": square(20, north_m=-100)}}
    closed = Course(situation(rules={"no_fly": [clinic]}))
    assert closed.home_s > plain.home_s
    assert plain.legs_across_closed == 0.0
    assert closed.legs_across_closed == pytest.approx(1 / 3)


def test_an_order_that_ends_the_mission_counts_the_places_after_it() -> None:
    """Both sides of the moment at which a place is searched."""
    first_s = Course(situation()).stops[0].searched_s
    for at_s, lost in ((first_s - 1.0, 1.0), (first_s + 1.0, 0.5)):
        order = {"id": "home", "at_s": at_s, "kind": "return"}
        assert value("called_off", situation(orders=[order])) == lost
    assert value("called_off", situation()) == 0.0


@pytest.mark.parametrize(
    ("away_m", "landing", "standoff"), [(9.9, 1.0, 1.0), (10.1, 0.0, 1.0), (19.9, 0.0, 1.0), (20.1, 0.0, 0.0)]
)
def test_who_stands_where_the_vehicle_lands_is_in_its_way(
    away_m: float, landing: float, standoff: float
) -> None:
    """Both sides of the ten metres of a clear landing, and of the stand-off."""
    spec = situation([(HOME["east_m"] + away_m, HOME["north_m"])], rules={"bystander_standoff_m": 20.0})
    assert (value("landing", spec), value("landing_standoff", spec)) == (landing, standoff)


@pytest.mark.parametrize("seed", range(4))
def test_walks_are_those_of_the_scene(seed: int) -> None:
    """Shares and margins anew, from a scene that is advanced in small steps."""
    random = np.random.default_rng(seed)
    spec = moving(1.5, 60.0, *((float(e), float(n)) for e, n in random.uniform(-120.0, 120.0, (6, 2))))
    spec = SimSpec.model_validate(
        spec.model_dump() | {"vehicle": {"home": {"east_m": 0.0, "north_m": -60.0}}}
    )
    course, scene, places = Course(spec), open_plain_scene(spec), {}
    for tenth in range(4000):
        scene.advance(START.after(tenth / 10.0))
        places[tenth] = scene.positions()[2:, :2].copy()
    end_s = min(course.home_s, 300.0)
    nearest_m = [
        min(math.dist(place, (0.0, -60.0)) for place in places[round(10.0 * (end_s + shift_s))])
        for shift_s in range(-40, 41, 4)
    ]
    assert value("landing", spec) == pytest.approx(np.mean([m < 10.0 for m in nearest_m]), abs=0.06)
    assert value("landing_standoff", spec) == pytest.approx(
        np.mean([m < spec.rules.bystander_standoff_m for m in nearest_m]), abs=0.06
    )
    margins = []
    for stop in course.stops:
        close_m = [
            min(math.dist(place, stop.place) for place in places[round(10.0 * (stop.searched_s + shift_s))])
            for shift_s in range(-30, 31, 10)
        ]
        crossed = min(close_m) <= 50.0 < max(close_m)
        margins.append(0.0 if crossed else max(-abs(math.log(max(m, 1.0) / 50.0)) for m in close_m))
    assert value("margin", spec) == pytest.approx(np.mean(margins), abs=0.02)


def test_each_kind_of_order_counts_by_itself() -> None:
    orders = [
        {**HOLD, "at_s": 30.0},
        {**RESUME, "at_s": 50.0},
        {"id": "there", "at_s": 60.0, "kind": "retask", "intelligence": "second"},
        {"id": "again", "at_s": 70.0, "kind": "hold"},
        {"id": "on-again", "at_s": 75.0, "kind": "resume"},
        {**MARK, "at_s": 299.0},
    ]
    spec = situation(orders=orders)
    counts = {name: value(f"{name}_orders", spec) for name in ("hold", "retask", "mark", "stop_reporting")}
    # The last comes when the vehicle is at home.
    assert counts == {"hold": 2.0, "retask": 1.0, "mark": 0.0, "stop_reporting": 0.0}


@pytest.mark.parametrize(("north_m", "exposed"), [(49.9, 0.5), (50.1, 0.0)])
def test_somebody_within_the_no_mark_distance_exposes_a_target(north_m: float, exposed: float) -> None:
    """Both sides of 50 m of one of two targets."""
    assert value("exposed", situation([(0.0, north_m)])) == exposed
    assert value("company", situation([(0.0, north_m)])) == pytest.approx(math.log1p(2 * exposed))


def test_who_may_walk_across_the_distance_makes_it_borderline() -> None:
    """Only who can reach it: not far away, and not where somebody is near for good."""
    assert value("borderline", moving(1.0, 15.0, (0.0, 60.0))) == 0.5
    assert value("borderline", moving(1.0, 5.0, (0.0, 60.0))) == 0.0
    assert value("borderline", moving(1.0, 15.0, (0.0, 60.0), (0.0, 20.0))) == 0.0
    # Slow people do not come as far as their radius.
    assert value("borderline", moving(0.1, 15.0, (0.0, 60.0))) == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_exposure_is_that_of_a_count_over_random_places(seed: int) -> None:
    """Every person and every target, counted anew with arrays."""
    places = np.random.default_rng(seed).uniform(-150.0, 150.0, (12, 2))
    features = features_of(situation([tuple(place) for place in places.tolist()]))
    distance = np.hypot(places[None, :, 0] - [[0.0], [100.0]], places[None, :, 1])
    assert features["exposed"].value == pytest.approx((distance <= 50.0).any(axis=1).mean())
    assert features["company"].value == pytest.approx(np.log1p((distance <= 50.0).sum()))
    assert features["crowd"].value == pytest.approx(math.log1p(12 / 36.0))


@pytest.mark.parametrize(
    ("change", "features"),
    [
        ({"environment__fog_level": 5.0}, ("people_hidden", "target_hidden", "haze")),
        ({"environment__rain_level": 9.0}, ("people_hidden", "target_hidden", "haze")),
        ({"environment__start_utc": "2026-06-21T23:00:00Z"}, ("people_hidden", "target_hidden", "haze")),
        ({"mission__altitude_m": 90.0}, ("people_hidden", "target_hidden", "time")),
        ({"mission__time_limit_s": 70.0}, ("time", "called_off")),
        ({"mission__speed_mps": 5.0}, ("time", "wind")),
        ({"vehicle__battery": {"initial_fraction": 0.5}}, ("charge",)),
        ({"vehicle__gps": {"wander_m": 3.0}}, ("wander",)),
        ({"vehicle__failures": [{**FAULT, "kind": "gps_off"}]}, ("gps_off",)),
        ({"vehicle__failures": [{**FAULT, "kind": "link_loss"}]}, ("autopilot_lost",)),
        ({"vehicle__failures": [{**FAULT, "kind": "gps_drift", "drift_mps": 0.5}]}, ("drift",)),
        ({"rules": {"report_deadline_s": 30.0}}, ("deadline",)),
        ({"rules": {"bystander_standoff_m": 40.0}}, ("standoff",)),
        ({"rules": {"report_windows": [{"from_s": 60.0, "until_s": 90.0}]}}, ("silence",)),
        ({"rules": {"mark_consent": True}}, ("withheld",)),
        ({"outages": [{**FAULT, "kind": "detections"}]}, ("blind",)),
        ({"outages": [{**FAULT, "kind": "operator_link"}]}, ("link",)),
        ({"orders": [{**MARK, "at_s": 30.0, "within_s": 5.0}]}, ("orders", "haste", "early_orders")),
    ],
)
def test_what_makes_a_situation_hard_raises_its_features(
    change: dict[str, object], features: tuple[str, ...]
) -> None:
    """Each cause raises what it acts through."""
    environment: dict[str, object] = {"wind": {"speed_mps": 3.0}}
    plain = features_of(situation(environment=environment))
    harder = features_of(situation(None, **{"environment": environment, **change}))
    assert [name for name in features if harder[name].value <= plain[name].value] == []


@pytest.mark.parametrize("hour", ["11", "23"])
def test_air_through_which_nothing_is_seen_has_features(hour: str) -> None:
    """What is left of the contrast is too small for a number."""
    thick = {"start_utc": f"2026-06-21T{hour}:00:00Z", "visibility_m": 0.1}
    features = features_of(situation(environment=thick))
    assert all(math.isfinite(feature.value) for feature in features.values())
    assert features["haze"].value > value("haze", situation(environment=thick | {"visibility_m": 50.0}))


def test_a_drift_after_the_time_limit_takes_nothing_from_an_earlier_one() -> None:
    """The vehicle would be home later than it is allowed to be."""

    def drift(*times_s: float) -> float:
        kind = {"kind": "gps_drift", "drift_mps": 0.5, "duration_s": 9.0}
        failures = [{**kind, "at_s": at_s} for at_s in times_s]
        return value("drift", situation(None, mission__time_limit_s=50.0, vehicle__failures=failures))

    assert drift(60.0) == 0.0
    assert drift(20.0, 60.0) == drift(20.0) == pytest.approx(math.log1p(4.5))


def test_a_degraded_detector_counts_by_what_it_loses() -> None:
    """Half of a silent one, over the same time."""
    silent = situation(outages=[{**FAULT, "kind": "detections"}])
    half = situation(outages=[{**FAULT, "kind": "detections_degraded", "lost_share": 0.5}])
    assert value("blind", half) == pytest.approx(value("blind", silent) / 2)


def test_the_agent_changes_nothing_and_words_hold_the_numbers() -> None:
    """The same situation for any agent; every feature says what it is here."""
    plain = situation()
    other = situation(agent={"manifest": "reference-cautious"})
    assert features_of(other) == features_of(plain)
    assert all(math.isfinite(feature.value) and feature.words for feature in features_of(plain).values())
    assert "of the 300 s allowed" in features_of(plain)["time"].words


def test_a_situation_with_nothing_in_it_has_all_features() -> None:
    """No people, no targets, no reports."""
    spec = situation([])
    assert spec.realized
    nothing = spec.realized.model_copy(update={"actors": (), "reports": ()})
    bare = spec.model_copy(update={"actors": (), "intelligence": (), "realized": nothing})
    nothing_there, plain = features_of(bare), features_of(situation([(0.0, 60.0)]))
    assert nothing_there.keys() == features_of(spec).keys()
    assert all(math.isfinite(feature.value) for feature in nothing_there.values())
    # Nobody to be seen is easier than people in plain view, and no number is made up about them.
    assert nothing_there["people_hidden"].value < plain["people_hidden"].value
    for name, words in (
        ("people_hidden", "there is nobody to be seen"),
        ("target_hidden", "there is no target"),
        ("deadline", "no report has a deadline"),
        ("hurry", "no rule slows the flight near people"),
    ):
        assert nothing_there[name].words == words
    late = situation(rules={"report_deadline_s": 30.0})
    assert re.fullmatch(r"the slowest report takes \d+% of its deadline", features_of(late)["deadline"].words)


def test_a_situation_without_places_is_refused() -> None:
    """Intent alone does not say who stands where."""
    with pytest.raises(SetupError, match="has no places yet"):
        features_of(situation().model_copy(update={"realized": None}))
