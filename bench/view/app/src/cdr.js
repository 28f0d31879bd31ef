// CDR, little endian, as ROS 2 and the recordings write it: a header of 4 bytes, then values aligned to their size.
const decoder = new TextDecoder();

export class Cdr {
  constructor(data) {
    this.view = new DataView(data.buffer, data.byteOffset + 4, data.byteLength - 4);
    this.data = data;
    this.at = 0;
  }
  align(size) {
    this.at += (size - (this.at % size)) % size;
  }
  u32() {
    this.align(4);
    this.at += 4;
    return this.view.getUint32(this.at - 4, true);
  }
  f64() {
    this.align(8);
    this.at += 8;
    return this.view.getFloat64(this.at - 8, true);
  }
  bytes() {
    const length = this.u32();
    this.at += length;
    return this.data.subarray(4 + this.at - length, 4 + this.at);
  }
  string() {
    const bytes = this.bytes();
    return decoder.decode(bytes.subarray(0, Math.max(0, bytes.length - 1)));
  }
  stamp() {
    return this.u32() + this.u32() / 1e9;
  }
  header() {
    const time_s = this.stamp();
    return { time_s, frame: this.string() };
  }
  // Position and heading (radians from east, counterclockwise).
  pose() {
    const [x, y, z] = [this.f64(), this.f64(), this.f64()];
    const [qx, qy, qz, qw] = [this.f64(), this.f64(), this.f64(), this.f64()];
    return { x, y, z, yaw: Math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)) };
  }
  skip(doubles) {
    this.align(8);
    this.at += 8 * doubles;
  }
}

export function odometry(data) {
  const cdr = new Cdr(data);
  cdr.header();
  cdr.string();
  const pose = cdr.pose();
  cdr.skip(36);
  return { ...pose, speed_mps: Math.hypot(cdr.f64(), cdr.f64(), cdr.f64()) };
}

export function transforms(data) {
  const cdr = new Cdr(data);
  return Array.from({ length: cdr.u32() }, () => {
    cdr.header();
    return { child: cdr.string(), ...cdr.pose() };
  });
}

export function poses(data) {
  const cdr = new Cdr(data);
  cdr.header();
  const count = cdr.u32();
  const places = new Float32Array(2 * count);
  for (let index = 0; index < count; index += 1) {
    const { x, y } = cdr.pose();
    places[2 * index] = x;
    places[2 * index + 1] = y;
  }
  return places;
}

export function detections(data) {
  const cdr = new Cdr(data);
  const { time_s } = cdr.header();
  const boxes = Array.from({ length: cdr.u32() }, () => {
    cdr.header();
    let [label, score] = ["", 0];
    for (let left = cdr.u32(); left > 0; left -= 1) {
      const other = [cdr.string(), cdr.f64()];
      cdr.skip(7 + 36);
      if (other[1] >= score) [label, score] = other;
    }
    const [x, y] = [cdr.f64(), cdr.f64()];
    cdr.f64();
    const [width, height] = [cdr.f64(), cdr.f64()];
    cdr.string();
    return { label, score, box: [x - width / 2, y - height / 2, x + width / 2, y + height / 2] };
  });
  return { time_s, boxes };
}

export function picture(data) {
  const cdr = new Cdr(data);
  const { time_s } = cdr.header();
  cdr.string();
  return { time_s, blob: new Blob([cdr.bytes().slice()], { type: "image/jpeg" }) };
}

export const document_ = (data) => JSON.parse(new Cdr(data).string());
