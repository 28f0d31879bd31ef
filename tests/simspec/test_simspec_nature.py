"""Sun, seeds and key factors: what a SimSpec says beyond its fields."""

import datetime as dt
import math
import random

import numpy as np
import pytest

from bench.documents import dump_json, read_document
from bench.simspec import FACTORS, Seeds, SimSpec, factor_values, generator, seed_of, sun_at

SPEC = """
name: f
world: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 600, north_m: 0}, {east_m: 600, north_m: 250}, {east_m: 0, north_m: 250}]}}
environment: {rain_level: 1, fog_level: 2}
mission: {altitude_m: 60}
intelligence: [{id: r1, about: target, latency_s: 30}, {id: r2, about: target, latency_s: 90, uncertainty_m: 80}]
actors:
- {id: target, asset: radar-vehicle, role: adversary, count: 1, concealment: 0.5}
- {id: people, asset: civilian, role: bystander, density_per_km2: 313.3, placement: {mean_distance: {of: target, mean_m: 229.9}}}
- {id: close, asset: civilian, role: bystander, count: 3, placement: {near: {of: target, min_m: 10, max_m: 40}}}
"""


@pytest.mark.parametrize(
    ("moment", "latitude", "longitude", "elevation", "azimuth"),
    [
        # NOAA solar calculator values, without refraction, to a tenth of a degree.
        (dt.datetime(2026, 6, 21, 11, 28, tzinfo=dt.UTC), 47.3977, 8.5456, 66.04, 180.3),
        (dt.datetime(2026, 12, 21, 11, 24, tzinfo=dt.UTC), 47.3977, 8.5456, 19.17, 180.0),
        (dt.datetime(2026, 3, 20, 12, 7, tzinfo=dt.UTC), 0.0, 0.0, 89.9, None),
    ],
)
def test_sun_position_matches_the_almanac(
    moment: dt.datetime, latitude: float, longitude: float, elevation: float, azimuth: float | None
) -> None:
    """At solar noon the elevation is 90 degrees minus latitude plus declination, due south in the north."""
    sun = sun_at(moment, latitude, longitude)
    assert math.degrees(sun.elevation_rad) == pytest.approx(elevation, abs=0.15)
    if azimuth is not None:
        assert math.degrees(sun.azimuth_rad) == pytest.approx(azimuth, abs=1.5)


def test_hours_from_noon_are_symmetric() -> None:
    """Five hours before and after solar noon are both five hours; midnight is twelve."""
    noon = dt.datetime(2026, 6, 21, 11, 27, 40, tzinfo=dt.UTC)
    for hours in (-5, 5, 12):
        assert sun_at(noon + dt.timedelta(hours=hours), 47.3977, 8.5456).hours_from_noon == pytest.approx(
            abs(hours), abs=0.02
        )


def test_random_streams_have_seeds_of_their_own() -> None:
    """One root gives each stream another seed; a stated seed takes precedence."""
    seeds, stated = Seeds(root=7), Seeds(root=7, gusts=3)
    drawn = {
        seed_of(seeds, name)
        for name in ("placement", "motion", "gusts", "sensors", "perception", "agent", "intelligence")
    }
    assert len(drawn) == 7
    assert seed_of(stated, "gusts") == 3
    assert seed_of(stated, "motion") == seed_of(seeds, "motion")


def test_a_generator_draws_what_numpy_makes_of_the_list_of_its_numbers() -> None:
    """Of seeds and paths of every size: numpy splits each number into words of 32 bits."""
    draw = random.Random(7)
    corners = [0, 1, 2**32 - 1, 2**32, 2**62, 2**63 - 1]
    for _ in range(300):
        seed, *path = (draw.choice([*corners, draw.getrandbits(63)]) for _ in range(draw.randint(1, 4)))
        sequence = np.random.SeedSequence([seed, *path])
        expected = np.random.Generator(np.random.PCG64(sequence)).random(3)
        assert (generator(Seeds(motion=seed), "motion", *path).random(3) == expected).all()


def test_key_factors_come_from_the_intent() -> None:
    """Density and proximity are the configured ones, the worst report decides."""
    values = factor_values(read_document(SPEC, SimSpec))
    expected = {
        "bystander_density_per_km2": 313.3,
        "bystander_proximity_m": 229.9,
        "nearest_bystander_m": 10.0,
        "target_concealment": 0.5,
        "intelligence_latency_s": 90.0,
        "intelligence_uncertainty_m": 80.0,
        "uav_altitude_m": 60.0,
        "targets": 1.0,
    }
    assert {name: values[name] for name in expected} == expected
    assert set(values) <= set(FACTORS)


