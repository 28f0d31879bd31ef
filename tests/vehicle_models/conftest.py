from __future__ import annotations

from vehicle_client import copter as copter
from vehicle_client import make as make
from vehicle_client import px4 as px4
