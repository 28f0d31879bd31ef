"""What the services of the flight controller share."""

from __future__ import annotations

from dataclasses import dataclass

from ..._geodesy import LocalFrame
from ..links._radio import Radio
from ._flight_state import Airframe, FlightState
from ._parameter_store import ParameterStore
from ._texts import Texts


@dataclass(frozen=True, slots=True)
class ServiceContext:
    """The vehicle's state, airframe, local frame and parameters, and the ways to talk to clients."""

    flight: FlightState
    airframe: Airframe
    frame: LocalFrame
    radio: Radio
    texts: Texts
    parameters: ParameterStore
