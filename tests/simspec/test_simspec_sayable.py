"""Visibility, gusts, colours and places where somebody was last seen: the simulation does what these fields state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from bench.camera import conditions_of, light_of_conditions, look_of, look_tables
from bench.contracts import CastMember
from bench.perception import DetectionOdds
from bench.realization.placement import check_placement, place
from bench.simspec import ASSETS, FACTORS, ActorGroup, Role, SimSpec
from vehicle_models._gusts import Gusts

AREA = {
    "corners": [{"east_m": e, "north_m": n} for e, n in ((-300, -300), (300, -300), (300, 300), (-300, 300))]
}


def simspec(environment: dict[str, Any] | None = None, **parts: Any) -> SimSpec:
    return SimSpec.model_validate(
        {
            "name": "sayable",
            "world": {"area": AREA},
            "environment": environment or {},
            "vehicle": {"home": {"east_m": -250, "north_m": 0}},
            **parts,
        }
    )


@pytest.mark.parametrize(
    "weather", [{}, {"rain_level": 2}, {"dust_level": 1.5}, {"dust_level": 9, "rain_level": 9}]
)
@pytest.mark.parametrize("visibility_m", [60.0, 500.0, 8000.0])
def test_visibility_leaves_two_percent_of_the_contrast_at_its_distance(
    visibility_m: float, weather: dict[str, Any]
) -> None:
    """For detections and for pictures alike, whatever else is in the air."""
    spec = simspec({"visibility_m": visibility_m, **weather})
    light = light_of_conditions(conditions_of(spec))
    for extinction_per_m in (DetectionOdds.of(spec).extinction_per_m, light.extinction_per_m):
        assert math.exp(-extinction_per_m * visibility_m) == pytest.approx(0.02, rel=1e-6)


@pytest.mark.parametrize("level", [1.5, 4.5, 9.0])
def test_the_visibility_of_a_fog_level_is_rated_and_drawn_as_that_level(level: float) -> None:
    fog = simspec({"fog_level": level})
    same = simspec({"visibility_m": -math.log(0.02) / (0.00012 * level**2)})
    assert FACTORS["fog_level"].read(same) == pytest.approx(level)
    assert conditions_of(same).fog_level == pytest.approx(level)
    assert DetectionOdds.of(same).extinction_per_m == pytest.approx(DetectionOdds.of(fog).extinction_per_m)


def test_dust_that_explains_the_visibility_leaves_no_fog() -> None:
    dust = simspec({"dust_level": 6.0, "visibility_m": 5000.0})
    assert FACTORS["fog_level"].read(dust) == 0.0
    assert FACTORS["fog_level"].read(simspec({"visibility_m": 50.0})) == 9.0


def test_fog_and_visibility_are_not_both_stated() -> None:
    with pytest.raises(ValidationError, match="either fog_level or visibility_m"):
        simspec({"fog_level": 3, "visibility_m": 500})


def test_the_peaks_of_stated_gusts_reach_their_speed() -> None:
    """The reader turns gusts of G m/s over a mean wind of U into turbulence, so that U and three sigma are G at 6 m."""
    from bench.instance_analysis import load_vocabulary, read_prose

    wind = read_prose(
        "Wind 9 m/s from the west, gusts of 14 m/s.", load_vocabulary()
    ).simspec.environment.wind
    gusts = Gusts(wind, 0.1, np.random.default_rng(1))
    # Long enough for many independent gusts.
    along = np.array([gusts.step(20.0 * 0.3048, 10.0)[1] for _ in range(60_000)])
    assert wind.speed_mps + 3.0 * along.std() == pytest.approx(14.0, rel=0.05)


@pytest.mark.parametrize("asset", sorted(ASSETS))
def test_a_stated_colour_is_drawn_on_every_asset_and_changes_no_other_draw(asset: str) -> None:
    def colours(color: str | None) -> np.ndarray[Any, Any]:
        group = ActorGroup(id="g", asset=asset, role=Role.CLUTTER, count=1, color=color)
        return look_of(CastMember.of("a", group), 0.0, np.random.default_rng(3), np.zeros(3)).colours_bgr

    assert asset in look_tables()
    plain, red, blue = colours(None), colours("red"), colours("blue")
    painted = (red != blue).any(axis=1)
    assert painted.any()
    # Blue, green, red.
    assert (red[painted, 2] > 2.0 * red[painted, 0]).all()
    assert (plain[~painted] == red[~painted]).all()


def seen_at(**distance: float) -> dict[str, Any]:
    point = {"east_m": 80, "north_m": -40}
    placement = {"distances": [{"point": point, **distance}]} if distance else {}
    return {
        "actors": [{"id": "woman", "asset": "woman", "role": "sought", "count": 1, "placement": placement}],
        "intelligence": [{"id": "seen", "about": "woman", "uncertainty_m": 60, "at": point}],
    }


def test_a_report_of_where_somebody_was_last_seen_is_delivered_with_that_place() -> None:
    for seed in range(5):
        placed = place(simspec(**seen_at(max_m=60), seeds={"root": seed}))
        realized = placed.realized
        assert realized is not None
        assert [(report.east_m, report.north_m) for report in realized.reports] == [(80, -40)]
        assert not check_placement(placed)
        woman = realized.actors[0]
        assert 0.0 < math.hypot(woman.east_m - 80, woman.north_m + 40) <= 60.0


@pytest.mark.parametrize("distance", [{}, {"max_m": 61}, {"min_m": 5}])
def test_a_report_at_a_place_needs_a_placement_that_keeps_it_true(distance: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match="nothing keeps 'woman' within 60 m of it"):
        simspec(**seen_at(**distance))
