"""PX4 on a fixed wing: its parameters, limits and airspeed; all else is as on the quadrotor."""

from __future__ import annotations

from dataclasses import replace

from ..links._enums import MAV_TYPE
from ..px4 import PX4
from ._parameters import PARAMETERS

PX4_WING = replace(
    PX4,
    identity=replace(PX4.identity, vehicle_type=MAV_TYPE.FIXED_WING),
    parameters=PARAMETERS,
    # A fixed wing has an airspeed sensor.
    telemetry=replace(PX4.telemetry, airspeed_mps=lambda flight: flight.airspeed_mps),
)
