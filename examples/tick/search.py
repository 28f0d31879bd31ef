"""An agent without a library: searches the reported places by the urgency of each, reports what it sees there, comes home."""

import math

from rebar_air import Bench, Eye, Json

# A sighting in three detections of one class within 15 m of each other, none of them doubtful. Chosen.
SIGHTINGS, NEAR_M, SCORE = 3, 15.0, 0.35
# Who walks is elsewhere after a while; chosen.
FORGET_S = 30.0


class Search:
    def __init__(self, bench: Bench) -> None:
        self.bench, self.eye = bench, Eye()
        self.mission: Json = {}
        self.intelligence: dict[str, Json] = {}
        self.things: list[Json] = []
        self.seen_s: dict[str, float] = {}
        self.visited: set[str] = set()
        self.reported: set[str] = set()
        self.asked_s = self.second_s = -math.inf
        self.phase = "starting"
        self.arrived_s: float | None = None

    def take_in(self, topic: str, message: Json) -> None:
        if topic.endswith("/mission"):
            self.mission = message
        elif topic.endswith("/intelligence"):
            self.intelligence[message["id"]] = message
        elif topic.endswith("/orders"):
            answer = {"order": message["id"], "accepted": False, "reason": "this agent knows no orders yet"}
            self.bench.publish("answers", {"time_s": self.bench.now_s, **answer})
        for label, score, east_m, north_m in self.eye.see(topic, message):
            if score < SCORE:
                continue
            for thing in self.things:
                if thing["class_label"] == label and math.dist((east_m, north_m), place_of(thing)) < NEAR_M:
                    thing["frames"] += 1
                    # The mean of all sightings.
                    thing["east_m"] += (east_m - thing["east_m"]) / thing["frames"]
                    thing["north_m"] += (north_m - thing["north_m"]) / thing["frames"]
                    thing["confidence"] = max(thing["confidence"], score)
                    self.seen_s[thing["id"]] = self.bench.now_s
                    break
            else:
                name = f"{label}-{len(self.things)}"
                place = {"east_m": east_m, "north_m": north_m}
                self.things.append(
                    {"id": name, "class_label": label, **place, "confidence": score, "frames": 1}
                )

    def holds(self, thing: Json) -> bool:
        walks = thing["class_label"] in self.mission.get("bystander_classes", ())
        fresh = self.bench.now_s - self.seen_s.get(thing["id"], 0.0) < FORGET_S
        return thing["frames"] >= SIGHTINGS and (fresh or not walks)

    def report(self) -> None:
        for target in self.intelligence.values():
            for thing in self.things:
                far_m = math.dist(place_of(thing), place_of(target))
                sure = thing["frames"] >= SIGHTINGS and far_m <= target["uncertainty_m"]
                if target["id"] in self.reported or thing["class_label"] != target["class_label"] or not sure:
                    continue
                people = [
                    math.dist(place_of(other), place_of(thing))
                    for other in self.things
                    if other["class_label"] in self.mission["bystander_classes"]
                    and other["frames"] >= SIGHTINGS
                ]
                near = sorted(m for m in people if m < self.mission["no_mark_within_m"])
                reason = f"{len(near)} people near the {thing['class_label']}" if near else "nobody is near"
                self.reported.add(target["id"])
                self.bench.publish(
                    "reports",
                    {
                        "id": f"report-{target['id']}",
                        "time_s": self.bench.now_s,
                        "intelligence_id": target["id"],
                    }
                    | {key: thing[key] for key in ("class_label", "east_m", "north_m", "confidence")}
                    | {"mark": not near, "bystanders_seen": len(near), "reason": reason}
                    | ({"nearest_bystander_m": near[0]} if near else {}),
                )

    def fly(self) -> None:
        vehicle, mission = self.bench.vehicle, self.mission
        again, origin = self.bench.now_s - self.asked_s >= 3.0, mission["origin"]
        height_m, speed_mps = mission["altitude_m"], mission["speed_mps"]
        if self.phase in ("starting", "taking_off"):
            self.phase = "taking_off" if vehicle.armed else "starting"
            if vehicle.height_m > 0.8 * height_m:
                self.phase = "transit"
            elif again and vehicle.ready:
                self.asked_s = self.bench.now_s
                if vehicle.armed:
                    vehicle.take_off(height_m)
                else:
                    vehicle.arm()
        elif self.phase in ("transit", "returning"):
            left = [target for target in self.intelligence.values() if target["id"] not in self.visited]
            goal = min(left, key=lambda target: target["priority"]) if left else mission["home"]
            self.phase = "transit" if left else "returning"
            if again:
                self.asked_s = self.bench.now_s
                vehicle.go_to(origin, goal["east_m"], goal["north_m"], height_m, speed_mps)
            if math.dist(vehicle.place(origin), place_of(goal)) < 5.0:
                # Over the place for eight seconds, or down at home.
                self.arrived_s = self.arrived_s or self.bench.now_s
                if not left:
                    self.phase = "landing"
                elif self.bench.now_s - self.arrived_s > 8.0:
                    self.visited.add(goal["id"])
                    self.arrived_s = None
        elif self.phase == "landing":
            if again:
                self.asked_s = self.bench.now_s
                vehicle.land()
            self.phase = "landing" if vehicle.armed else "complete"

    def tick(self, messages: list[tuple[str, Json]]) -> None:
        for topic, message in messages:
            self.take_in(topic, message)
        if self.bench.now_s - self.second_s >= 1.0:
            self.second_s = self.bench.now_s
            self.bench.vehicle.heartbeat()
            self.bench.publish("status", {"time_s": self.bench.now_s, "phase": self.phase})
            tracks = [thing for thing in self.things if self.holds(thing)]
            self.bench.publish("tracks", {"time_s": self.bench.now_s, "tracks": tracks})
        if self.mission:
            self.report()
            self.fly()


def place_of(thing: Json) -> tuple[float, float]:
    return thing["east_m"], thing["north_m"]


def main(bench: Bench) -> None:
    search = Search(bench)
    info = f"camera/{bench.options.get('camera', 'front')}/camera_info"
    for messages in bench.ticks("mission", "intelligence", "orders", "detections", "/tf", "/tf_static", info):
        search.tick(messages)


if __name__ == "__main__":
    main(Bench("tick-search"))
