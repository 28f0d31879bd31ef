"""ArduCopter's failsafes: what its parameters make of them."""

from __future__ import annotations

from .._flight import Behaviour
from ..parameters._store import ParameterStore
from ..safety._failsafe_policy import BatteryStep, Failsafes, Reaction
from ..telemetry._texts import CRITICAL, WARNING

_BATTERY = {1: Behaviour.LAND, 2: Behaviour.RETURN, 3: Behaviour.RETURN, 4: Behaviour.RETURN, 5: Behaviour.TERMINATE}
_STATION = {1: Behaviour.RETURN, 3: Behaviour.RETURN, 4: Behaviour.RETURN, 5: Behaviour.LAND}
_RADIO = {1: Behaviour.RETURN, 3: Behaviour.LAND, 4: Behaviour.RETURN, 5: Behaviour.RETURN}
_RADIO_S = 0.8


def failsafes(p: ParameterStore) -> Failsafes:
    station, radio = _STATION.get(int(p["FS_GCS_ENABLE"])), _RADIO.get(int(p["FS_THR_ENABLE"]))
    lands = int(p["FS_EKF_ACTION"]) in (1, 2, 3)
    return Failsafes(
        hold_texts=(),
        ground_disarms=True,
        ground_words=" - Disarming",
        strongest=False,
        latched=False,
        station_timeout_s=max(p["FS_GCS_TIMEOUT"], 1.0),
        station=Reaction(station, texts=((WARNING, "GCS Failsafe"),)) if station else None,
        station_back=((WARNING, "GCS Failsafe Cleared"),),
        battery=tuple(
            step
            for step in (
                _battery(p, "low", p["BATT_LOW_VOLT"], p["BATT_FS_LOW_ACT"]),
                _battery(p, "critical", p["BATT_CRT_VOLT"], p["BATT_FS_CRT_ACT"]),
            )
            if step.volts > 0.0
        ),
        position=Reaction(
            Behaviour.LAND,
            texts=((CRITICAL, "EKF variance: position lost"), (CRITICAL, "EKF Failsafe: changed to LAND Mode")),
        )
        if lands
        else None,
        radio=Reaction(radio, texts=((WARNING, "Radio Failsafe"),)) if radio else None,
        radio_silent=p["SIM_RC_FAIL"] > 0.0,
        radio_after_s=_RADIO_S,
        radio_back=((WARNING, "Radio Failsafe Cleared"),),
    )


def _battery(p: ParameterStore, word: str, volts: float, action: float) -> BatteryStep:
    """Charge states were seen to go from 1 to 3 when the battery was low."""
    texts = ((WARNING, f"Battery 1 is {word} {{volts:.2f}}V used {{used_mah:.0f}} mAh"), (WARNING, "Battery Failsafe"))
    reaction = Reaction(_BATTERY.get(int(action)), texts=texts)
    return BatteryStep(reaction, 3, volts=volts, lasts_s=max(p["BATT_LOW_TIMER"], 0.0))
