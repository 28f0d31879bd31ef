"""The host's monotonic clock as a value, so that budgets can be tested without waiting for them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class HostClock:
    """Host seconds, for budgets and for the realtime pace alone: they never become simulated time."""

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep


HOST_CLOCK = HostClock()
