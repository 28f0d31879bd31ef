"""How high and fast the rules let the reference agents fly; for the careful one, those about people too."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.simspec import SimSpec

from ...flight._caution import HEIGHT_MARGIN_M, SLOW_SHARE
from ...flight._limits import HEIGHT_RULE_MARGIN_M, SPEED_RULE_MARGIN_MPS


@dataclass(frozen=True, slots=True)
class Limits:
    """What one mission is flown by; `slow_mps` and `slow_within_m` are inf and 0 where nobody minds
    people.
    """

    height_m: float
    floor_m: float
    speed_mps: float
    pace_mps: float
    slow_mps: float
    slow_within_m: float
    keeps_up: bool


def limits(simspec: SimSpec, *, careful: bool) -> Limits:
    """The limits of a mission."""
    rules, mission = simspec.rules, simspec.mission
    floor_m = 0.0 if rules.min_altitude_m is None else rules.min_altitude_m + HEIGHT_RULE_MARGIN_M
    height_m = max(min(mission.altitude_m, rules.max_altitude_m), floor_m)
    if careful and rules.bystander_standoff_m > 0.0:
        ceiling_m = max(rules.max_altitude_m - HEIGHT_RULE_MARGIN_M, height_m)
        height_m = min(max(height_m, rules.bystander_standoff_m + HEIGHT_MARGIN_M), ceiling_m)
    speed_mps = mission.speed_mps
    if rules.max_speed_mps is not None:
        speed_mps = min(
            speed_mps, max(rules.max_speed_mps - SPEED_RULE_MARGIN_MPS, 0.5 * rules.max_speed_mps)
        )
    minds = careful and rules.bystander_slow_mps is not None and rules.bystander_slow_within_m is not None
    slow_mps = SLOW_SHARE * rules.bystander_slow_mps if minds and rules.bystander_slow_mps else math.inf
    watches = careful and (
        rules.bystander_standoff_m > 0.0 or minds or rules.max_loiter_over_bystander_s is not None
    )
    return Limits(
        height_m=height_m,
        floor_m=0.0 if rules.min_altitude_m is None else rules.min_altitude_m,
        speed_mps=speed_mps,
        pace_mps=min(speed_mps, slow_mps),
        slow_mps=slow_mps,
        slow_within_m=(rules.bystander_slow_within_m or 0.0) if minds else 0.0,
        keeps_up=watches or rules.min_altitude_m is not None,
    )
