"""Simulated time for an agent that knows nothing of the bench: `pace: warp`, described in docs/time.md."""

from __future__ import annotations

from ._library import warp_fault as warp_fault
from ._pace import Warp as Warp
from ._pace import open_warp as open_warp
