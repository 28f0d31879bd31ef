"""The agent's half of the lockstep protocol, one JSON object a line; docs/time.md describes it.

The bench's half (bench/contracts/_tick.py) is made of pydantic documents, because it must refuse whatever an
agent may send. Importing pydantic costs three times as much CPU as the rest of this client, so the agent's
half is written out by hand, as an agent in any other language has to. A test holds the two halves against
each other.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import field

from bench.values import value_class

MAX_LINE_BYTES = 64 * 1024
"""The longest line that the protocol allows."""

# `json.dumps` makes an encoder for every call that is not all defaults, which takes longer than an ack.
_encode = json.JSONEncoder(separators=(",", ":"), ensure_ascii=False).encode

# Beyond this JSON numbers are not whole numbers everywhere: a double has 53 bits.
MAX_COUNT = 2**53


@value_class(frozen=True, slots=True)
class Tick:
    """Time is now `time_ns`; `topics` and `links` count what the bench has sent to the agent since the
    start.
    """

    number: int
    time_ns: int
    topics: Mapping[str, int] = field(default_factory=dict)
    links: Mapping[str, int] = field(default_factory=dict)


@value_class(frozen=True, slots=True)
class End:
    """The session is over."""

    reason: str = ""


def read_line(line: bytes) -> Tick | End | None:
    """What the bench says in a line; None when it is not a line of the protocol. Never raises."""
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(message, dict):
        return None
    kind, fields = message.pop("kind", None), message
    if kind == "tick":
        return _tick(fields)
    if kind == "end" and fields.keys() <= {"reason"} and isinstance(fields.get("reason", ""), str):
        return End(**fields)
    return None


def hello_line(agent: str, subscribes: Sequence[str], secret: str) -> bytes:
    """The first line of an agent: its name, the topics that it subscribes to, and the session's secret."""
    hello = {"kind": "hello", "protocol": 1, "agent": agent, "subscribes": list(subscribes)}
    return _line({**hello, "secret": secret})


def ack_line(number: int, topics: Mapping[str, int], links: Mapping[str, int]) -> bytes:
    """Tick `number` is dealt with; `topics` and `links` count what the agent has sent since the start."""
    return _line({"kind": "ack", "number": number, "topics": dict(topics), "links": dict(links)})


def _tick(fields: Mapping[str, object]) -> Tick | None:
    number, time_ns = fields.get("number"), fields.get("time_ns")
    topics, links = fields.get("topics", {}), fields.get("links", {})
    if (
        not fields.keys() <= {"number", "time_ns", "topics", "links"}
        or not isinstance(topics, dict)
        or not isinstance(links, dict)
    ):
        return None
    if (
        not _is_count(number)
        or not _is_count(time_ns)
        or not all(map(_is_count, [*topics.values(), *links.values()]))
    ):
        return None
    assert isinstance(number, int)
    assert isinstance(time_ns, int)
    return Tick(number, time_ns, topics, links)


def _is_count(value: object) -> bool:
    # JSON's true is Python's True, which is an int.
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < MAX_COUNT


def _line(message: Mapping[str, object]) -> bytes:
    return _encode(message).encode() + b"\n"
