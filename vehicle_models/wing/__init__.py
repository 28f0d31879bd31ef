"""A foam fixed wing of 2.5 kg: an aircraft file for JSBSim and what flies it."""

from __future__ import annotations

from ._airframe import WingAirframe as WingAirframe
from ._plant import WingPlant as WingPlant
