"""How a service joins the flight controller: what it takes, carries out, streams and answers.

A service is any object that has one or more of the methods of `Service`; the controller finds out which when it is
built.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol

from ..links._radio import Channel


class CommandResult(IntEnum):
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
class Refusal:
    """Why something is not done: the result to acknowledge (None: no answer at all), and texts to send."""

    result: CommandResult | None
    texts: tuple[tuple[int, str], ...] = ()


@dataclass(frozen=True, slots=True)
class MessageSender:
    """Who sent a message, and over which channel an answer reaches it."""

    system: int
    component: int
    channel: Channel

    def answer(self, name: str, **fields: Any) -> None:
        """Queue a message that is addressed to the sender; the other fields by name."""
        self.channel.send_message(name, target_system=self.system, target_component=self.component, **fields)


@dataclass(frozen=True, slots=True)
class Command:
    """COMMAND_LONG and COMMAND_INT alike: seven floats, coordinates in degrees, NaN for what is left out."""

    number: int
    params: tuple[float, ...]
    frame: int | None  # None for COMMAND_LONG
    sender: MessageSender

    def flag(self, index: int, bit: int) -> bool:
        """Whether a parameter that holds flags has `bit`."""
        return has_flag(self.params[index], bit)


# A float from the wire may be NaN or beyond any integer, which int() does not accept.
def has_flag(value: float, bit: int) -> bool:
    """Whether a float that holds flags has `bit`; False for a value that cannot be flags."""
    # NaN fails the comparison as well.
    return 0.0 <= value < 2**31 and bool(int(value) & bit)


Values = tuple[Any, ...]
"""A message's fields in wire order."""
Fields = dict[str, Any]
"""A message's fields by name."""
MessageHandler = Callable[[Any, MessageSender], None]
CommandHandler = Callable[[Command], "CommandResult | None"]
"""Carries a command out and returns the result to acknowledge; None answers nothing."""
Stream = Callable[[], "Values | None"]
"""Gives the values of a message at the present moment; None sends nothing."""


@dataclass(frozen=True, slots=True)
class ChannelStream:
    """A stream whose values are those of one channel, so that no link shows how busy another is."""

    values: Callable[[Channel], Values | None]


@dataclass(frozen=True, slots=True)
class HalfwayStream:
    """A stream that goes out twice a step where its rate asks for that: first with the values of the middle of the step."""

    values: Stream
    halfway: Stream


AnyStream = Stream | ChannelStream | HalfwayStream


MessageAnswer = Callable[[Command], "Fields | list[Fields] | None"]
"""Gives the message that a REQUEST_MESSAGE asks for, or several of them; None refuses the request."""


class Service(Protocol):
    """The methods that a service may have; the controller calls those that it has."""

    def handlers(self) -> Mapping[str, MessageHandler]:
        """Messages that the service takes, by name."""

    def commands(self) -> Mapping[int, CommandHandler]:
        """Commands that the service carries out, by number."""

    def streams(self) -> Mapping[str, AnyStream]:
        """Messages that may be streamed, by name."""

    def answers(self) -> Mapping[str, MessageAnswer]:
        """Messages that are sent on request only, by name."""

    def tick(self) -> None:
        """Called once a step, after the messages of the step."""
