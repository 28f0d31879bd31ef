// A client of the bench in one file, with nothing but Node: copy it beside your agent (manifest: `air: tick`).
//
// The air network comes and goes as JSON in the lines of the tick socket; MAVLink goes over UDP and is read and written here as
// far as an agent needs it that flies by the autopilot's own modes. docs/agents-protocol.md describes both.
"use strict";
const dgram = require("node:dgram");
const net = require("node:net");
const readline = require("node:readline");

const OWN_SYSTEM = 246;
const OWN_COMPONENT = 1;
const ARDUPILOT = 3;
// Extra byte of the checksum by message, from MAVLink's definition of each.
const CRC_EXTRA = { 0: 50, 75: 158, 76: 152 };
const EARTH_M = 6378137.0;
const radians = (degrees) => (degrees * Math.PI) / 180;

// MAVLink's checksum: CRC-16/MCRF4XX.
function crc(data) {
  let value = 0xffff;
  for (let byte of data) {
    byte ^= value & 0xff;
    byte ^= (byte << 4) & 0xff;
    value = ((value >> 8) ^ (byte << 8) ^ (byte << 3) ^ (byte >> 4)) & 0xffff;
  }
  return value;
}

// The autopilot behind REBAR_MAVLINK: `ready`, `armed`, `height_m`, `place(origin)`.
class Vehicle {
  constructor(address) {
    const [, host, port] = address.split(":");
    this.socket = dgram.createSocket("udp4");
    this.bound = new Promise((resolve) => this.socket.bind(Number(port), host, resolve));
    this.socket.on("message", (data, peer) => this.take(data, peer));
    Object.assign(this, { peer: null, received: 0, sent: 0, wanted: 0, wake: null, ready: false, armed: false, autopilot: 0 });
    Object.assign(this, { latitude_deg: 0, longitude_deg: 0, height_m: 0, amsl_m: 0 });
  }

  // Resolves when `count` frames have come since the start: lockstep states it in each tick, the other paces do not.
  receive(count) {
    this.wanted = count;
    return this.received >= count ? Promise.resolve() : new Promise((resolve) => (this.wake = resolve));
  }

  take(data, peer) {
    this.peer = peer;
    for (let at = 0; at < data.length; ) {
      const length = data[at + 1];
      // MAVLink leaves out zeros at the end of a payload; they are put back.
      const payload = Buffer.alloc(256);
      data.copy(payload, 0, at + 10, at + 10 + length);
      this.read(data.readUIntLE(at + 7, 3), payload);
      this.received += 1;
      at += 12 + length + 13 * (data[at + 2] & 1); // header, payload, checksum, and a signature where there is one
    }
    if (this.wake && this.received >= this.wanted) {
      this.wake();
      this.wake = null;
    }
  }

  read(message, payload) {
    if (message === 0 && payload[5] !== 8) {
      [this.autopilot, this.armed] = [payload[5], Boolean(payload[6] & 128)]; // HEARTBEAT, not of a ground station
    } else if (message === 1) {
      this.ready = Boolean(payload.readUInt32LE(8) & 0x10000000); // SYS_STATUS: MAV_SYS_STATUS_PREARM_CHECK is healthy
    } else if (message === 33) {
      // GLOBAL_POSITION_INT
      this.latitude_deg = payload.readInt32LE(4) * 1e-7;
      this.longitude_deg = payload.readInt32LE(8) * 1e-7;
      this.amsl_m = payload.readInt32LE(12) * 1e-3;
      this.height_m = payload.readInt32LE(16) * 1e-3;
    }
  }

  send(message, payload) {
    if (!this.peer) return; // nothing has come from it yet, so nobody knows where it listens
    let length = payload.length;
    while (length > 1 && payload[length - 1] === 0) length -= 1;
    const id = [message & 0xff, (message >> 8) & 0xff, message >> 16];
    const head = Buffer.from([length, 0, 0, this.sent % 256, OWN_SYSTEM, OWN_COMPONENT, ...id]);
    const body = Buffer.concat([head, payload.subarray(0, length)]);
    const sum = crc(Buffer.concat([body, Buffer.from([CRC_EXTRA[message]])]));
    const frame = Buffer.concat([Buffer.from([0xfd]), body, Buffer.from([sum & 0xff, sum >> 8])]);
    this.socket.send(frame, this.peer.port, this.peer.address);
    this.sent += 1;
  }

  // Once a second.
  heartbeat() {
    this.send(0, Buffer.from([0, 0, 0, 0, 18, 8, 0, 4, 3]));
    if (this.autopilot === ARDUPILOT && !this.amsl_m) {
      this.command(511, 1, 1e6); // it streams nothing of itself
      this.command(511, 33, 1e5);
    }
  }

  // COMMAND_LONG, the parameters filled up with zeros.
  command(number, ...parameters) {
    const payload = Buffer.alloc(33);
    parameters.forEach((value, index) => payload.writeFloatLE(value, 4 * index));
    payload.writeUInt16LE(number, 28);
    payload.set([1, 1, 0], 30);
    this.send(76, payload);
  }

  arm() {
    if (this.autopilot === ARDUPILOT) this.command(176, 1, 4); // GUIDED
    this.command(400, 1);
  }

  take_off(height_m) {
    if (this.autopilot === ARDUPILOT) return this.command(22, 0, 0, 0, 0, 0, 0, height_m);
    this.command(22, NaN, 0, 0, NaN, NaN, NaN, this.amsl_m - this.height_m + height_m);
  }

