// The ground plan of a run at one moment: east to the right, north up, metres.
import { useEffect, useRef, useState } from "preact/hooks";
import { PROTECTED, placeAt, rowAt } from "./tape.js";
import { useSize } from "./hooks.js";
import { oneLine } from "./visible.js";

const NAMES = [
  ...["ink", "ink-soft", "line", "grid", "paper", "page", "accent", "adversary", "sought", "bystander", "clutter"],
  ...["intelligence", "report", "forbidden", "no-fly", "road", "warn"],
];
const WHEEL = 0.0015; // a notch of a usual wheel, 100 pixels, is 16 %
const MARGIN_PX = 26;
const PICK_PX = 14;

export function colours() {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

const ring = (corners) => corners.map(({ east_m, north_m }) => [east_m, north_m]);
// A SimSpec's areas are objects with corners, some of them a list of corners by itself.
const corners = (area) => ring(area?.corners ?? area?.area?.corners ?? []);

function bounds(tape) {
  const spec = tape.simspec ?? {};
  const places = [...corners(spec.world?.area), ...corners(spec.rules?.geofence), ...tape.flight.filter((_, i) => i % 20 === 0).map(({ x, y }) => [x, y])];
  if (spec.vehicle?.home) places.push([spec.vehicle.home.east_m, spec.vehicle.home.north_m]);
  if (!places.length) places.push([-100, -100], [100, 100]);
  const [xs, ys] = [places.map(([x]) => x), places.map(([, y]) => y)];
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

class Drawing {
  constructor(canvas, tape, time_s, view, size) {
    const ratio = devicePixelRatio || 1;
    canvas.width = size.width * ratio;
    canvas.height = size.height * ratio;
    Object.assign(this, { tape, t: time_s, size, c: colours(), g: canvas.getContext("2d") });
    this.g.scale(ratio, ratio);
    const [west, south, east, north] = bounds(tape);
    const fit = Math.min((size.width - 2 * MARGIN_PX) / (east - west || 1), (size.height - 2 * MARGIN_PX) / (north - south || 1));
    // An element that is narrower than the margins, while the window changes.
    this.scale = Math.max(fit, 1e-3) * view.zoom;
    this.left = size.width / 2 - ((west + east) / 2) * this.scale + view.x;
    this.bottom = size.height / 2 + ((south + north) / 2) * this.scale + view.y;
    this.spots = [];
  }
  at([x, y]) {
    return [this.left + x * this.scale, this.bottom - y * this.scale];
  }
  path(places, close = false) {
    this.g.beginPath();
    places.forEach((place) => this.g.lineTo(...this.at(place)));
    if (close) this.g.closePath();
  }
  stroke(colour, width = 1, dash = []) {
    Object.assign(this.g, { strokeStyle: colour, lineWidth: width });
    this.g.setLineDash(dash);
    this.g.stroke();
    this.g.setLineDash([]);
  }
  fill(colour) {
    this.g.fillStyle = colour;
    this.g.fill();
  }
  circle(place, radius_px) {
    this.g.beginPath();
    this.g.arc(...this.at(place), radius_px, 0, 2 * Math.PI);
  }
  words(text, x, y, colour, align = "left") {
    Object.assign(this.g, { textAlign: align, lineWidth: 3, strokeStyle: this.c.paper, fillStyle: colour });
    this.g.strokeText(text, x, y);
    this.g.fillText(text, x, y);
  }
  // What a pointer near it names.
  spot(place, text) {
    const [x, y] = this.at(place);
    this.spots.push({ x, y, text });
  }

  all() {
    const { g, c, size } = this;
    g.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    g.lineJoin = "round";
    g.fillStyle = c.page;
    g.fillRect(0, 0, size.width, size.height);
    this.ground();
    this.rings();
    this.people();
    this.flown();
    this.believed();
    this.scaleBar();
    return this.spots;
  }
  ground() {
    const { c } = this;
    const { world = {}, rules = {}, vehicle = {}, intelligence = [], realized } = this.tape.simspec ?? {};
    this.path(corners(world.area), true);
    this.fill(c.paper);
    this.stroke(c.line, 1.5);
    for (const road of world.roads ?? []) {
      this.path(ring(road.points));
      this.stroke(c.road, Math.max(2, road.width_m * this.scale));
    }
    for (const area of world.areas ?? []) {
      this.path(corners(area), true);
      this.stroke(c["ink-soft"], 1, [1, 3]);
      this.words(area.id, ...this.at(corners(area)[0] ?? [0, 0]), c["ink-soft"]);
    }
    if (rules.geofence) {
      this.path(corners(rules.geofence), true);
      this.stroke(c.accent, 1.2, [7, 4]);
    }
    for (const closed of rules.no_fly ?? []) {
      const holds = this.t >= closed.from_s && (closed.until_s == null || this.t < closed.until_s);
      this.path(corners(closed), true);
      if (holds) this.fill(c["no-fly"]);
      this.stroke(c.forbidden, holds ? 1.4 : 0.8, holds ? [] : [3, 4]);
      const span = closed.from_s > 0 || closed.until_s != null ? ` ${closed.from_s}–${closed.until_s ?? "end"} s` : "";
      this.words(`${closed.id}${span}`, ...this.at(corners(closed)[0] ?? [0, 0]).map((v, i) => v + (i ? -4 : 3)), c.forbidden);
    }
    const stated = new Map(intelligence.map((report) => [report.id, report]));
    for (const report of realized?.reports ?? []) {
      const { uncertainty_m = 0, priority } = stated.get(report.id) ?? {};
      const place = [report.east_m, report.north_m];
      this.circle(place, Math.max(2, uncertainty_m * this.scale));
      this.stroke(c.intelligence, 1, [2, 3]);
      const [x, y] = this.at(place);
      const corner = Math.SQRT1_2 * uncertainty_m * this.scale + 2;
      this.words(`P${priority ?? "?"}`, x + corner, y - corner, c.intelligence);
      this.spot(place, `intelligence ${report.id}, ±${uncertainty_m} m, priority ${priority}`);
    }
    if (vehicle.home) {
      const home = [vehicle.home.east_m, vehicle.home.north_m];
      const [x, y] = this.at(home);
      this.g.strokeStyle = c["ink-soft"];
      this.g.lineWidth = 1.2;
      this.g.strokeRect(x - 5, y - 5, 10, 10);
      this.words("H", x, y + 4, c["ink-soft"], "center");
      this.spot(home, "home");
    }
  }
  // The distance at which people near a target forbid a mark, and that which the vehicle keeps from people.
  rings() {
    const { tape, c } = this;
    const { no_mark_within_m = 0, bystander_standoff_m = 0 } = tape.simspec?.rules ?? {};
    for (const index of tape.targets) {
      const place = tape.actorAt(index, this.t);
      if (!place || !no_mark_within_m) continue;
      const near_m = tape.nearestPerson(...place, 0, this.t);
      const forbidden = near_m !== null && near_m < no_mark_within_m && tape.cast[index].role === "adversary";
      this.circle(place, no_mark_within_m * this.scale);
      this.stroke(forbidden ? c.forbidden : c["ink-soft"], 1, [5, 4]);
    }
    if (bystander_standoff_m * this.scale > 4) {
      tape.cast.forEach((member, index) => {
        if (!PROTECTED.includes(member.role)) return;
        const place = tape.actorAt(index, this.t);
        if (!place) return;
        this.circle(place, bystander_standoff_m * this.scale);
        this.g.globalAlpha = 0.4;
        this.stroke(c.bystander, 0.7, [2, 2]);
        this.g.globalAlpha = 1;
      });
    }
  }
  people() {
    const { tape, c } = this;
    const seen = new Set((rowAt(tape.view, this.t)?.sightings ?? []).map(({ actor }) => actor));
    tape.cast.forEach((member, index) => {
      const place = tape.actorAt(index, this.t);
      if (!place) return;
      const [x, y] = this.at(place);
      const size = member.role === "clutter" ? 2 : PROTECTED.includes(member.role) ? 3 : 5;
      this.g.beginPath();
      if (member.role === "adversary") this.g.rect(x - size, y - size, 2 * size, 2 * size);
      else this.g.arc(x, y, size, 0, 2 * Math.PI);
      this.fill(c[member.role] ?? c.ink);
      if (seen.has(index)) {
        this.circle(place, size + 3.5);
        this.stroke(c.ink, 1);
      }
      this.spot(place, `${member.id} (${member.class_label}, ${member.role})${seen.has(index) ? ", in view" : ""}`);
    });
  }
  flown() {
    const { tape, c } = this;
    const until = placeAt(tape.flight, this.t) + 1;
    const line = (rows) => rows.filter((_, i) => i % 3 === 0 || i === rows.length - 1).map(({ x, y }) => [x, y]);
    this.path(line(tape.flight));
    this.stroke(c.line, 1);
    this.path(line(tape.flight.slice(0, until)));
    this.stroke(c.accent, 1.8);
    const now = tape.flight[until - 1];
    if (!now) return;
    const thought = rowAt(tape.estimate, this.t);
    if (thought && Math.hypot(thought.x - now.x, thought.y - now.y) > 3) {
      this.path([[now.x, now.y], [thought.x, thought.y]]);
      this.stroke(c.warn, 1.2, [3, 2]);
      this.circle([thought.x, thought.y], 4);
      this.stroke(c.warn, 1.5);
      this.spot([thought.x, thought.y], "where the vehicle believes to be");
    }
    const [x, y] = this.at([now.x, now.y]);
    const { g } = this;
    g.save();
    g.translate(x, y);
    g.rotate(-now.yaw);
    g.beginPath();
    [[11, 0], [-7, 7], [-3, 0], [-7, -7]].forEach((corner) => g.lineTo(...corner));
    g.closePath();
    this.fill(c.accent);
    this.stroke(c.paper, 1.5);
    g.restore();
    this.spot([now.x, now.y], `vehicle, ${now.z.toFixed(0)} m high, ${now.speed_mps.toFixed(1)} m/s`);
  }
  // What the agent holds for true, and what it has reported.
  believed() {
    const { tape, c, g } = this;
    for (const track of rowAt(tape.tracks, this.t)?.tracks ?? []) {
      const [x, y] = this.at([track.east_m, track.north_m]);
      g.beginPath();
      [[0, -6], [6, 0], [0, 6], [-6, 0]].forEach(([dx, dy]) => g.lineTo(x + dx, y + dy));
      g.closePath();
      this.stroke(c.ink, 1);
      this.spot([track.east_m, track.north_m], `${oneLine(track.id)}: ${oneLine(track.class_label)}, ${(100 * track.confidence).toFixed(0)} %, ${track.frames} frames`);
    }
    for (const report of tape.reports) {
      if (report.t > this.t) break;
      const place = [report.east_m, report.north_m];
      const [x, y] = this.at(place);
      const colour = report.mark ? c.forbidden : c.report;
      g.beginPath();
      [[-6, -6], [6, 6]].forEach(([dx, dy]) => g.lineTo(x + dx, y + dy));
      g.moveTo(x - 6, y + 6);
      g.lineTo(x + 6, y - 6);
      this.stroke(c.paper, 5);
      this.stroke(colour, 2.4);
      if (tape.reports.length <= 40) this.words(`${report.mark ? "MARK " : ""}${oneLine(report.class_label).slice(0, 40)}`, x + 9, y - 5, colour);
      this.spot(place, `${report.mark ? "mark" : "report"} ${oneLine(report.class_label)} at ${report.t.toFixed(1)} s`);
    }
  }
  scaleBar() {
    const { g, c, size } = this;
    const length_m = [1000, 500, 200, 100, 50, 20, 10, 5, 2, 1].find((m) => m * this.scale < size.width / 4) ?? 1;
    const [x, y, length] = [12, size.height - 12, length_m * this.scale];
    g.beginPath();
    [[x, y - 4], [x, y], [x + length, y], [x + length, y - 4]].forEach((corner) => g.lineTo(...corner));
    this.stroke(c["ink-soft"], 1.2);
    this.words(`${length_m} m, north up`, x + 4, y - 5, c["ink-soft"]);
  }
}

export function RunMap({ tape, t, label }) {
  const box = useRef();
  const canvas = useRef();
  const spots = useRef([]);
  const size = useSize(box);
  const [view, setView] = useState({ zoom: 1, x: 0, y: 0 });
  const [hover, setHover] = useState(null);
  const drag = useRef(null);
  useEffect(() => {
    if (size.width) spots.current = new Drawing(canvas.current, tape, t, view, size).all();
  });
  const zoom = (factor, px = size.width / 2, py = size.height / 2) =>
    setView((old) => {
      const next = Math.min(60, Math.max(0.5, old.zoom * factor));
      const by = next / old.zoom;
      const [cx, cy] = [px - size.width / 2, py - size.height / 2];
      return { zoom: next, x: cx - (cx - old.x) * by, y: cy - (cy - old.y) * by };
    });
  const place = (event) => {
    const rect = canvas.current.getBoundingClientRect();
    return [event.clientX - rect.left, event.clientY - rect.top];
  };
  useEffect(() => {
    const wheel = (event) => {
      event.preventDefault();
      zoom(Math.exp(-event.deltaY * WHEEL), ...place(event));
    };
    const element = canvas.current;
    element.addEventListener("wheel", wheel, { passive: false });
    return () => element.removeEventListener("wheel", wheel);
  });
  const move = (event) => {
    const [x, y] = place(event);
    if (drag.current) {
      const [fromX, fromY] = drag.current;
      drag.current = [x, y];
      setView((old) => ({ ...old, x: old.x + x - fromX, y: old.y + y - fromY }));
      return;
    }
    const near = spots.current.filter((spot) => Math.hypot(spot.x - x, spot.y - y) < PICK_PX);
    near.sort((a, b) => Math.hypot(a.x - x, a.y - y) - Math.hypot(b.x - x, b.y - y));
    setHover(near.length ? { x, y, texts: near.slice(0, 4).map(({ text }) => text) } : null);
  };
  const grab = (event) => {
    drag.current = place(event);
    canvas.current.setPointerCapture(event.pointerId);
  };
  return (
    <div class="map" ref={box}>
      <canvas
        ref={canvas}
        role="img"
        aria-label={`Map of ${label} at ${t.toFixed(1)} s`}
        style={{ width: `${size.width}px`, height: `${size.height}px` }}
        onPointerDown={grab}
        onPointerMove={move}
        onPointerUp={() => (drag.current = null)}
        onPointerLeave={() => setHover(null)}
        onDblClick={() => setView({ zoom: 1, x: 0, y: 0 })}
      />
      <div class="zoom">
        <button type="button" aria-label="Zoom in" onClick={() => zoom(1.5)}>+</button>
        <button type="button" aria-label="Zoom out" onClick={() => zoom(1 / 1.5)}>−</button>
        <button type="button" aria-label="Fit" onClick={() => setView({ zoom: 1, x: 0, y: 0 })}>⤢</button>
      </div>
      {hover && (
        <div class="hover" style={{ left: `${Math.min(hover.x + 12, size.width - 190)}px`, top: `${hover.y + 12}px` }}>
          {hover.texts.map((text) => <div>{text}</div>)}
        </div>
      )}
    </div>
  );
}

// The same signs as on the map.
export function Legend() {
  const sign = (className, text) => <span class="sign"><i class={className} />{text}</span>;
  return (
    <div class="legend">
      {sign("s-adversary", "adversary")}
      {sign("s-bystander", "bystander")}
      {sign("s-sought", "sought")}
      {sign("s-clutter", "clutter")}
      {sign("s-view", "in view")}
      {sign("s-track", "agent's track")}
      {sign("s-report", "report")}
      {sign("s-mark", "mark")}
      {sign("s-ring", "no mark within")}
      {sign("s-closed", "closed area")}
      {sign("s-intelligence", "intelligence")}
    </div>
  );
}
