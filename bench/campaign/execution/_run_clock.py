"""Host time as a run of a campaign sees it."""

from __future__ import annotations

import time
from typing import Protocol

import anyio


class HostClock(Protocol):
    """Host seconds from some moment on. Handed in, so that no test waits for a pause."""

    def __call__(self) -> float:
        """The reading now."""

    async def sleep(self, span_s: float) -> None:
        """Return after `span_s` host seconds."""


class MonotonicClock:
    """The clock of this host that nobody sets."""

    def __call__(self) -> float:
        return time.monotonic()

    async def sleep(self, span_s: float) -> None:
        await anyio.sleep(span_s)