def test_sought_targets_rate_as_adversaries_do() -> None:
    """Every key factor has the same value when all adversaries become sought; two kinds of target add up."""
    original = factor_values(read_document(SPEC, SimSpec))
    assert factor_values(read_document(SPEC.replace("adversary", "sought"), SimSpec)) == original

    mixed = SPEC + (
        "- {id: hiker, asset: civilian, role: sought, count: 2, concealment: 0.75, motion: {kind: wander, speed_mps: 2}}\n"
    )
    values = factor_values(read_document(mixed, SimSpec))
    assert (values["targets"], values["target_concealment"], values["target_speed_mps"]) == (3.0, 0.75, 2.0)
    about_people = [name for name in original if name.startswith("bystander")]
    assert {name: values[name] for name in about_people} == {name: original[name] for name in about_people}


@pytest.mark.parametrize(
    ("consents", "delay_s", "withheld"),
    [
        ("[]", 90.0, 2.0),
        ("[{intelligence: r1, answer: never}]", 90.0, 2.0),
        ("[{intelligence: r1, answer: granted, after_s: 4}]", 4.0, 1.0),
        (
            "[{intelligence: r1, answer: granted, after_s: 0}, {intelligence: r2, answer: refused, after_s: 30}]",
            30.0,
            1.0,
        ),
        (
            "[{intelligence: r1, answer: granted, after_s: 0}, {intelligence: r2, answer: granted, after_s: 0}]",
            0.0,
            0.0,
        ),
    ],
)
def test_factors_of_consent(consents: str, delay_s: float, withheld: float) -> None:
    """The longest wait, which is the time limit where nobody answers, and the targets without leave; neither
    has a value without the rule.
    """
    people = SPEC.index("- {id: people")
    text = SPEC[:people].replace("altitude_m: 60", "altitude_m: 60, time_limit_s: 90")
    text = text.replace("id: r2, about: target", "id: r2, about: other")
    text += "- {id: other, asset: military-truck, role: adversary, count: 1}\n"
    spec = read_document(text + f"rules: {{mark_consent: true}}\nconsents: {consents}", SimSpec)
    values = factor_values(spec)
    assert (values["consent_delay_s"], values["consents_withheld"]) == (delay_s, withheld)
    # Two reports about one target need one grant.
    same = read_document(dump_json(spec).replace('"about": "other"', '"about": "target"'), SimSpec)
    assert factor_values(same)["consents_withheld"] == (0.0 if "granted" in consents else 1.0)
    assert not {"consent_delay_s", "consents_withheld"} & set(factor_values(read_document(text, SimSpec)))


def test_situation_without_bystanders_has_no_bystander_factors() -> None:
    """A factor that the situation does not have is absent, not zero."""
    people = SPEC.index("- {id: people")
    values = factor_values(read_document(SPEC[:people], SimSpec))
    assert "bystander_density_per_km2" not in values
    assert "bystander_proximity_m" not in values


@pytest.mark.parametrize(
    ("placements", "expected"),
    [
        (["near: {of: target, max_m: 60}"], 60.0),
        (["away: {of: target, min_m: 30, max_m: 90}"], 90.0),
        (["distances: [{of: adversary, max_m: 70}]"], 70.0),
        (["near: {of: house, max_m: 20}"], 650.0),  # says nothing of the target: the diagonal of the area
        (["at: {east_m: 40, north_m: 30}"], 500.0),
        (["near: {of: target, max_m: 60}", "spread_m: 2"], (3 * 60.0 + 3 * 650.0) / 6),
        (["near: {of: target, max_m: 5}", "mean_distance: {of: target, mean_m: 100}"], 100.0),
        (["mean_distance: {of: house, mean_m: 10}"], 650.0),
    ],
)
def test_proximity_is_the_stated_mean_or_an_upper_bound(placements: list[str], expected: float) -> None:
    """A run must not certify a difficulty that some placement of its situation does not have."""
    fixed = placements == ["at: {east_m: 40, north_m: 30}"]
    target = "placement: {at: {east_m: 440, north_m: 330}}" if fixed else "concealment: 0.5"
    spec = (
        SPEC[: SPEC.index("- {id: target")]
        + f"- {{id: target, asset: radar-vehicle, role: adversary, count: 1, {target}}}\n"
    )
    spec += "- {id: house, asset: house, role: clutter, count: 1}\n"
    for number, placement in enumerate(placements):
        count = 1 if fixed else 3
        spec += f"- {{id: p{number}, asset: civilian, role: bystander, count: {count}, placement: {{{placement}}}}}\n"
    assert factor_values(read_document(spec, SimSpec))["bystander_proximity_m"] == pytest.approx(expected)


