"""The lockstep protocol: one JSON object a line over a plain TCP socket beside the streams. docs/time.md
describes it.

1. The agent binds its MAVLink sockets, declares its subscriptions, connects and says `Hello`, with the secret
   that it was given (REBAR_TICK_SECRET), naming what it subscribes to. The bench closes every connection
   whose first line is anything else.
2. The bench waits until those subscriptions are matched, then sends `Tick` with the first moment.
3. `Tick` says how many samples (the publisher's sequence number) went out on each topic and how many MAVLink
   messages on each link since the start. The agent takes in exactly those, acts, and answers `Ack` with the
   same about itself.
4. The bench takes in exactly what `Ack` states, advances the world by one tick, and goes on with 3.
5. `End` is the last line of the bench; the agent closes.

Between a Tick and its Ack no simulated time passes, however long the agent takes; after an Ack the agent
stays silent.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationError

from bench.documents import Document

from ._documents import Label

# Agents in JavaScript read JSON numbers as doubles, which are exact below 2**53.
Count = Annotated[int, Field(ge=0, lt=2**53)]
# A limit, because the other end is not trusted.
Counts = Annotated[dict[str, Count], Field(max_length=256)]
MAX_LINE_BYTES = 64 * 1024


class Hello(Document):
    """Agent to bench, first line."""

    kind: Literal["hello"] = "hello"
    protocol: Literal[1] = 1
    agent: Label
    subscribes: Annotated[tuple[str, ...], Field(max_length=64)] = ()
    secret: Annotated[str, Field(max_length=256, repr=False)] = ""


class Tick(Document):
    """Bench to agent: time is now `time_ns`; `topics` and `links` count what was sent to the agent since the
    start.
    """

    kind: Literal["tick"] = "tick"
    number: Count
    time_ns: Count
    topics: Counts = {}
    links: Counts = {}


class Ack(Document):
    """Agent to bench: tick `number` is dealt with; `topics` and `links` count what the agent has sent since
    the start.
    """

    kind: Literal["ack"] = "ack"
    number: Count
    topics: Counts = {}
    links: Counts = {}


class End(Document):
    """Bench to agent: the session is over."""

    kind: Literal["end"] = "end"
    reason: str = ""


TickMessage = Hello | Tick | Ack | End
# By how a line states its kind; first those of every tick.
_KINDS: dict[bytes, type[Hello] | type[Tick] | type[Ack] | type[End]] = {
    b'"kind":"ack"': Ack,
    b'"kind":"tick"': Tick,
    b'"kind":"hello"': Hello,
    b'"kind":"end"': End,
}


def write_line(message: TickMessage) -> bytes:
    """One line of the protocol, newline included."""
    return message.model_dump_json().encode() + b"\n"


def read_line(line: bytes) -> TickMessage | None:
    """The message in a line, or None when it is not one; never raises."""
    packed = line.replace(b" ", b"")
    for name, kind in _KINDS.items():
        if name in packed:
            try:
                return kind.model_validate_json(line)
            except ValidationError:
                return None
    return None
