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

With `air: tick` in the agent's manifest both lines carry the air network's messages themselves, in `air`, and count links alone.
So they do in real time and warp, where time goes on before an Ack and nothing is counted; the next Tick still waits for it.

Between a Tick and its Ack no simulated time passes, however long the agent takes; after an Ack the agent
stays silent.
"""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from bench.documents import Document, added_field

from ._documents import SHOWN_CHARACTERS, Label, field_faults

# Agents in JavaScript read JSON numbers as doubles, which are exact below 2**53.
Count = Annotated[int, Field(ge=0, lt=2**53)]
# A limit, because the other end is not trusted.
Counts = Annotated[dict[str, Count], Field(max_length=256)]
MAX_LINE_BYTES = 64 * 1024
# With the air network in it. Four documents of the greatest size that the air network takes.
MAX_AIR_LINE_BYTES = 1024 * 1024


class AirMessage(Document):
    """A message of the air network as JSON: what std_msgs/msg/String would hold, or the fields of another type.

    From the agent it may be a text: the document as a String holds it. It is recorded to the letter, and whether it is JSON at
    all is judged as over Zenoh.
    """

    topic: str = Field(max_length=256)
    message: dict[str, Any] | str


class Hello(Document):
    """Agent to bench, first line.

    `interval_s` is for `air: tick` in real time and warp: the least simulated time from tick to tick, in place of
    `pace.tick_s`. Where time goes on, a program that passes messages on needs them sooner than one that acts on them.
    """

    kind: Literal["hello"] = "hello"
    protocol: Literal[1] = 1
    agent: Label
    subscribes: tuple[str, ...] = Field((), max_length=64)
    secret: str = Field("", max_length=256, repr=False)
    interval_s: float | None = added_field(None, ge=0.001, le=60.0)


class Tick(Document):
    """Bench to agent: time is now `time_ns`; `topics` and `links` count what was sent to the agent since the
    start. In lockstep `topics` names every topic of the hello; where time does not wait, it is empty.
    """

    kind: Literal["tick"] = "tick"
    number: Count
    time_ns: Count
    topics: Counts = {}
    links: Counts = {}
    air: tuple[AirMessage, ...] = added_field(())


class Ack(Document):
    """Agent to bench: tick `number` is dealt with; `topics` and `links` count what the agent has sent since
    the start.
    """

    kind: Literal["ack"] = "ack"
    number: Count
    topics: Counts = {}
    links: Counts = {}
    air: tuple[AirMessage, ...] = added_field((), max_length=1024)


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


_HTTP = re.compile(rb"[A-Z]{3,7} \S+ HTTP/")
_TLS_HANDSHAKE = b"\x16\x03"
_PLAIN = "the tick socket takes one JSON object a line, over plain TCP"
_KIND_NAMES = tuple(sorted(kind.__name__.lower() for kind in _KINDS.values()))
# A reason is read by a person; the first faults say enough.
_NAMED_FAULTS = 3


def line_fault(line: bytes) -> str:
    """What a line is for which `read_line` gives None, in words that follow "it sent". Holds no value of a field, since
    one of them is the secret.
    """
    if _HTTP.match(line):
        return f"an HTTP request ({_PLAIN})"
    if line.startswith(_TLS_HANDSHAKE):
        return f"the start of a TLS connection ({_PLAIN})"
    if not line.strip():
        return "an empty line"
    try:
        document = json.loads(line)
    except UnicodeDecodeError as error:
        return f"a line that is no UTF-8 text (byte {error.start + 1})"
    except json.JSONDecodeError as error:
        return f"a line that is no JSON ({error.msg}, character {error.pos + 1})"
    except (ValueError, RecursionError) as error:
        return f"a line that is no JSON ({type(error).__name__})"
    if not isinstance(document, dict):
        return f"JSON that is no object, but {type(document).__name__}"
    kind = document.get("kind")
    if kind not in _KIND_NAMES:
        stated = "no kind" if kind is None else f"the kind {repr(kind)[:SHOWN_CHARACTERS]}"
        return f"an object with {stated} (kinds: {', '.join(_KIND_NAMES)})"
    return f"a line of kind {kind} with faults: {_faults(kind, line)}"


def _faults(kind: str, line: bytes) -> str:
    """The fields of a line that are wrong, each with what is wrong."""
    document = next(document for document in _KINDS.values() if document.__name__.lower() == kind)
    try:
        document.model_validate_json(line)
    except ValidationError as error:
        faults = field_faults(error)
        more = len(faults) - _NAMED_FAULTS
        return "; ".join(faults[:_NAMED_FAULTS]) + (f"; and {more} more" if more > 0 else "")
    # Only blanks are looked for around a kind: the fast way to read a line knows no JSON.
    return 'write the kind as "kind":"hello", without escapes and with no other white space than blanks'
