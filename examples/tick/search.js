// An agent without a library: searches the reported places by the urgency of each, reports what it sees there, comes home.
"use strict";
const { Bench, Eye } = require("./rebar_air.js");

// A sighting in three detections of one class within 15 m of each other, none of them doubtful. Chosen.
const [SIGHTINGS, NEAR_M, SCORE] = [3, 15, 0.35];
// Who walks is elsewhere after a while; chosen.
const FORGET_S = 30;
const apart = (a, b) => Math.hypot(a.east_m - b.east_m, a.north_m - b.north_m);

const bench = new Bench("tick-search");
const eye = new Eye();
const { vehicle } = bench;
const [intelligence, things] = [new Map(), []];
const [visited, reported, seen_s] = [new Set(), new Set(), new Map()];
let [mission, phase, arrived_s, asked_s, second_s] = [null, "starting", null, -Infinity, -Infinity];

function remember(seen) {
  if (seen.confidence < SCORE) return;
  const thing = things.find((item) => item.class_label === seen.class_label && apart(item, seen) < NEAR_M);
  if (!thing) {
    things.push({ id: `${seen.class_label}-${things.length}`, ...seen, frames: 1 });
    return;
  }
  // The mean of all sightings.
  thing.frames += 1;
  seen_s.set(thing.id, bench.now_s);
  for (const key of ["east_m", "north_m"]) thing[key] += (seen[key] - thing[key]) / thing.frames;
  thing.confidence = Math.max(thing.confidence, seen.confidence);
}

const walks = ({ class_label }) => mission.bystander_classes.includes(class_label);
const isHeld = (thing) =>
  thing.frames >= SIGHTINGS && (bench.now_s - seen_s.get(thing.id) < FORGET_S || !walks(thing));

function report(target, thing) {
  const people = things.filter(
    (other) => mission.bystander_classes.includes(other.class_label) && other.frames >= SIGHTINGS,
  );
  const near = people.map((other) => apart(other, thing)).filter((far_m) => far_m < mission.no_mark_within_m);
  near.sort((a, b) => a - b);
  reported.add(target.id);
  const { class_label, east_m, north_m, confidence } = thing;
  bench.publish("reports", {
    ...{ id: `report-${target.id}`, time_s: bench.now_s, intelligence_id: target.id },
    ...{ class_label, east_m, north_m, confidence, mark: near.length === 0, bystanders_seen: near.length },
    reason: near.length ? `${near.length} people near the ${class_label}` : "nobody is near",
    ...(near.length ? { nearest_bystander_m: near[0] } : {}),
  });
}

function reportSightings() {
  for (const target of intelligence.values()) {
    const found = things.find(
      (thing) =>
        thing.class_label === target.class_label && thing.frames >= SIGHTINGS && apart(thing, target) <= target.uncertainty_m,
    );
    if (found && !reported.has(target.id)) report(target, found);
  }
}

function fly() {
  const again = bench.now_s - asked_s >= 3;
  const { origin, home, altitude_m, speed_mps } = mission;
  if (again) asked_s = bench.now_s;
  if (phase === "starting" || phase === "taking_off") {
    phase = vehicle.armed ? "taking_off" : "starting";
    if (vehicle.height_m > 0.8 * altitude_m) phase = "transit";
    else if (again && vehicle.ready) vehicle.armed ? vehicle.take_off(altitude_m) : vehicle.arm();
  } else if (phase === "transit" || phase === "returning") {
    const left = [...intelligence.values()].filter((target) => !visited.has(target.id));
    const goal = left.length ? left.reduce((a, b) => (b.priority < a.priority ? b : a)) : home;
    phase = left.length ? "transit" : "returning";
    if (again) vehicle.go_to(origin, goal.east_m, goal.north_m, altitude_m, speed_mps);
    const [east_m, north_m] = vehicle.place(origin);
    if (apart({ east_m, north_m }, goal) >= 5) return;
    // Over the place for eight seconds, or down at home.
    arrived_s ??= bench.now_s;
    if (!left.length) phase = "landing";
    else if (bench.now_s - arrived_s > 8) {
      visited.add(goal.id);
      arrived_s = null;
    }
  } else if (phase === "landing") {
    if (again) vehicle.land();
    if (!vehicle.armed) phase = "complete";
  }
}

bench.ticks(
  ["mission", "intelligence", "orders", "detections", "/tf", "/tf_static", `camera/${bench.options.camera || "front"}/camera_info`],
  (messages) => {
    for (const [topic, message] of messages) {
      if (topic.endsWith("/mission")) mission = message;
      else if (topic.endsWith("/intelligence")) intelligence.set(message.id, message);
      else if (topic.endsWith("/orders")) {
        const reason = "this agent knows no orders yet";
        bench.publish("answers", { time_s: bench.now_s, order: message.id, accepted: false, reason });
      } else eye.see(topic, message).forEach(remember);
    }
    if (bench.now_s - second_s >= 1) {
      second_s = bench.now_s;
      vehicle.heartbeat();
      bench.publish("status", { time_s: bench.now_s, phase });
      bench.publish("tracks", { time_s: bench.now_s, tracks: things.filter(isHeld) });
    }
    if (!mission) return;
    reportSightings();
    fly();
  },
);
