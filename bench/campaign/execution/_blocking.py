"""Coroutine functions for callers without an event loop, and their errors without groups."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial, wraps
from types import FrameType
from typing import Any, NoReturn, ParamSpec, TypeVar

import anyio

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


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
