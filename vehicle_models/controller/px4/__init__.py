"""PX4's way, as observed on its SITL (docs/flight-controller.md says where this differs)."""

from __future__ import annotations

from ._personality import Px4 as Px4
from ._wing import Px4Wing as Px4Wing
