"""PX4's topics in a session: between the vehicle's autopilot and its companion, and what of them an agent gets wrong."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from bench.contracts import HasPx4Topics, SimTime
from bench.streams import PX4_FROM_AGENT, PX4_PREFIX, Endpoint, px4_releases_of, type_hash

from ._air_topics import AirTopic, RecordedPublisher
from ._unmatched_topics import MAX_SENTENCES, SHOWN_CHARACTERS, deed_of, mismatch


class Px4Companion:
    """Carries samples between a vehicle and the air network; `publishers` are those of the topics to the agent."""

    def __init__(self, vehicle: HasPx4Topics, publishers: Mapping[str, RecordedPublisher]) -> None:
        self._vehicle, self._publishers = vehicle, publishers
        self._names = {
            topic: tuple(field.name for field in fields(publisher.kind))  # type: ignore[arg-type]
            for topic, publisher in publishers.items()
        }

    def publish(self, now: SimTime) -> None:
        """Publish what the autopilot has said up to this moment, in its order."""
        for topic, values in self._vehicle.px4_samples():
            publisher = self._publishers[topic]
            known = {name: values[name] for name in self._names[topic] if name in values}
            publisher.publish(now, publisher.kind(**known))

    def hand_over(self, published: Mapping[str, list[Any]]) -> None:
        """Hand the autopilot what the agent has published: topic by topic in a fixed order, each in its own."""
        # Signs of life and setpoints before commands: which topic came first within a step is the host's doing.
        self._vehicle.take_px4(
            [
                (topic, {field.name: getattr(message, field.name) for field in fields(message)})
                for topic in PX4_FROM_AGENT
                for message in published.get(topic, ())
            ]
        )


def unmatched_px4(
    endpoints: Iterable[Endpoint], topics: Sequence[AirTopic], release: str | None
) -> tuple[str, ...]:
    """What an agent announced below /fmu and the session does not have, each in a sentence with the reason. `topics` are
    the session's, of the manifest's `release`.
    """
    known = {topic.name: topic for topic in topics}
    sentences = (
        _sentence(endpoint, known, release) for endpoint in endpoints if endpoint.topic.startswith(PX4_PREFIX)
    )
    return tuple([sentence for sentence in sentences if sentence][:MAX_SENTENCES])


def _sentence(endpoint: Endpoint, known: Mapping[str, AirTopic], release: str | None) -> str:
    deed = deed_of(endpoint)
    if release is None:
        return f'{deed}, but its manifest has no px4_msgs: write px4_msgs: "1.17", or the release it is built with'
    if sentence := mismatch(endpoint, known):
        return sentence
    topic = known[endpoint.topic]
    if endpoint.type_hash == type_hash(topic.kind):
        return ""
    name = topic.kind.TYPE.rpartition("/")[2]
    releases = px4_releases_of(name, endpoint.type_hash)
    whose = f"px4_msgs {' and '.join(releases)}" if releases else "no release that this bench knows"
    return (
        f"{deed} with {endpoint.type_hash[:SHOWN_CHARACTERS]}, the hash of {name} in {whose}; the manifest says px4_msgs: "
        f'"{release}", whose hash is {type_hash(topic.kind)}'
    )
