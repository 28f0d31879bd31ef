"""ArduCopter's failsafes, fence and battery: what its parameters make of them."""

from __future__ import annotations

import math

from ..policies._choices import choices
from ..policies._safety import (
    AidingTexts,
    BatteryStep,
    Breach,
    FailsafeSettings,
    FenceLimits,
    FencePolicy,
    Reaction,
    SafetyPolicy,
)
from ..state._flight_state import Behaviour, FlightState
from ..state._parameter_store import ParameterStore
from ..state._service import CommandResult, Refusal
from ..state._texts import CRITICAL, INFO, NOTICE, WARNING, StatusText

_BATTERY_ACTIONS = {
    1: Behaviour.LAND,
    2: Behaviour.RETURN,
    3: Behaviour.RETURN,
    4: Behaviour.RETURN,
    5: Behaviour.TERMINATE,
}
_STATION_ACTIONS = {1: Behaviour.RETURN, 3: Behaviour.RETURN, 4: Behaviour.RETURN, 5: Behaviour.LAND}
_RADIO_ACTIONS = {1: Behaviour.RETURN, 3: Behaviour.LAND, 4: Behaviour.RETURN, 5: Behaviour.RETURN}
_RADIO_TIMEOUT_S = 0.8
# Source: EKF3 gives its position up 7 s after the last fix, and its check waits for ten samples at 10 Hz. A real one
# landed 8.0 s after its satellites were gone.
_DEAD_RECKONING_S, _POSITION_CONFIRMED_S = 7.0, 1.0
# Source: without any aiding for 15 s each of the two filters holds a constant position.
_AIDING = AidingTexts(
    15.0,
    lost=tuple((WARNING, f"EKF3 IMU{number} stopped aiding") for number in (0, 1)),
    back=tuple((INFO, f"EKF3 IMU{number} is using GPS") for number in (0, 1)),
)
# Source: a landing of a failsafe begins its descent so much later; that of the fence begins at once.
_LAND_DELAY_S = 4.0
# Of the vehicle's own battery.
_FULL_BATTERY_V = 16.6

# FENCE_TYPE
_CEILING, _CIRCLE, _POLYGON = 1, 2, 4
# FENCE_ACTION: report, return, land, smart return, brake, smart return or land.
_FENCE_ACTIONS = {
    0: None,
    1: Behaviour.RETURN,
    2: Behaviour.LAND,
    3: Behaviour.RETURN,
    4: Behaviour.HOLD,
    5: Behaviour.RETURN,
}
_FENCE_TEXTS: dict[Breach, StatusText] = {
    Breach.CEILING: (NOTICE, "Max Alt fence breached"),
    Breach.CIRCLE: (NOTICE, "Circle fence breached"),
    Breach.POLYGON: (NOTICE, "Polygon fence breached"),
}
# Farther outside than this it lands, whatever FENCE_ACTION is.
_LANDS_BEYOND_M = 100.0


def _failsafes(p: ParameterStore) -> FailsafeSettings:
    station = _STATION_ACTIONS.get(int(p["FS_GCS_ENABLE"]))
    radio = _RADIO_ACTIONS.get(int(p["FS_THR_ENABLE"]))
    lands = int(p["FS_EKF_ACTION"]) in (1, 2, 3)
    battery_steps = (
        _battery_step(p, "low", p["BATT_LOW_VOLT"], p["BATT_FS_LOW_ACT"]),
        _battery_step(p, "critical", p["BATT_CRT_VOLT"], p["BATT_FS_CRT_ACT"]),
    )
    position_texts = ((CRITICAL, "EKF Failsafe: changed to LAND Mode"),)
    return FailsafeSettings(
        hold_texts=(),
        disarms_on_ground=True,
        disarm_suffix=" - Disarming",
        strongest=False,
        latched=False,
        station_timeout_s=max(p["FS_GCS_TIMEOUT"], 1.0),
        station=_reaction(station, ((WARNING, "GCS Failsafe"),)) if station else None,
        station_back_texts=((WARNING, "GCS Failsafe Cleared"),),
        battery=tuple(step for step in battery_steps if step.volts > 0.0),
        position=_reaction(Behaviour.LAND, position_texts) if lands else None,
        position_confirmed_s=_POSITION_CONFIRMED_S,
        position_lost_texts=((CRITICAL, "EKF variance"),),
        position_back_texts=((CRITICAL, "EKF Failsafe Cleared"),),
        aiding=_AIDING,
        radio=_reaction(radio, ((WARNING, "Radio Failsafe"),)) if radio else None,
        radio_silent=p["SIM_RC_FAIL"] > 0.0,
        radio_timeout_s=_RADIO_TIMEOUT_S,
        radio_back_texts=((WARNING, "Radio Failsafe Cleared"),),
    )


