// A recording while it is read: what the player shows, by time. Times are simulated seconds.
import { McapStreamReader } from "@mcap/core";
import { decompress } from "fzstd";
import { detections, document_, odometry, picture, poses, transforms } from "./cdr.js";

const TARGETS = ["adversary", "sought"];
export const PROTECTED = ["bystander", "sought"];
const text = new TextDecoder();

// The last place in `rows` whose time is at most `time_s`; -1 before the first.
export function placeAt(rows, time_s) {
  let [low, high] = [0, rows.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle].t <= time_s + 1e-9) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

export const rowAt = (rows, time_s) => rows[placeAt(rows, time_s)];

export class Tape {
  constructor() {
    this.simspec = null;
    this.cast = [];
    this.end_s = 0;
    this.messages = 0;
    this.malformed = 0;
    this.whole = false;
    this.fault = "";
    for (const name of LISTS) this[name] = [];
    this.reader = new McapStreamReader({
      decompressHandlers: { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) },
    });
    this.channels = new Map();
  }

  // Take the next bytes of the file. A damaged file is read as far as it can be.
  feed(bytes) {
    if (this.fault) return;
    try {
      this.reader.append(bytes);
      for (let record; (record = this.reader.nextRecord()); ) this.take(record);
      this.whole = this.reader.done();
    } catch (error) {
      this.fault = error.message;
    }
  }

  take(record) {
    if (record.type === "Channel") this.channels.set(record.id, record.topic);
    else if (record.type === "Attachment" && record.name === "simspec.json") {
      this.simspec = JSON.parse(text.decode(record.data));
    } else if (record.type === "Message") {
      this.messages += 1;
      const t = Number(record.logTime) / 1e9;
      this.end_s = Math.max(this.end_s, t);
      try {
        this.add(this.channels.get(record.channelId) ?? "", t, record.data);
      } catch {
        this.malformed += 1;
      }
    }
  }

  add(topic, t, data) {
    const [, camera, own, name] = /^\/(?:[^/]+\/)?(?:camera\/([^/]+)\/)?(agent\/)?(.+)$/.exec(topic) ?? [];
    if (topic === "/truth/odometry") this.flight.push({ t, ...odometry(data) });
    else if (topic === "/truth/actors") this.actors.push({ t, places: poses(data) });
    else if (topic === "/truth/cast") this.cast = document_(data).members;
    else if (topic === "/tf") {
      for (const { child, x, y, z } of transforms(data)) {
        if (child.endsWith("/base_link")) this.estimate.push({ t, x, y, z });
      }
    } else if (name === "image_raw/compressed") this.pictures.push({ t, camera, ...picture(data) });
    else if (name === "detections" && !camera) this.detections.push({ t, ...detections(data) });
    else if (topic.startsWith("/truth/") ? TRUTH.has(name) : own ? AGENT.has(name) : BENCH.has(name)) {
      const row = document_(data);
      if (name === "view") this.main_camera ??= row.camera;
      if (name !== "view" || row.camera === this.main_camera) this[name].push({ t, ...row });
    }
  }

  get targets() {
    return this.cast.flatMap((member, index) => (TARGETS.includes(member.role) ? [index] : []));
  }

  // Place of an actor at a time, between the two recorded ones around it.
  actorAt(index, time_s) {
    const at = Math.max(0, placeAt(this.actors, time_s));
    const [before, after] = [this.actors[at], this.actors[at + 1]];
    if (!before) return null;
    const [x, y] = [before.places[2 * index], before.places[2 * index + 1]];
    if (!after) return [x, y];
    const share = Math.min(1, Math.max(0, (time_s - before.t) / (after.t - before.t)));
    return [x + share * (after.places[2 * index] - x), y + share * (after.places[2 * index + 1] - y)];
  }

  // Metres from a place at a height to the nearest person whom the rules protect, in three dimensions as the rules count
  // them; null where there is none.
  nearestPerson(x, y, height_m, time_s) {
    const row = this.actors[Math.max(0, placeAt(this.actors, time_s))];
    let nearest_m = Infinity;
    if (row) {
      this.cast.forEach((member, index) => {
        if (PROTECTED.includes(member.role)) {
          nearest_m = Math.min(nearest_m, Math.hypot(row.places[2 * index] - x, row.places[2 * index + 1] - y, height_m));
        }
      });
    }
    return Number.isFinite(nearest_m) ? nearest_m : null;
  }
}

// Documents by the last part of their topic.
const AGENT = new Set(["reports", "decisions", "status", "tracks", "answers", "consent_requests"]);
const BENCH = new Set(["orders", "consents", "operator_link", "intelligence", "mission", "events"]);
const TRUTH = new Set(["vehicle", "view"]);
const LISTS = [...AGENT, ...BENCH, ...TRUTH, "flight", "actors", "estimate", "detections", "pictures"];

// Of a recording that is fetched at a time. Chosen: a fifth of a second of decoding.
const PIECE_BYTES = 1 << 19;

// Read on from byte `from`; the byte after the last that was there. `onPiece` is told of progress, and ends it by false.
export async function readOn(tape, address, from, onPiece = () => true) {
  for (;;) {
    // With the last byte that is there already: a range beyond the end would be an error.
    const first = Math.max(0, from - 1);
    const answer = await fetch(address, { headers: { Range: `bytes=${first}-${first + PIECE_BYTES - 1}` } });
    if (answer.status === 416) throw new Error("the recording is written anew");
    if (!answer.ok) throw new Error(`${answer.status}: ${await answer.text()}`);
    const bytes = new Uint8Array(await answer.arrayBuffer()).subarray(from - first);
    tape.feed(bytes);
    from += bytes.length;
    const size = Number(answer.headers.get("Content-Range")?.split("/")[1] ?? from);
    if (!onPiece(from / size) || from >= size || !bytes.length) return from;
  }
}
