"""Requests to stop: Ctrl-C and SIGTERM cancel what flies, and leave a reason."""

from __future__ import annotations

import signal
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
from anyio.abc import TaskStatus

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopRequest:
    """`reason` is None until a stop is requested. At that moment `scope` is cancelled, with everything inside it."""

    def __init__(self) -> None:
        self.reason: str | None = None
        self.scope = anyio.CancelScope()

    def request(self, reason: str) -> None:
        """Request a stop. The first reason stays."""
        if self.reason is None:
            self.reason = reason
            self.scope.cancel()


@asynccontextmanager
async def open_stop_request() -> AsyncIterator[StopRequest]:
    """Yield a StopRequest that SIGINT and SIGTERM trigger. The former handlers come back at the end.

    Outside the main thread no signal triggers it.
    """
    stop = StopRequest()
    # Python runs signal handlers in the main thread only, and refuses to install them from another.
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    former = {number: signal.getsignal(number) for number in _SIGNALS}
    try:
        async with anyio.create_task_group() as tasks:
            await tasks.start(_listen, stop)
            yield stop
            tasks.cancel_scope.cancel()
    finally:
        # The event loop itself would leave the system's default, which ends the process.
        for number, handler in former.items():
            signal.signal(number, handler)


async def _listen(stop: StopRequest, *, task_status: TaskStatus[None]) -> None:
    with anyio.open_signal_receiver(*_SIGNALS) as signals:
        task_status.started()
        async for number in signals:
            stop.request(f"received {number.name}")
