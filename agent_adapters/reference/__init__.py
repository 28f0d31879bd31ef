"""The reference agent: it goes to reported sub-areas, searches them, and reports what it identifies there.

An agent like any other: it knows the air network (MAVLink and the topics that an agent may use) and nothing
else. Run as `python -m agent_adapters.reference --policy naive|bystander_aware`; docs/agents-reference.md tells how it
decides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._settings import Settings as Settings
    from ._steps import Steps as Steps
    from .perception._camera import GroundCamera as GroundCamera
    from .perception._pose import VehiclePose as VehiclePose

__getattr__ = lazy_names(__name__)
