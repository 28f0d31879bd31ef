"""A run of a campaign and the event loop: calls without one, the clock, requests to stop, and errors without groups."""

from __future__ import annotations

import asyncio
import signal
import threading
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager
from functools import partial, wraps
from types import FrameType
from typing import Any, NoReturn, ParamSpec, Protocol, TypeVar

import anyio
from anyio.abc import TaskStatus

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


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


def blocking(
    function: Callable[Parameters, Coroutine[Any, Any, Result]], name: str | None = None
) -> Callable[Parameters, Result]:
    """The same function as a plain one that returns when it is done.

    In a thread that runs an event loop already, as a notebook's, the function runs in a thread of its own.
    """

    @wraps(function)
    def call(*arguments: Parameters.args, **options: Parameters.kwargs) -> Result:
        main = partial(function, *arguments, **options)
        if _runs_event_loop():
            with ThreadPoolExecutor(1) as thread:
                return thread.submit(anyio.run, main).result()
        with _plain_interrupts():
            return anyio.run(main)

    call.__name__ = call.__qualname__ = name or function.__name__
    return call


@contextmanager
def first_error_alone() -> Iterator[None]:
    """Raise the first error of a group of task errors as itself: what follows it is cancellation and clean-up."""
    try:
        yield
    except BaseExceptionGroup as group:
        error: BaseException = group
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        raise error from error.__cause__


def _runs_event_loop() -> bool:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


@contextmanager
def _plain_interrupts() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt at once, as it does without an event loop.

    asyncio's own handler cancels the main task instead, which planning and scoring would notice minutes later. It is
    not installed where another handler is in place.
    """
    is_main_thread = threading.current_thread() is threading.main_thread()
    if not is_main_thread or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


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
