"""What is wrong with a topic that an agent announces, in a sentence, whichever autopilot's it is."""

from __future__ import annotations

import difflib
from collections.abc import Mapping

from bench.streams import Endpoint, dds_name

from ._air_topics import AirTopic

# Of a topic's or a type's name, or of a hash, in a sentence.
SHOWN_CHARACTERS = 80
# Sentences; the next mistakes show when these are mended.
MAX_SENTENCES = 16


def deed_of(endpoint: Endpoint) -> str:
    """What the agent does with the topic: the beginning of a sentence."""
    verb = "calls" if endpoint.calls else "publishes" if endpoint.publishes else "subscribes to"
    return f"the agent {verb} {endpoint.topic[:SHOWN_CHARACTERS]}"


def mismatch(endpoint: Endpoint, known: Mapping[str, AirTopic]) -> str:
    """What of name, direction and type is wrong, with the reason; empty when nothing is. `known` are the session's."""
    deed, topic = deed_of(endpoint), known.get(endpoint.topic)
    if topic is None:
        near = difflib.get_close_matches(endpoint.topic, known, n=1)
        return f"{deed}, which this bench does not have; " + (
            f"the nearest is {near[0]}" if near else f"there are {', '.join(known)}"
        )
    if (topic.service, topic.from_agent) != (endpoint.calls, endpoint.calls or endpoint.publishes):
        return f"{deed}, which it may only {'call' if topic.service else 'write' if topic.from_agent else 'read'}"
    if endpoint.dds_type != dds_name(topic.kind):
        return f"{deed} as {endpoint.dds_type[:SHOWN_CHARACTERS]}; its type is {topic.kind.TYPE}"
    return ""
