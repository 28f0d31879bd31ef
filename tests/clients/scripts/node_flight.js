// A hop on PX4 by Node alone: arm, take off, come down; one JSON document at the end.
"use strict";
const dgram = require("node:dgram");

const [host, port] = process.env.REBAR_MAVLINK.replace("udpin:", "").split(":");
const socket = dgram.createSocket("udp4");
// Message numbers of MAVLink's common dialect, with the seed of each checksum.
const HEARTBEAT = 0, COMMAND_LONG = 76, COMMAND_ACK = 77, POSITION = 33, STATE = 245;
const EXTRA = { [HEARTBEAT]: 50, [COMMAND_LONG]: 152 };
const TAKEOFF = 22, LAND = 21, ARM = 400;
let peer = null, sequence = 0, beat = null, state = 0, height_m = 0;
const acks = new Map();

function checksum(bytes, extra) { // CRC-16/MCRF4XX
  let crc = 0xffff;
  for (const byte of [...bytes, extra]) {
    let t = byte ^ (crc & 0xff);
    t = (t ^ (t << 4)) & 0xff;
    crc = ((crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4)) & 0xffff;
  }
  return crc;
}

function send(message, payload) {
  if (!peer) return;
  const head = Buffer.from([0xfd, payload.length, 0, 0, sequence++ & 0xff, 245, 190, message, 0, 0]);
  const end = Buffer.alloc(2);
  end.writeUInt16LE(checksum([...head.subarray(1), ...payload], EXTRA[message]));
  socket.send(Buffer.concat([head, payload, end]), peer.port, peer.address);
}

function command(number, ...params) {
  const payload = Buffer.alloc(33);
  for (let i = 0; i < 7; i++) payload.writeFloatLE(i < params.length ? params[i] : 0, 4 * i);
  payload.writeUInt16LE(number, 28);
  payload.set([1, 1, 0], 30);
  acks.delete(number);
  send(COMMAND_LONG, payload);
}

socket.on("message", (data, from) => {
  peer = from;
  for (let at = 0; at + 10 < data.length && data[at] === 0xfd; at += 12 + data[at + 1]) {
    const message = data.readUIntLE(at + 7, 3), payload = Buffer.alloc(64); // trailing zeros are not sent
    data.copy(payload, 0, at + 10, at + 10 + data[at + 1]);
    if (data[at + 6] !== 1) continue;
    if (message === HEARTBEAT) beat = { armed: (payload[6] & 128) !== 0 };
    else if (message === COMMAND_ACK) acks.set(payload.readUInt16LE(0), payload[2]);
    else if (message === POSITION) height_m = payload.readInt32LE(16) / 1000;
    else if (message === STATE) state = payload[1];
  }
});

const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

async function until(what, holds, limit_s = 60) {
  const end = performance.now() + limit_s * 1000;
  while (!holds()) {
    if (performance.now() > end) { console.error(`gave up waiting for ${what}`); process.exit(1); }
    await sleep(50);
  }
}

async function insist(number, ...params) {
  for (let tries = 0; tries < 60; tries++) {
    command(number, ...params);
    await sleep(1000);
    if (acks.get(number) === 0) return;
  }
  console.error(`command ${number} was refused`);
  process.exit(1);
}

async function main() {
  await until("a heartbeat", () => beat !== null);
  const spans_ms = [];
  let last = performance.now();
  const beats = setInterval(() => {
    spans_ms.push(Math.round((performance.now() - last) * 1000) / 1000);
    last = performance.now();
    send(HEARTBEAT, Buffer.from([0, 0, 0, 0, 6, 8, 0, 4, 3]));
  }, 1000);
  await insist(ARM, 1);
  await insist(TAKEOFF, 0, 0, 0, NaN, NaN, NaN, NaN);
  await until("the height", () => height_m > 2.0);
  const highest_m = height_m;
  await insist(LAND);
  await until("the ground", () => state === 1 && !beat.armed);
  clearInterval(beats);
  socket.close();
  console.log(JSON.stringify({ highest_m, seconds: spans_ms.length, longest_ms: Math.max(...spans_ms) }));
}

socket.bind(Number(port), host, () => main());
