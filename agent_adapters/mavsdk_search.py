"""An agent on MAVSDK: searches the reported places by the urgency of each, reports what it sees there, returns.

MAVSDK 4 flies, unmodified, in real time and in warp; the streams tell what to search and what is seen.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import Any

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.telemetry import Telemetry

from agent_adapters.client import Eye, Things, end_process, read_environment
from bench import streams
from bench.contracts import CLOCK, TF, TF_STATIC, VehicleTopics

Json = dict[str, Any]

METRES_PER_DEGREE = 111_194.9  # of latitude on the mean sphere; a search asks for no more
# Three clear detections are a sighting, and who walks is elsewhere after half a minute. Chosen.
SIGHTINGS, SCORE, FORGET_S = 3, 0.35, 30.0


class Search:
    """What the streams have told so far, and what is told to them."""

    def __init__(self, node: streams.RosNode, vehicle: str, camera: str) -> None:
        self.topics = topics = VehicleTopics(vehicle)
        self.heard: dict[str, list[Json]] = {topics.mission: [], topics.intelligence: [], topics.orders: []}
        kinds: dict[str, type[object]] = dict.fromkeys(self.heard, streams.String)
        kinds |= {CLOCK: streams.Clock, TF: streams.TFMessage, TF_STATIC: streams.TFMessage}
        kinds |= {topics.camera_info(camera): streams.CameraInfo, topics.detections: streams.Detection2DArray}
        latched = {TF_STATIC, *self.heard}
        self._subscriptions = [node.subscribe(topic, kinds[topic], topic in latched, 32) for topic in kinds]
        self._publishers = {topic: node.publisher(topic, streams.String) for topic in topics.from_agent}
        self._eye, self._things = Eye(), Things()
        self._now_s, self._told_s = 0.0, -math.inf
        self.mission: Json = {}
        self.phase = "starting"

    def say(self, topic: str, **fields: object) -> None:
        self._publishers[topic].put(streams.String(json.dumps({"time_s": self._now_s, **fields})))

    def wait_until(self, holds: Callable[[], bool], limit_s: float) -> None:
        """Look around and tell of it until `holds` does, or for so long."""
        end_s = time.monotonic() + limit_s
        while not holds() and time.monotonic() < end_s:
            for subscription in self._subscriptions:
                for sample in subscription.take():
                    self._take(sample.topic, sample.message())
            if self.mission and self._now_s - self._told_s >= 1.0:
                self._told_s = self._now_s
                self.say(self.topics.status, phase=self.phase)
                self.say(self.topics.tracks, tracks=self._tracks())
            time.sleep(0.05)

    def _take(self, topic: str, message: Any) -> None:
        if topic == CLOCK:
            self._now_s = message.clock.ns * 1e-9
        elif topic in self.heard:
            self.heard[topic].append(document := json.loads(message.data))
            if topic == self.topics.mission:
                self.mission = document
            if topic == self.topics.orders:
                self.say(self.topics.answers, order=document["id"], accepted=False, reason="knows no orders")
        for sighting in self._eye.see(topic, message):
            if sighting.confidence >= SCORE:
                self._things.take(sighting, self._now_s)

    def report(self, target: Json) -> None:
        """Report the target, if it was seen where it is said to be."""
        sure = [thing for thing in self._things if thing.frames >= SIGHTINGS]
        alike = (thing for thing in sure if thing.class_label == target["class_label"])
        place, within_m = (target["east_m"], target["north_m"]), target["uncertainty_m"]
        found = next((thing for thing in alike if thing.apart_m(*place) <= within_m), None)
        if found is None:
            return
        keep_m = self.mission["no_mark_within_m"]
        people = [thing for thing in sure if thing.class_label in self.mission["bystander_classes"]]
        count = sum(thing.apart_m(found.east_m, found.north_m) < keep_m for thing in people)
        stated = {key: getattr(found, key) for key in ("class_label", "east_m", "north_m", "confidence")}
        stated |= {"mark": count == 0, "bystanders_seen": count, "reason": f"{count} people are near"}
        self.say(self.topics.reports, id=f"report-{target['id']}", intelligence_id=target["id"], **stated)

    def _tracks(self) -> list[Json]:
        bystanders = self.mission["bystander_classes"]
        sure = (thing for thing in self._things if thing.frames >= SIGHTINGS)
        held = (t for t in sure if t.class_label not in bystanders or self._now_s - t.seen_s < FORGET_S)
        return [{key: value for key, value in asdict(thing).items() if key != "seen_s"} for thing in held]


def fly(search: Search, action: Action, telemetry: Telemetry) -> None:
    """The whole mission, from the ground to the ground."""
    search.wait_until(lambda: bool(search.mission) and telemetry.health_all_ok(), 120.0)
    origin, height_m = search.mission["origin"], search.mission["altitude_m"]
    ground_m = telemetry.position().absolute_altitude_m
    east_m_per_degree = METRES_PER_DEGREE * math.cos(math.radians(origin["latitude_deg"]))

    def is_at(latitude_deg: float, longitude_deg: float) -> bool:
        here = telemetry.position()
        north_m = (here.latitude_deg - latitude_deg) * METRES_PER_DEGREE
        return math.hypot(north_m, (here.longitude_deg - longitude_deg) * east_m_per_degree) < 5.0

    action.set_takeoff_altitude(height_m)
    action.set_return_to_launch_altitude(height_m)
    search.phase = "taking_off"
    action.arm()
    action.takeoff()
    search.wait_until(lambda: telemetry.position().relative_altitude_m > height_m - 1.0, 120.0)
    search.phase = "transit"
    for target in sorted(search.heard[search.topics.intelligence], key=lambda target: target["priority"]):
        latitude_deg = origin["latitude_deg"] + target["north_m"] / METRES_PER_DEGREE
        longitude_deg = origin["longitude_deg"] + target["east_m"] / east_m_per_degree
        action.goto_location(latitude_deg, longitude_deg, ground_m + height_m, math.nan)
        search.wait_until(partial(is_at, latitude_deg, longitude_deg), 120.0)
        search.wait_until(lambda: False, 8.0)
        search.report(target)
    search.phase = "returning"
    action.return_to_launch()
    search.wait_until(lambda: not telemetry.armed(), 300.0)
    search.phase = "complete"
    search.wait_until(lambda: False, 2.0)


def main() -> None:
    given = read_environment(os.environ)
    address, camera = given.mavlink["onboard"], str(given.options.get("camera", "front"))
    access = streams.AirAccess(given.zenoh or "", given.zenoh_user, given.zenoh_password, given.domain)
    with streams.open_client(access, "mavsdk_search") as node:
        mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        if mavsdk.add_any_connection("{}://{}:{}".format(*address.split(":"))) != ConnectionResult.SUCCESS:
            sys.exit(f"cannot listen on {address}")
        if (system := mavsdk.first_autopilot(30.0)) is None:
            sys.exit(f"no autopilot on {address}")
        fly(Search(node, given.vehicle, camera), Action(system), Telemetry(system))
    # Threads of MAVSDK live on, and the interpreter would wait for them.
    end_process(0)


if __name__ == "__main__":
    main()