def _reaction(action: Behaviour | None, texts: tuple[StatusText, ...]) -> Reaction:
    return Reaction(action, texts=texts, land_delay_s=_LAND_DELAY_S)


def _battery_step(p: ParameterStore, level: str, volts: float, action: float) -> BatteryStep:
    # Charge states were seen to go from 1 (OK) to 3 (critical) when the battery was low.
    texts = (
        (WARNING, f"Battery 1 is {level} {{volts:.2f}}V used {{used_mah:.0f}} mAh"),
        (WARNING, "Battery Failsafe"),
    )
    reaction = _reaction(_BATTERY_ACTIONS.get(int(action)), texts)
    return BatteryStep(reaction, 3, volts=volts, lasts_s=max(p["BATT_LOW_TIMER"], 0.0))


def _fence_limits(p: ParameterStore) -> FenceLimits:
    kinds = int(p["FENCE_TYPE"])
    return FenceLimits(
        radius_m=max(p["FENCE_RADIUS"], 1.0) if kinds & _CIRCLE else None,
        ceiling_m=p["FENCE_ALT_MAX"] if kinds & _CEILING else None,
        polygons=bool(kinds & _POLYGON),
        enabled=True,
        ceiling_margin_m=max(p["FENCE_MARGIN"], 0.0),
    )


def _fence_reaction(breach: Breach, outside_m: float, p: ParameterStore) -> Reaction:
    """A breach is no failsafe: the heartbeat stays as it is."""
    action = _FENCE_ACTIONS.get(int(p["FENCE_ACTION"]), Behaviour.RETURN)
    if action and outside_m > _LANDS_BEYOND_M:
        action = Behaviour.LAND
    return Reaction(action, texts=(_FENCE_TEXTS[breach],), shows=False)


def _rally_limit_m(p: ParameterStore) -> float:
    return p["RALLY_LIMIT_KM"] * 1000.0 if p["RALLY_LIMIT_KM"] > 0.0 else math.inf


def battery_volts(flight: FlightState, p: ParameterStore) -> float:
    """SIM_BATT_VOLTAGE is that of a full battery; it falls as that of the vehicle's own battery does."""
    return p["SIM_BATT_VOLTAGE"] * flight.battery_v / _FULL_BATTERY_V


SAFETY = SafetyPolicy(
    **choices(SafetyPolicy, "ardupilot"),
    failsafes=_failsafes,
    fence=FencePolicy(
        **choices(FencePolicy, "ardupilot"),
        limits=_fence_limits,
        reaction=_fence_reaction,
        outside=Refusal(CommandResult.FAILED),
        rally_limit_m=_rally_limit_m,
        rally_includes_home=lambda p: bool(p["RALLY_INCL_HOME"]),
        uses_rally=lambda p: True,
    ),
    is_ground_station=lambda system, p: system == int(p["SYSID_MYGCS"]),
    dead_reckoning_s=_DEAD_RECKONING_S,
    battery_volts=battery_volts,
)
