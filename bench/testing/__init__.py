"""Fakes that obey the real contracts, as a product: for the bench's own tests and for plug-ins that live
elsewhere.

`python -m bench.testing.agent --behaviour NAME` is an agent that does one thing, good or bad;
`agent_manifest` describes it.
"""

from __future__ import annotations

from ._manifest import BEHAVIOURS as BEHAVIOURS
from ._manifest import agent_manifest as agent_manifest
from ._still_vehicle import StillVehicle as StillVehicle
from ._still_vehicle import open_still_vehicle as open_still_vehicle
