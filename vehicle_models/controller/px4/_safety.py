"""PX4's failsafes, fence and battery. Times and texts of failsafes are as its SITL was seen to keep them.

A breach of the fence was not observed on the link; its messages follow PX4's source.
"""

from __future__ import annotations

import dataclasses
import math

from ..policies._choices import choices
from ..policies._safety import (
    BatteryStep,
    Breach,
    FailsafeSettings,
    FenceLimits,
    FencePolicy,
    Reaction,
    SafetyPolicy,
    SimulatedDischarge,
)
from ..state._flight_state import Behaviour, FlightState
from ..state._parameter_store import ParameterStore
from ..state._service import CommandResult, Refusal
from ..state._texts import CRITICAL, EMERGENCY, WARNING, StatusText

_ACTIONS: dict[int, Behaviour] = {
    1: Behaviour.HOLD,
    2: Behaviour.RETURN,
    3: Behaviour.LAND,
    5: Behaviour.TERMINATE,
    6: Behaviour.TERMINATE,  # disarming in the air, which comes to the same
}
_FENCE_ACTIONS: dict[int, Behaviour] = {
    2: Behaviour.HOLD,
    3: Behaviour.RETURN,
    4: Behaviour.TERMINATE,
    5: Behaviour.LAND,
}
# To lost setpoints. Position and altitude modes need sticks, and a return takes their place.
_SETPOINT_ACTIONS: dict[int, Behaviour | None] = {
    4: Behaviour.LAND,
    5: Behaviour.HOLD,
    6: Behaviour.TERMINATE,
    7: Behaviour.TERMINATE,
}
# By PX4's source, like the text of the Hold; the observations have the words alone.
_ACTIVATED = ((CRITICAL, "Failsafe activated"),)
# EKF2_NOAID_TOUT; a real one landed 5.1 s after its satellites were gone.
_DEAD_RECKONING_S, _POSITION_CONFIRMED_S = 5.0, 0.1
# Until a silent link is noticed: with COM_DL_LOSS_T at 10, the SITL acted after 11.9 s.
_SILENCE_S = 1.9
# Defaults of SIM_BAT_DRAIN and SIM_BAT_MIN_PCT.
_SITL_BATTERY = (60.0, 50.0)
_FENCE_TEXTS: dict[Breach, StatusText] = {
    Breach.CEILING: (CRITICAL, "Geofence: exceeding maximum altitude above Home"),
    Breach.CIRCLE: (CRITICAL, "Geofence: exceeding maximum distance to Home"),
    Breach.POLYGON: (CRITICAL, "Geofence: approaching or outside geofence"),
}


def _failsafes(p: ParameterStore) -> FailsafeSettings:
    hold_s = _hold_s(p)
    setpoint_action = _SETPOINT_ACTIONS.get(int(p["COM_OBL_RC_ACT"]), Behaviour.RETURN)
    return FailsafeSettings(
        hold_texts=((CRITICAL, f"Failsafe activated: entering Hold for {hold_s:.0f} seconds"),),
        disarms_on_ground=False,
        disarm_suffix="",
        strongest=True,
        latched=True,
        station_timeout_s=max(p["COM_DL_LOSS_T"], 1.0) + _SILENCE_S,
        station=_reaction(_ACTIONS.get(int(p["NAV_DLL_ACT"])), hold_s),
        station_lost_event=(WARNING, "Connection to ground station lost"),
        setpoints=Reaction(setpoint_action, action_texts=_ACTIVATED, resumes=True),
        # Its commander's last resort for any mode that cannot run (source).
        external_mode=Reaction(Behaviour.RETURN, action_texts=_ACTIVATED, resumes=True),
        sticks=_reaction(_ACTIONS.get(int(p["NAV_RCL_ACT"])), hold_s),
        battery=_battery(p, hold_s),
        position=Reaction(Behaviour.LAND, action_texts=_ACTIVATED, resumes=True),
        position_confirmed_s=_POSITION_CONFIRMED_S,
    )


def _hold_s(p: ParameterStore) -> float:
    return min(max(p["COM_FAIL_ACT_T"], 0.0), 25.0)


