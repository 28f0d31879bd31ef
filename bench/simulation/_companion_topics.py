"""An autopilot's topics in a session: between the vehicle and its companion, and what of them an agent gets wrong."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from bench.contracts import HasCompanionTopics, SimTime
from bench.streams import (
    AP_FROM_AGENT,
    AP_PREFIX,
    AP_SERVICES,
    PX4_FROM_AGENT,
    PX4_PREFIX,
    PX4_RELEASES,
    Endpoint,
    dds_name,
    filled,
    px4_names,
    px4_plain_name,
    px4_releases_of,
    type_hash,
)

from ._air_topics import AirTopic, RecordedPublisher

# Of a topic's or a type's name, or of a hash, in a sentence.
_SHOWN_CHARACTERS = 80
# Sentences; the next mistakes show when these are mended.
_MOST = 16
_IN_ORDER = (*PX4_FROM_AGENT, *AP_SERVICES, *AP_FROM_AGENT)
# The field of the manifest by which an agent has the topics below a prefix, and what it may say.
_NEEDS = {PX4_PREFIX: ("px4_msgs", "1.17"), AP_PREFIX: ("ap_dds", "2025-12")}


class Companion:
    """Carries samples between a vehicle and the air network; `publishers` are those of the topics to the agent, and of the
    answers of services.
    """

    def __init__(self, vehicle: HasCompanionTopics, publishers: Mapping[str, RecordedPublisher]) -> None:
        self._vehicle = vehicle
        self._publishers: dict[str, list[RecordedPublisher]] = {}
        for name, publisher in publishers.items():
            # What is said under a versioned name too is recorded once, and sent there to those who listen.
            topic = px4_plain_name(name)
            publisher.recorded = name == topic
            publisher.while_matched = name != topic
            self._publishers.setdefault(topic, []).append(publisher)
        self._names = {
            topic: tuple(field.name for field in fields(publisher.kind))  # type: ignore[arg-type]
            for topic, (publisher, *_) in self._publishers.items()
        }

    def publish(self, now: SimTime) -> None:
        """Publish what the autopilot has said up to this moment, in its order."""
        for topic, values in self._vehicle.published_samples():
            known = {name: values[name] for name in self._names[topic] if name in values}
            for publisher in self._publishers[topic]:
                if publisher.recorded or publisher.listened:
                    publisher.publish(now, filled(publisher.kind, known))

    def hand_over(self, published: Mapping[str, list[Any]]) -> None:
        """Hand the autopilot what the agent has published: topic by topic in a fixed order, each in its own."""
        messages_by_topic: dict[str, list[Any]] = {}
        for name, messages in published.items():
            messages_by_topic.setdefault(px4_plain_name(name), []).extend(messages)
        # Signs of life and setpoints before commands, and services before what is flown in the mode that they enter: which
        # topic came first within a step is the host's doing.
        self._vehicle.take_samples(
            [
                (topic, {field.name: getattr(message, field.name) for field in fields(message)})
                for topic in _IN_ORDER
                for message in messages_by_topic.get(topic, ())
            ]
        )


def need_of(topic: str) -> tuple[str, str] | None:
    """The field of the manifest that the topics of an autopilot need, and a value of it; None for any other topic."""
    return next((need for prefix, need in _NEEDS.items() if topic.startswith(prefix)), None)


def unmatched_topics(
    endpoints: Iterable[Endpoint], topics: Sequence[AirTopic], releases: Mapping[str, str | None]
) -> tuple[str, ...]:
    """What an agent announced of an autopilot's topics and the session does not have, each in a sentence with the reason.
    `topics` are the session's, `releases` the manifest's by field.
    """
    known = {topic.name: topic for topic in topics}
    sentences = (
        _sentence(endpoint, known, need, releases[need[0]])
        for endpoint in endpoints
        if (need := need_of(endpoint.topic))
    )
    return tuple([sentence for sentence in sentences if sentence][:_MOST])


def _sentence(
    endpoint: Endpoint, known: Mapping[str, AirTopic], need: tuple[str, str], release: str | None
) -> str:
    deed = "calls" if endpoint.calls else "publishes" if endpoint.publishes else "subscribes to"
    deed = f"the agent {deed} {endpoint.topic[:_SHOWN_CHARACTERS]}"
    field, example = need
    if release is None:
        return f'{deed}, but its manifest has no {field}: write {field}: "{example}", or the release it is built with'
    topic = known.get(endpoint.topic)
    if topic is None:
        return f"{deed}, {_unknown(endpoint.topic, known, release)}"
    if (topic.service, topic.from_agent) != (endpoint.calls, endpoint.calls or endpoint.publishes):
        return f"{deed}, which it may only {'call' if topic.service else 'write' if topic.from_agent else 'read'}"
    if endpoint.dds_type != dds_name(topic.kind):
        return f"{deed} as {endpoint.dds_type[:_SHOWN_CHARACTERS]}; its type is {topic.kind.TYPE}"
    if endpoint.type_hash == type_hash(topic.kind):
        return ""
    name = topic.kind.TYPE.rpartition("/")[2]
    releases = px4_releases_of(name, endpoint.type_hash) if field == "px4_msgs" else []
    whose = f"{field} {' and '.join(releases)}" if releases else "no release that this bench knows"
    return (
        f"{deed} with {endpoint.type_hash[:_SHOWN_CHARACTERS]}, the hash of {name} in {whose}; the manifest says {field}: "
        f'"{release}", whose hash is {type_hash(topic.kind)}'
    )


def _unknown(topic: str, known: Mapping[str, AirTopic], release: str) -> str:
    """What a topic is that the release in the manifest does not have."""
    plain_name = px4_plain_name(topic)
    if releases := [other for other in PX4_RELEASES if topic in px4_names(plain_name, other)]:
        return f'a topic of px4_msgs {" and ".join(releases)}; the manifest says px4_msgs: "{release}"'
    near = difflib.get_close_matches(topic, known, n=1)
    return "which this bench does not have; " + (
        f"the nearest is {near[0]}" if near else f"there are {', '.join(known)}"
    )
