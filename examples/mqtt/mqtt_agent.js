// An agent that knows MQTT and JSON alone, for Node 18 and newer: flies to each reported place, comes home and lands, at any
// pace. Install its client here first: npm install --no-package-lock. mqtt_agent_node.yaml starts it behind the bridge;
// docs/mqtt-agents.md describes the topics.
"use strict";
const fs = require("node:fs");
const mqtt = require("mqtt");

const { REBAR_MQTT, REBAR_MQTT_PASSWORD, REBAR_MQTT_CA, REBAR_VEHICLE } = process.env;
const prefix = new URL(REBAR_MQTT).pathname.slice(1);
const DEGREE_M = 111_200, HEIGHT_M = 30;
const ARRIVED = 450; // in 1e-7 degrees, as MAVLink states positions: some 5 m
const ARM = 400, TAKE_OFF = 22, LAND = 21, REPOSITION = 192; // MAV_CMD
const HEARTBEAT = { type: 18, autopilot: 8, mavlink_version: 3 };
const documents = {}; // every document that has come, by topic
const mavlink = {}; // the last message of each name
const received = {}, sent = {}; // how many messages, by topic

// The same longitude from -180 to 180: the date line lies in between.
const wrapped = (degrees) => degrees - 360 * Math.round(degrees / 360);

// The flight in steps: a phase, and the message to send every two seconds until the next one.
function* fly() {
  while (!mavlink.HEARTBEAT || !mavlink.GLOBAL_POSITION_INT || !documents.mission) yield ["starting", "HEARTBEAT", HEARTBEAT];
  const { origin, home } = documents.mission[0];
  const ground_m = mavlink.GLOBAL_POSITION_INT.alt * 1e-3;
  while (mavlink.GLOBAL_POSITION_INT.relative_alt * 1e-3 < 0.8 * HEIGHT_M) {
    const up = { command: TAKE_OFF, param4: null, param5: null, param6: null, param7: ground_m + HEIGHT_M };
    yield ["taking_off", "COMMAND_LONG", mavlink.HEARTBEAT.base_mode & 128 ? up : { command: ARM, param1: 1 }];
  }
  for (const place of [...(documents.intelligence ?? []), home]) {
    const east_deg = place.east_m / DEGREE_M / Math.cos((origin.latitude_deg * Math.PI) / 180);
    const x = Math.round((origin.latitude_deg + place.north_m / DEGREE_M) * 1e7);
    const y = Math.round(wrapped(origin.longitude_deg + east_deg) * 1e7);
    const there = { command: REPOSITION, param1: 8, param2: 1, param4: null, x, y, z: ground_m + HEIGHT_M };
    const away = ({ lat, lon }) => Math.hypot(lat - x, wrapped((lon - y) * 1e-7) * 1e7);
    while (away(mavlink.GLOBAL_POSITION_INT) > ARRIVED)
      yield ["searching", "COMMAND_INT", there];
  }
  while (mavlink.HEARTBEAT.base_mode & 128) yield ["landing", "COMMAND_LONG", { command: LAND, param4: null }];
  while (true) yield ["complete", "HEARTBEAT", HEARTBEAT];
}

const flight = fly();
let tick = null, due_s = 0;
// Without reconnecting: in lockstep nobody knows what a lost connection has lost. The bench sees the agent end.
const client = mqtt.connect(REBAR_MQTT, {
  password: REBAR_MQTT_PASSWORD,
  ca: REBAR_MQTT_CA && fs.readFileSync(REBAR_MQTT_CA), // of a broker by TLS that no public authority vouches for
  reconnectPeriod: 0,
});

function send(topic, document) {
  sent[topic] = (sent[topic] ?? 0) + 1;
  client.publish(`${prefix}/${topic}`, JSON.stringify(document));
}

client.on("connect", async () => {
  client.stream.setNoDelay(true); // small messages would wait for an acknowledgement, up to 40 ms
  await client.subscribeAsync(`${prefix}/#`);
  send("bridge/ready", { agent: "mqtt-agent-node" });
});

client.on("message", (name, payload) => {
  const topic = name.slice(prefix.length + 1), document = JSON.parse(payload);
  received[topic] = (received[topic] ?? 0) + 1;
  if (topic === "mavlink/onboard/to_agent") mavlink[document.name] = document.fields;
  else (documents[topic.split("/").pop()] ??= []).push(document);
  if (topic === "bridge/tick") tick = document;
  // MQTT keeps the order of one topic alone: a tick counts once all that it states is here. In real time a broker may have
  // dropped a message, and nobody waits.
  const states = tick?.lockstep ? Object.entries(tick.topics) : [];
  if (tick === null || states.some(([stated, count]) => (received[stated] ?? 0) < count)) return;
  const time_s = tick.time_ns * 1e-9;
  if (time_s >= due_s) {
    due_s = time_s + 2;
    const [phase, message, fields] = flight.next().value;
    send(`${REBAR_VEHICLE}/agent/status`, { time_s, phase });
    const target = message === "HEARTBEAT" ? {} : { target_system: 1, target_component: 1 };
    send("mavlink/onboard/from_agent", { name: message, fields: { ...target, ...fields } });
  }
  send("bridge/ack", { number: tick.number, topics: sent });
  tick = null;
});

client.on("error", (error) => { throw error; });
client.on("close", () => process.exit(0));
