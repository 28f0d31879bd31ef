"""Simulated aircraft with their flight controllers: JSBSim flies, MAVLink services talk.

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500

plan = VehiclePlan(simspec, (LinkSpec("onboard", "udp_out", port=14540),))
with open_x500(plan) as vehicle:
    vehicle.receive()
    vehicle.step()
    print(vehicle.truth(), vehicle.condition())
"""

from __future__ import annotations

from ._aircraft import open_x500 as open_x500
from ._geodesy import TangentPlane as TangentPlane
from ._wing import open_wing as open_wing
