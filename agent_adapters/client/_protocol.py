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
from typing import Any

from bench.values import value_class

# `json.dumps` makes an encoder for every call that is not all defaults, which takes longer than an ack.
_encode = json.JSONEncoder(separators=(",", ":"), ensure_ascii=False).encode

# Beyond this JSON numbers are not whole numbers everywhere: a double has 53 bits.
MAX_COUNT = 2**53


@value_class(frozen=True, slots=True)
class Tick:
    """Time is now `time_ns`; `topics` and `links` count what the bench has sent to the agent since the
    start. `air` has the messages themselves, with `air: tick` in the manifest: objects with `topic` and `message`.
    """

    number: int
    time_ns: int
    topics: Mapping[str, int] = field(default_factory=dict)
    links: Mapping[str, int] = field(default_factory=dict)
    air: Sequence[Mapping[str, Any]] = ()


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


def hello_line(agent: str, subscribes: Sequence[str], secret: str, interval_s: float | None = None) -> bytes:
    """The first line of an agent: its name, the topics that it subscribes to, the session's secret, and with `air: tick` the
    least simulated time between ticks where time does not wait.
    """
    hello = {"kind": "hello", "protocol": 1, "agent": agent, "subscribes": list(subscribes)}
    interval = {} if interval_s is None else {"interval_s": interval_s}
    return _line({**hello, "secret": secret, **interval})


def ack_line(
    number: int,
    topics: Mapping[str, int],
    links: Mapping[str, int],
    air: Sequence[Mapping[str, Any]] = (),
) -> bytes:
    """Tick `number` is dealt with; `topics` and `links` count what the agent has sent since the start, `air` has what it
    publishes with `air: tick`.
    """
    ack = {"kind": "ack", "number": number, "topics": dict(topics), "links": dict(links)}
    return _line({**ack, "air": list(air)} if air else ack)


def _tick(fields: Mapping[str, object]) -> Tick | None:
    number, time_ns = fields.get("number"), fields.get("time_ns")
    topics, links, air = fields.get("topics", {}), fields.get("links", {}), fields.get("air", [])
    if (
        not fields.keys() <= {"number", "time_ns", "topics", "links", "air"}
        or not isinstance(topics, dict)
        or not isinstance(links, dict)
        or not isinstance(air, list)
        or not all(map(_is_air_message, air))
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
    return Tick(number, time_ns, topics, links, tuple(air))


def _is_air_message(value: object) -> bool:
    return (
        isinstance(value, dict) and value.keys() == {"topic", "message"} and isinstance(value["topic"], str)
    )


def _is_count(value: object) -> bool:
    # JSON's true is Python's True, which is an int.
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < MAX_COUNT


def _line(message: Mapping[str, object]) -> bytes:
    return _encode(message).encode() + b"\n"