def _reaction(action: Behaviour | None, hold_s: float) -> Reaction | None:
    if action is None:
        return None
    # A Hold before a Hold or a termination would only delay it.
    at_once = action in (Behaviour.HOLD, Behaviour.TERMINATE)
    return Reaction(action, 0.0 if at_once else hold_s, action_texts=_ACTIVATED)


def _battery(p: ParameterStore, hold_s: float) -> tuple[BatteryStep, ...]:
    """COM_LOW_BAT_ACT: 0 warns; 2 lands when critical; 3 returns when critical, lands in the emergency."""
    action = int(p["COM_LOW_BAT_ACT"])
    critical = {2: Behaviour.LAND, 3: Behaviour.RETURN}.get(action)
    emergency = Behaviour.LAND if action in (2, 3) else None
    critical_texts = () if critical else ((CRITICAL, "Critical battery"),)
    emergency_texts = ((EMERGENCY, "Emergency battery level"),)
    return (
        BatteryStep(Reaction(texts=((CRITICAL, "Low battery"),), shows=False), 2, p["BAT_LOW_THR"]),
        BatteryStep(
            Reaction(critical, hold_s, critical_texts, _ACTIVATED, shows=bool(critical)), 3, p["BAT_CRIT_THR"]
        ),
        BatteryStep(
            Reaction(emergency, hold_s, emergency_texts, _ACTIVATED, shows=bool(emergency)),
            4,
            p["BAT_EMERGEN_THR"],
        ),
    )


def _fence_limits(p: ParameterStore) -> FenceLimits:
    return FenceLimits(
        radius_m=p["GF_MAX_HOR_DIST"] if p["GF_MAX_HOR_DIST"] > 0.0 else None,
        ceiling_m=p["GF_MAX_VER_DIST"] if p["GF_MAX_VER_DIST"] > 0.0 else None,
        polygons=True,
        enabled=int(p["GF_ACTION"]) != 0,
    )


def _fence_reaction(breach: Breach, outside_m: float, p: ParameterStore) -> Reaction:
    """GF_ACTION: 1 warns; 2 holds and 4 terminates at once; 3 returns and 5 lands after the Hold."""
    text = _FENCE_TEXTS[breach]
    reaction = _reaction(_FENCE_ACTIONS.get(int(p["GF_ACTION"])), _hold_s(p))
    if reaction is None:
        return Reaction(texts=(text, *_ACTIVATED), shows=False)
    return dataclasses.replace(reaction, texts=(text,))


def _simulated_discharge(p: ParameterStore) -> SimulatedDischarge | None:
    """Asked for by other than the default drain or least charge; the vehicle's own battery does not follow."""
    drain_s, min_percent = p["SIM_BAT_DRAIN"], p["SIM_BAT_MIN_PCT"]
    if (drain_s, min_percent) == _SITL_BATTERY or p["SIM_BAT_ENABLE"] != 1.0:
        return None
    return SimulatedDischarge(max(drain_s, 1.0), min(max(min_percent, 0.0), 100.0) / 100.0)


def _battery_volts(flight: FlightState, p: ParameterStore) -> float:
    if flight.simulated_fraction is None:
        return flight.battery_v
    empty_v, full_v = p["BAT1_V_EMPTY"], p["BAT1_V_CHARGED"]
    return max(p["BAT1_N_CELLS"], 1.0) * (empty_v + (full_v - empty_v) * flight.simulated_fraction)


SAFETY = SafetyPolicy(
    **choices(SafetyPolicy, "px4"),
    failsafes=_failsafes,
    fence=FencePolicy(
        **choices(FencePolicy, "px4"),
        limits=_fence_limits,
        reaction=_fence_reaction,
        outside=Refusal(CommandResult.ACCEPTED, ((CRITICAL, "Reposition is outside geofence"),)),
        rally_limit_m=lambda p: math.inf,
        rally_includes_home=lambda p: True,
        uses_rally=lambda p: int(p["RTL_TYPE"]) == 0,  # 0: home or the nearest rally point
    ),
    is_ground_station=lambda system, p: True,
    dead_reckoning_s=_DEAD_RECKONING_S,
    battery_volts=_battery_volts,
    simulated_discharge=_simulated_discharge,
)
