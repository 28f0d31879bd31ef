"""ArduPilot's topics and services in a session: between the vehicle's autopilot and its companion, and what of them an agent
gets wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from bench.contracts import HasApTopics, SimTime
from bench.streams import AP_FROM_AGENT, AP_PREFIX, AP_RELEASES, AP_SERVICES, Endpoint, filled, type_hash

from ._air_topics import AirTopic, RecordedPublisher
from ._unmatched_topics import MAX_SENTENCES, SHOWN_CHARACTERS, deed_of, mismatch


class ApCompanion:
    """Carries samples, requests and answers between a vehicle and the air network; `publishers` are those of the topics to
    the agent, and of the answers of services.
    """

    def __init__(self, vehicle: HasApTopics, publishers: Mapping[str, RecordedPublisher]) -> None:
        self._vehicle, self._publishers = vehicle, publishers

    def publish(self, now: SimTime) -> None:
        """Publish what the autopilot has said up to this moment, in its order."""
        for topic, values in self._vehicle.ap_samples():
            publisher = self._publishers[topic]
            publisher.publish(now, filled(publisher.kind, values))

    def hand_over(self, published: Mapping[str, list[Any]]) -> None:
        """Hand the autopilot what the agent has asked and published: one after the other in a fixed order, each in its own."""
        # A mode is asked for before what is flown in it: which came first within a step is the host's doing.
        self._vehicle.take_ap(
            [
                (topic, {field.name: getattr(message, field.name) for field in fields(message)})
                for topic in (*AP_SERVICES, *AP_FROM_AGENT)
                for message in published.get(topic, ())
            ]
        )


def unmatched_ap(
    endpoints: Iterable[Endpoint], topics: Sequence[AirTopic], release: str | None
) -> tuple[str, ...]:
    """What an agent announced below /ap and the session does not have, each in a sentence with the reason. `topics` are the
    session's, of the manifest's `release`.
    """
    known = {topic.name: topic for topic in topics}
    sentences = (
        _sentence(endpoint, known, release) for endpoint in endpoints if endpoint.topic.startswith(AP_PREFIX)
    )
    return tuple([sentence for sentence in sentences if sentence][:MAX_SENTENCES])


def _sentence(endpoint: Endpoint, known: Mapping[str, AirTopic], release: str | None) -> str:
    deed = deed_of(endpoint)
    if release is None:
        return f'{deed}, but its manifest has no ap_dds: write ap_dds: "{AP_RELEASES[-1]}"'
    if sentence := mismatch(endpoint, known):
        return sentence
    kind = known[endpoint.topic].kind
    if endpoint.type_hash == type_hash(kind):
        return ""
    return (
        f"{deed} with {endpoint.type_hash[:SHOWN_CHARACTERS]}, which is not the hash of {kind.TYPE} in ap_dds "
        f'"{release}": {type_hash(kind)}'
    )
