"""What a null agent hears from the bench, and the documents that it publishes."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterable
from typing import Any

from agent_adapters.client import Moment, Wanted
from bench.streams import CameraInfo, String

JsonObject = dict[str, Any]

MISSION, INTELLIGENCE, ORDERS, OPERATOR_LINK = "mission", "intelligence", "orders", "operator_link"
CAMERA = "camera/front/camera_info"
# As bench.contracts.VehicleTopics has them: latched, and how many samples are kept.
_DOCUMENT_DEPTHS = {MISSION: 1, INTELLIGENCE: 32, ORDERS: 32, OPERATOR_LINK: 1}
# Exposures that a report may cite.
_EXPOSURES = 20
# The rate of status documents of the reference agent.
STATUS_S = 1.0


def subscriptions(vehicle: str, topics: Iterable[str]) -> list[Wanted]:
    """The subscriptions to topics of a vehicle, named without it."""
    return [
        Wanted(f"/{vehicle}/{topic}", String, latched=True, depth=_DOCUMENT_DEPTHS[topic])
        if topic in _DOCUMENT_DEPTHS
        else Wanted(f"/{vehicle}/{topic}", CameraInfo)
        for topic in topics
    ]


class NullSession:
    """One session as the agent knows it. `receive` each moment before anything is published."""

    def __init__(self, vehicle: str, publish: Callable[[str, str], None], seed: int) -> None:
        self.now_s = 0.0
        self.mission: JsonObject = {}
        self.intelligence: list[JsonObject] = []
        self.orders: list[JsonObject] = []
        self.link_up = True
        self.random = random.Random(seed)
        self.phase = "starting"
        self._vehicle = vehicle
        self._publish = publish
        self._exposures: list[Any] = []
        self._status_s = -STATUS_S
        self._decided_s = 0.0

    def receive(self, moment: Moment) -> None:
        """Take in what came by this moment."""
        self.now_s = moment.time.s
        for sample in moment.samples:
            topic = sample.topic.removeprefix(f"/{self._vehicle}/")
            if topic == CAMERA:
                self._exposures = [*self._exposures[1 - _EXPOSURES :], sample]
                continue
            message = sample.message()
            document = json.loads(message.data) if isinstance(message, String) else {}
            if topic == MISSION:
                self.mission = document
            elif topic == INTELLIGENCE:
                self.intelligence.append(document)
            elif topic == ORDERS:
                self.orders.append(document)
            elif topic == OPERATOR_LINK:
                self.link_up = document["up"]

    @property
    def limit_s(self) -> float:
        """The time limit of the mission; infinite before its order has come."""
        return float(self.mission.get("time_limit_s", float("inf")))

    def evidence(self) -> list[float]:
        """The latest exposures of the camera, whatever they show."""
        messages = [sample.message() for sample in self._exposures]
        return [
            round(message.header.stamp.ns * 1e-9, 3)
            for message in messages
            if isinstance(message, CameraInfo)
        ]

    # What it publishes.

    def enter(self, phase: str) -> None:
        """Announce a phase of the mission."""
        self.phase = phase
        self._status_s = self.now_s
        self._put("status", {"time_s": self.now_s, "phase": phase})

    def keep_log(self) -> None:
        """Repeat the status once a second, and a decision every half minute, so that no gap shows."""
        if self.now_s - self._status_s >= STATUS_S - 1e-6:
            self.enter(self.phase)
        if self.now_s - self._decided_s >= 30.0:
            self.decide("continue", "", f"{self.phase}: nothing has changed")

    def decide(self, action: str, subject: str, reason: str, **more: Any) -> None:
        """One line of the decision log."""
        self._decided_s = self.now_s
        decision = {"time_s": self.now_s, "action": action, "subject": subject, "reason": reason, **more}
        self._put("decisions", decision)

    def answer(self, order: JsonObject, accepted: bool, reason: str) -> None:
        """Answer an order, and log the same as a decision."""
        document = {"time_s": self.now_s, "order": order["id"], "accepted": accepted, "reason": reason}
        self._put("answers", document)
        self.decide("obey" if accepted else "refuse", order["id"], reason)

    def report(self, report: JsonObject) -> None:
        """Publish a report; its time is now."""
        self._put("reports", {"time_s": self.now_s, **report})

    def tracks(self, tracks: list[JsonObject]) -> None:
        """Publish everything that the agent claims to believe in."""
        self._put("tracks", {"time_s": self.now_s, "tracks": tracks})

    def _put(self, topic: str, document: JsonObject) -> None:
        self._publish(f"/{self._vehicle}/agent/{topic}", json.dumps(document))