  // DO_REPOSITION: the autopilot flies there by itself and stays.
  go_to(origin, east_m, north_m, height_m, speed_mps) {
    const [ofLongitude_m, ofLatitude_m] = metresOfDegree(origin);
    const payload = Buffer.alloc(35);
    [speed_mps, 1, 0, NaN].forEach((value, index) => payload.writeFloatLE(value, 4 * index));
    payload.writeInt32LE(Math.round((origin.latitude_deg + north_m / ofLatitude_m) * 1e7), 16);
    payload.writeInt32LE(Math.round((origin.longitude_deg + east_m / ofLongitude_m) * 1e7), 20);
    payload.writeFloatLE(this.amsl_m - this.height_m + height_m, 24);
    payload.writeUInt16LE(192, 28);
    payload.set([1, 1, 0, 0, 0], 30);
    this.send(75, payload);
  }

  land() {
    this.command(21, 0, 0, 0, NaN);
  }

  // East and north of the mission's origin, metres.
  place(origin) {
    const [east_m, north_m] = metresOfDegree(origin);
    return [
      (this.longitude_deg - origin.longitude_deg) * east_m,
      (this.latitude_deg - origin.latitude_deg) * north_m,
    ];
  }
}

// Of longitude and of latitude, on a sphere: a centimetre in a hundred metres is enough for a search.
function metresOfDegree(origin) {
  const metre = radians(EARTH_M + origin.altitude_m);
  return [metre * Math.cos(radians(origin.latitude_deg)), metre];
}

// A vector turned by a quaternion as ROS writes it.
function turned({ x, y, z, w }, v) {
  const a = 2 * (y * v[2] - z * v[1]);
  const b = 2 * (z * v[0] - x * v[2]);
  const c = 2 * (x * v[1] - y * v[0]);
  return [v[0] + w * a + y * c - z * b, v[1] + w * b + z * a - x * c, v[2] + w * c + x * b - y * a];
}

// Detections thrown onto flat ground, by the latest pose and the camera's mount.
class Eye {
  constructor() {
    Object.assign(this, { poses: {}, mount: null, k: null });
  }

  // Take in a message; the objects in it, if it holds detections: {class_label, confidence, east_m, north_m}.
  see(topic, message) {
    if (topic === "/tf_static") this.mount = message.transforms[0];
    else if (topic === "/tf") for (const item of message.transforms) this.poses[item.child_frame_id] = item.transform;
    else if (topic.endsWith("/camera_info")) this.k = message.k;
    else if (topic.endsWith("/detections") && this.k && this.mount) {
      const body = this.poses[this.mount.header.frame_id];
      if (body) return message.detections.map((detection) => this.ground(body, detection)).filter(Boolean);
    }
    return [];
  }

  ground(body, { bbox, results }) {
    // The middle of the lower edge stands on the ground.
    const x = (bbox.center.position.x - this.k[2]) / this.k[0];
    const y = (bbox.center.position.y + bbox.size_y / 2 - this.k[5]) / this.k[4];
    const ray = turned(body.rotation, turned(this.mount.transform.rotation, [x, y, 1]));
    if (ray[2] > -0.05) return null;
    const far = body.translation.z / -ray[2];
    const { class_id: class_label, score: confidence } = results[0].hypothesis;
    return {
      ...{ class_label, confidence },
      east_m: body.translation.x + far * ray[0],
      north_m: body.translation.y + far * ray[1],
    };
  }
}

// The session: `ticks` calls `act` with the messages of each tick; `publish` answers with the ack.
class Bench {
  constructor(name) {
    const { REBAR_VEHICLE, REBAR_OPTIONS, REBAR_MAVLINK } = process.env;
    Object.assign(this, { name, vehicle_name: REBAR_VEHICLE, now_s: 0, outbox: [] });
    this.options = JSON.parse(REBAR_OPTIONS || "{}");
    this.vehicle = new Vehicle(REBAR_MAVLINK);
  }

  // Under /VEHICLE/agent/: reports, decisions, status, tracks, answers, consent_requests.
  publish(topic, message) {
    this.outbox.push({ topic: `/${this.vehicle_name}/agent/${topic}`, message });
  }

  // Messages of these topics (`mission` is /VEHICLE/mission, `/tf` itself), tick by tick to the end of the session.
  async ticks(topics, act) {
    const subscribes = topics.map((topic) => (topic[0] === "/" ? topic : `/${this.vehicle_name}/${topic}`));
    const [host, port] = process.env.REBAR_TICK.split(":");
    await this.vehicle.bound;
    const connection = net.connect(Number(port), host).setNoDelay();
    const say = (document) => connection.write(`${JSON.stringify(document)}\n`);
    say({ kind: "hello", protocol: 1, agent: this.name, subscribes, secret: process.env.REBAR_TICK_SECRET });
    for await (const line of readline.createInterface({ input: connection })) {
      const tick = JSON.parse(line);
      if (tick.kind === "end") {
        console.log(tick.reason);
        break;
      }
      this.now_s = tick.time_ns * 1e-9;
      await this.vehicle.receive(tick.links.onboard || 0);
      act((tick.air || []).map(({ topic, message }) => [topic, message]));
      say({ kind: "ack", number: tick.number, links: { onboard: this.vehicle.sent }, air: this.outbox });
      this.outbox = [];
    }
    process.exit(0);
  }
}

module.exports = { Bench, Eye };
