"""How a MAVLink service joins the flight controller: the messages and commands it takes, and the results it gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol, runtime_checkable

from .links._radio import Channel


class Result(IntEnum):
    """Values of MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    UNSUPPORTED_FRAME = 9


@dataclass(frozen=True, slots=True)
class Sender:
    """Who sent a message, and over which channel an answer reaches it."""

    system: int
    component: int
    channel: Channel


@dataclass(frozen=True, slots=True)
class Command:
    """COMMAND_LONG and COMMAND_INT alike: `params` are seven floats, coordinates in degrees, NaN where nothing is said."""

    number: int
    params: tuple[float, ...]
    frame: int | None  # None for COMMAND_LONG
    sender: Sender

    def flag(self, index: int, bit: int) -> bool:
        """Whether a parameter that holds flags has `bit`; False for what is no number of flags."""
        value = self.params[index]
        return 0.0 <= value < 2**31 and bool(int(value) & bit)


Handler = Callable[[Any, Sender], None]


CommandHandler = Callable[[Command], "Result | None"]
"""Does what a command says and returns the result to acknowledge; None answers nothing."""


class Service(Protocol):
    """One MAVLink service of the flight controller."""

    def handlers(self) -> Mapping[str, Handler]:
        """Messages that it answers, by name."""

    def commands(self) -> Mapping[int, CommandHandler]:
        """Commands that it carries out, by number."""


@runtime_checkable
class Ticking(Protocol):
    """A service that has something to do without being spoken to."""

    def tick(self) -> None:
        """Once a step, after the messages of the step."""
