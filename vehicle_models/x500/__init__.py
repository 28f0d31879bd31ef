"""The X500-class quadrotor: an aircraft file for JSBSim and what flies it."""

from __future__ import annotations

from ._airframe import X500Airframe as X500Airframe
from ._plant import HOVER_THRUST as HOVER_THRUST
from ._plant import ROTOR_ARM_M as ROTOR_ARM_M
from ._plant import ROTOR_TORQUE_M as ROTOR_TORQUE_M
from ._plant import ROTORS as ROTORS
from ._plant import X500Plant as X500Plant
from ._plant import has_crashed as has_crashed
