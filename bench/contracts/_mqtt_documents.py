"""What a bridge and an agent that speaks MQTT tell each other beside the air network's own messages.

docs/mqtt-agents.md describes the exchange. It is the lockstep protocol (`_tick`) on topics: the counts are of MQTT
messages, by topic without the prefix.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from bench.documents import Document

from ._documents import Label
from ._tick import Count, Counts

MavlinkValue = float | int | str | None | tuple[float | int | None, ...]


class MqttReady(Document):
    """Agent to bridge, once: it has subscribed, and the session may begin."""

    protocol: Literal[1] = 1
    agent: Label = Field(min_length=1)


class MqttTick(Document):
    """Bridge to agent: time is now `time_ns`; `topics` counts what was sent to the agent since the start.

    In lockstep time stands still until the agent acknowledges it. In the other paces there is one every 0.1 simulated
    seconds, and nobody waits.
    """

    number: Count
    time_ns: Count
    lockstep: bool
    topics: Counts = {}


class MqttAck(Document):
    """Agent to bridge, in lockstep: tick `number` is dealt with; `topics` counts what the agent has sent since the
    start, this acknowledgement and `MqttReady` left out.
    """

    number: Count
    topics: Counts = {}


class MqttEnd(Document):
    """Bridge to agent: the session is over."""

    reason: str = ""


class MavlinkJson(Document):
    """One MAVLink message of the dialect common, under the names of its XML.

    To the agent all fields are there; null is a number that JSON does not have. From the agent a field that is left out is
    0, and null is NaN, which MAVLink takes for "not given".
    """

    system: int = Field(246, ge=0, le=255)
    component: int = Field(191, ge=0, le=255)
    name: str = Field(max_length=64, description="HEARTBEAT, COMMAND_LONG ...")
    fields: dict[str, MavlinkValue] = Field({}, max_length=64)
