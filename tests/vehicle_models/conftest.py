from __future__ import annotations

from vehicle_client import make as make
