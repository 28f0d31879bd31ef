"""How high and fast the rules let the reference agents fly; for the careful one, those about people too."""

from __future__ import annotations

import math

from bench.simspec import SimSpec

from ...flight._caution import SLOW_SHARE, Caution
from ...flight._limits import HEIGHT_RULE_MARGIN_M, SPEED_RULE_MARGIN_MPS


def limits(simspec: SimSpec, *, careful: bool) -> dict[str, float | bool]:
    """The limits of a mission, by their names in a Batch; `slow_mps` inf where nobody minds people."""
    rules, mission = simspec.rules, simspec.mission
    caution = Caution(
        standoff_m=rules.bystander_standoff_m if careful else 0.0,
        slow_within_m=rules.bystander_slow_within_m if careful else None,
        slow_mps=rules.bystander_slow_mps if careful and rules.bystander_slow_within_m is not None else None,
        max_loiter_s=rules.max_loiter_over_bystander_s if careful else None,
    )
    floor_m = 0.0 if rules.min_altitude_m is None else rules.min_altitude_m + HEIGHT_RULE_MARGIN_M
    height_m = max(min(mission.altitude_m, rules.max_altitude_m), floor_m)
    ceiling_m = max(rules.max_altitude_m - HEIGHT_RULE_MARGIN_M, height_m)
    speed_mps = mission.speed_mps
    if rules.max_speed_mps is not None:
        slower_mps = max(rules.max_speed_mps - SPEED_RULE_MARGIN_MPS, 0.5 * rules.max_speed_mps)
        speed_mps = min(speed_mps, slower_mps)
    slow_mps = math.inf if caution.slow_mps is None else SLOW_SHARE * caution.slow_mps
    return {
        "height_m": caution.height_m(height_m, ceiling_m),
        "floor_m": rules.min_altitude_m or 0.0,
        "speed_mps": speed_mps,
        "pace_mps": min(speed_mps, slow_mps),
        "slow_mps": slow_mps,
        "slow_within_m": (caution.slow_within_m or 0.0) if math.isfinite(slow_mps) else 0.0,
        "keeps_up": caution.watches or rules.min_altitude_m is not None,
    }