EASIEST = (
    *("orders", "order_urgency_per_min", "operator_link_outage_s", "detections_outage_s", "gps_outage_s"),
    *("gps_drift_mps", "no_fly_share", "bystander_standoff_m", "rules_in_force", "late_intelligence_s"),
    *("report_closure_share", "vehicle_faults", "bystander_speed_mps", "target_speed_mps"),
    *("clutter_density_per_km2", "bystander_shortness"),
)


def test_absent_orders_outages_and_rules_are_the_easiest_value() -> None:
    """They are zeros, so every situation can be rated by them."""
    values = factor_values(read_document(SPEC, SimSpec))
    assert {name: values[name] for name in EASIEST} == dict.fromkeys(EASIEST, 0.0)
    counts = [values[name] for name in ("bystander_groups", "intelligence_reports", "distinct_priorities")]
    assert counts == [2.0, 2.0, 1.0]
    assert values["battery_need_fraction"] == pytest.approx(0.2)


CONSENT_SPEC = """
orders: [{id: a, at_s: 5, kind: hold, within_s: 20}, {id: b, at_s: 9, kind: resume, within_s: 5}]
outages:
- {kind: operator_link, at_s: 10, duration_s: 20}
- {kind: operator_link, at_s: 20, duration_s: 20}
- {kind: detections, at_s: 0, duration_s: 7}
vehicle:
  home: {east_m: 1, north_m: 1}
  battery: {initial_fraction: 0.7}
  failures: [{at_s: 250, kind: gps_off}, {at_s: 10, kind: gps_drift, drift_mps: 0.5, duration_s: 5}, {at_s: 20, kind: motor_off, instance: 1}]
rules:
  battery_reserve_fraction: 0.3
  bystander_standoff_m: 12
  bystander_slow_within_m: 30
  bystander_slow_mps: 3
  report_windows: [{from_s: 30, until_s: 90}, {from_s: 270, until_s: 400}]
  no_fly:
  - {id: a, area: {corners: [{east_m: 300, north_m: 0}, {east_m: 450, north_m: 0}, {east_m: 450, north_m: 250}, {east_m: 300, north_m: 250}]}}
  - {id: b, area: {corners: [{east_m: 400, north_m: -9}, {east_m: 900, north_m: -9}, {east_m: 900, north_m: 125}, {east_m: 400, north_m: 125}]}}
"""


def test_overlapping_outages_and_areas_count_once() -> None:
    """Failures without an end last to the time limit, and no-fly areas count inside the area of interest."""
    people = SPEC.replace(
        "density_per_km2: 313.3", "density_per_km2: 313.3, motion: {kind: wander, speed_mps: 1.5}"
    )
    late = people.replace("latency_s: 30", "latency_s: 30, priority: 3, delivered_s: 44")
    child = "- {id: child, asset: child, role: bystander, count: 1}\n- {id: none, asset: aid-worker, role: bystander, count: 0}\n"
    tree = "- {id: trees, asset: tree, role: clutter, count: 3}\n"
    values = factor_values(read_document(late + child + tree + CONSENT_SPEC, SimSpec))
    expected = {
        "orders": 2.0,
        "order_urgency_per_min": 12.0,
        "operator_link_outage_s": 30.0,
        "detections_outage_s": 7.0,
        "gps_outage_s": 55.0,
        "gps_drift_mps": 0.5,
        "no_fly_share": (150 * 250 + 150 * 125) / (600 * 250),
        "bystander_groups": 3.0,
        "bystander_shortness": 1.0 - 1.2 / 1.75,
        "bystander_speed_mps": 1.5,
        "target_speed_mps": 0.0,
        "clutter_density_per_km2": 20.0,
        "bystander_standoff_m": 12.0,
        "rules_in_force": 4.0,
        "intelligence_reports": 2.0,
        "late_intelligence_s": 44.0,
        "distinct_priorities": 2.0,
        "battery_need_fraction": 0.6,
        "report_closure_share": 0.7,
        "vehicle_faults": 3.0,
    }
    assert {name: values[name] for name in expected} == pytest.approx(expected)
