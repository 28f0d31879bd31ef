"""PX4's failsafes: what its parameters make of them. Times and texts as its SITL was seen to keep them."""

from __future__ import annotations

import dataclasses

from .._flight import Behaviour
from ..parameters._store import ParameterStore
from ..safety._failsafe_policy import BatteryStep, Failsafes, Reaction, Text
from ..telemetry._texts import EMERGENCY, ERROR, WARNING

_ACTIONS: dict[int, Behaviour] = {
    1: Behaviour.HOLD,
    2: Behaviour.RETURN,
    3: Behaviour.LAND,
    5: Behaviour.TERMINATE,
    6: Behaviour.TERMINATE,  # disarming in the air, which comes to the same
}
_FENCE: dict[int, Behaviour] = {
    2: Behaviour.HOLD,
    3: Behaviour.RETURN,
    4: Behaviour.TERMINATE,
    5: Behaviour.LAND,
}
# Modes for lost setpoints: without sticks position and altitude cannot be flown, and a return takes their place.
_SETPOINTS: dict[int, Behaviour | None] = {4: Behaviour.LAND, 5: Behaviour.HOLD, 6: Behaviour.TERMINATE, 7: Behaviour.TERMINATE}
_ACTIVATED = ((ERROR, "Failsafe activated"),)
_SILENCE_S = 1.9  # until a link that says nothing is seen to be silent: COM_DL_LOSS_T 10 acted after 11.9 s


def failsafes(p: ParameterStore) -> Failsafes:
    hold_s = _hold_s(p)
    setpoints = _SETPOINTS.get(int(p["COM_OBL_RC_ACT"]), Behaviour.RETURN)
    return Failsafes(
        hold_texts=((ERROR, f"Failsafe activated: entering Hold for {hold_s:.0f} seconds"),),
        ground_disarms=False,
        ground_words="",
        strongest=True,
        latched=True,
        station_timeout_s=max(p["COM_DL_LOSS_T"], 1.0) + _SILENCE_S,
        station=_reaction(_ACTIONS.get(int(p["NAV_DLL_ACT"])), hold_s),
        station_note=(WARNING, "Connection to ground station lost"),
        setpoints=Reaction(setpoints, acts=_ACTIVATED, resumes=True),
        sticks=_reaction(_ACTIONS.get(int(p["NAV_RCL_ACT"])), hold_s),
        battery=_battery(p, hold_s),
        position=Reaction(Behaviour.LAND, acts=_ACTIVATED, resumes=True),
    )


def fence_reaction(text: Text, p: ParameterStore) -> Reaction:
    """GF_ACTION: 1 warns; 2 holds and 4 terminates at once; 3 returns and 5 lands after the Hold."""
    reaction = _reaction(_FENCE.get(int(p["GF_ACTION"])), _hold_s(p))
    if reaction is None:
        return Reaction(texts=(text, *_ACTIVATED), shows=False)
    return dataclasses.replace(reaction, texts=(text,))


def _hold_s(p: ParameterStore) -> float:
    return min(max(p["COM_FAIL_ACT_T"], 0.0), 25.0)


def _reaction(action: Behaviour | None, hold_s: float) -> Reaction | None:
    if action is None:
        return None
    at_once = action in (Behaviour.HOLD, Behaviour.TERMINATE)
    return Reaction(action, 0.0 if at_once else hold_s, acts=_ACTIVATED)


def _battery(p: ParameterStore, hold_s: float) -> tuple[BatteryStep, ...]:
    """COM_LOW_BAT_ACT: 0 warns; 2 lands at the critical level; 3 returns when critical, lands in the emergency."""
    action = int(p["COM_LOW_BAT_ACT"])
    critical = {2: Behaviour.LAND, 3: Behaviour.RETURN}.get(action)
    emergency = Behaviour.LAND if action in (2, 3) else None
    warned = () if critical else ((WARNING, "Critical battery"),)
    told = ((EMERGENCY, "Emergency battery level"),)
    return (
        BatteryStep(Reaction(texts=((WARNING, "Low battery"),), shows=False), 2, p["BAT_LOW_THR"]),
        BatteryStep(Reaction(critical, hold_s, warned, _ACTIVATED, shows=bool(critical)), 3, p["BAT_CRIT_THR"]),
        BatteryStep(Reaction(emergency, hold_s, told, _ACTIVATED, shows=bool(emergency)), 4, p["BAT_EMERGEN_THR"]),
    )
