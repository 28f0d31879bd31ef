"""What the services of the flight controller share: flight, airframe, personality, radio, texts and parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ._flight import Airframe, Flight
from ._personality import Personality
from .links._radio import Radio
from .parameters._store import ParameterStore
from .telemetry._texts import Texts


def _anywhere(north_m: float, east_m: float, down_m: float) -> bool:
    return True


@dataclass(slots=True)
class ServiceContext:
    """The things every service stands on."""

    flight: Flight
    airframe: Airframe
    personality: Personality
    radio: Radio
    texts: Texts
    parameters: ParameterStore
    allows: Callable[[float, float, float], bool] = field(default=_anywhere)
    """Whether the fence lets the vehicle fly to a place of the local frame: north, east, down in metres."""
