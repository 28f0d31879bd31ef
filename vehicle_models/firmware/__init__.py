"""Real autopilots on the simulated aircraft: the firmware's own program flies, and the bench is its physics."""

from __future__ import annotations
