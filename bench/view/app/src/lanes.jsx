// What happened over time, one lane below the other on one clock. A click or a drag goes to that moment.
import { memo } from "./memo.js";
import { useMemo, useRef } from "preact/hooks";
import { useSize } from "./hooks.js";
import { momentsOf, outagesOf, phasesOf } from "./entries.js";
import { oneLine } from "./visible.js";

const LABEL_PX = 96;
const LANE_PX = 17;
const PLOT_PX = 34;
const AXIS_PX = 16;

function ticksOf(end_s, width) {
  const step = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600].find((s) => (s / end_s) * width > 46) ?? 7200;
  return Array.from({ length: Math.floor(end_s / step) + 1 }, (_, index) => index * step);
}

// Points are thinned to the lowest and highest of each pixel.
function lineOf(rows, x, y) {
  const columns = new Map();
  for (const [t, value] of rows) {
    if (value === null) continue;
    const column = Math.round(x(t));
    const known = columns.get(column);
    columns.set(column, known ? [Math.min(known[0], value), Math.max(known[1], value)] : [value, value]);
  }
  return [...columns].map(([column, [low, high]]) => `${column},${y(low).toFixed(1)} ${low === high ? "" : `${column},${y(high).toFixed(1)}`}`).join(" ");
}

function plotsOf(tape) {
  const { rules = {}, mission = {} } = tape.simspec ?? {};
  const thin = tape.flight.filter((_, index) => index % 2 === 0);
  const far = thin.map((row) => [row.t, tape.nearestPerson(row.x, row.y, row.z, row.t)]);
  return [
    { name: "height", unit: "m", rows: thin.map((row) => [row.t, row.z]), limit: rules.max_altitude_m, wanted: mission.altitude_m },
    { name: "speed", unit: "m/s", rows: thin.map((row) => [row.t, row.speed_mps]), limit: rules.max_speed_mps, wanted: mission.speed_mps },
    { name: "nearest person", unit: "m", rows: far, limit: rules.bystander_standoff_m || null },
  ].filter(({ rows }) => rows.some(([, value]) => value !== null));
}

const Static = memo(function Static({ tape, run, titles, width, plots, end_s, onPick }) {
  const x = (t) => (t / end_s) * width;
  const lanes = [];
  const lane = (name, content) => lanes.push({ name, content, height: LANE_PX });
  const tick = (row, className, text) => (
    <rect class={className} x={x(row.t) - 1} y="3" width="2.4" height={LANE_PX - 6}><title>{`${row.t.toFixed(1)} s: ${oneLine(text)}`}</title></rect>
  );
  const span = ({ from, until }, className, text) => (
    <g>
      <rect class={className} x={x(from)} y="2" width={Math.max(1.5, x(until) - x(from))} height={LANE_PX - 4}><title>{`${from.toFixed(1)} to ${until.toFixed(1)} s: ${oneLine(text)}`}</title></rect>
      {x(until) - x(from) > 7 * text.length && <text x={x(from) + 4} y={LANE_PX - 5}>{oneLine(text)}</text>}
    </g>
  );
  lane("phase", phasesOf(tape).map((row) => span(row, `phase p-${row.phase}`, row.phase.replaceAll("_", " "))));
  if (tape.orders.length + tape.answers.length) {
    lane("orders", [
      ...tape.orders.map((row) => tick(row, "t-warn", `order ${row.kind}`)),
      ...tape.answers.map((row) => tick(row, row.accepted ? "t-good" : "t-bad", `${row.accepted ? "accepts" : "refuses"} ${row.order} ${row.reason}`)),
    ]);
  }
  if (tape.consent_requests.length) {
    lane("consents", [
      ...tape.consent_requests.map((row) => tick(row, "t-warn", `asks to mark ${row.class_label}`)),
      ...tape.consents.map((row) => tick(row, row.granted ? "t-good" : "t-bad", row.granted ? "granted" : "refused")),
    ]);
  }
  const outages = outagesOf(tape);
  if (outages.length) lane("outages", outages.map((row) => span(row, "outage", row.text)));
  if (tape.detections.length) {
    const counts = new Map();
    for (const { t, boxes } of tape.detections) {
      const column = Math.round(x(t) / 2) * 2;
      counts.set(column, Math.max(counts.get(column) ?? 0, boxes.length));
    }
    const most = Math.max(1, ...counts.values());
    lane("detections", [...counts].filter(([, count]) => count).map(([column, count]) => {
      const height = Math.max(1.5, (count / most) * (LANE_PX - 3));
      return <rect class="density" x={column} y={LANE_PX - 1 - height} width="2" height={height} />;
    }));
  }
  lane("reports", tape.reports.map((row) => tick(row, row.mark ? "t-bad" : "t-good", `${row.mark ? "mark" : "report"} ${row.class_label} ${row.reason}`)));
  lane("decisions", tape.decisions.map((row) => tick(row, "t-plain", `${row.action} ${row.subject} ${row.reason}`)));
  const moments = momentsOf(run, titles);
  if (moments.length) {
    lane("measured", [...moments].sort((a, b) => (a.passed === false) - (b.passed === false)).map((row) => tick(row, row.passed === false && row.considered ? "t-bad" : "t-good", `${row.id} ${row.title}: ${row.text}`)));
  }
  for (const { name, unit, rows, limit, wanted } of plots) {
    const most = Math.max(1, ...rows.map(([, value]) => value ?? 0), limit ?? 0);
    const y = (value) => PLOT_PX - 2 - (Math.max(0, value) / most) * (PLOT_PX - 6);
    lanes.push({
      name,
      unit,
      height: PLOT_PX,
      scale: most,
      content: (
        <g>
          {wanted != null && <line class="wanted" x1="0" x2={width} y1={y(wanted)} y2={y(wanted)} />}
          {limit != null && <line class="limit" x1="0" x2={width} y1={y(limit)} y2={y(limit)}><title>{`limit ${limit} ${unit}`}</title></line>}
          <polyline class="curve" points={lineOf(rows, x, y)} />
        </g>
      ),
    });
  }
  let top = 0;
  const placed = lanes.map((row) => ({ ...row, top: (top += row.height) - row.height }));
  return (
    <svg class="lanes" width={width + LABEL_PX} height={top + AXIS_PX} role="img" aria-label="Lanes over time" onPointerDown={onPick}>
      {placed.map(({ name, height, top: at, content, scale, unit }) => (
        <g transform={`translate(0 ${at})`}>
          <line class="rule" x1="0" x2={width + LABEL_PX} y1={height} y2={height} />
          <text class="lane" x={LABEL_PX - 8} y={height > LANE_PX ? 13 : LANE_PX - 5} text-anchor="end">{name}</text>
          {scale && <text class="scale" x={LABEL_PX - 8} y="27" text-anchor="end">{`0 to ${scale.toFixed(scale < 20 ? 1 : 0)} ${unit}`}</text>}
          <g transform={`translate(${LABEL_PX} 0)`} data-lane={name}>{content}</g>
        </g>
      ))}
      <g transform={`translate(${LABEL_PX} ${top})`}>
        {ticksOf(end_s, width).map((t) => (
          <g>
            <line class="tick" x1={x(t)} x2={x(t)} y1={-top} y2="3" />
            <text class="axis" x={x(t)} y="13" text-anchor={t ? "middle" : "start"}>{t}</text>
          </g>
        ))}
      </g>
    </svg>
  );
});

export function Lanes({ tape, run, titles, t, onSeek, differs, until_s }) {
  const box = useRef();
  const { width } = useSize(box);
  const inner = Math.max(10, width - LABEL_PX - 8);
  const end_s = Math.max(1, until_s ?? tape.end_s);
  const plots = useMemo(() => plotsOf(tape), [tape, tape.messages]);
  const seek = useRef();
  seek.current = onSeek;
  const pick = useMemo(
    () => (event) => {
      const svg = event.currentTarget;
      const to = (move) => seek.current(Math.min(end_s, Math.max(0, ((move.clientX - svg.getBoundingClientRect().left - LABEL_PX) / inner) * end_s)));
      const stop = () => {
        svg.removeEventListener("pointermove", to);
        svg.removeEventListener("pointerup", stop);
      };
      svg.setPointerCapture(event.pointerId);
      svg.addEventListener("pointermove", to);
      svg.addEventListener("pointerup", stop);
      to(event);
    },
    [inner, end_s],
  );
  const left = (at) => `${LABEL_PX + (at / end_s) * inner}px`;
  return (
    <div class="lanes-box" ref={box}>
      {width > 0 && <Static tape={tape} messages={tape.messages} run={run} titles={titles} width={inner} plots={plots} end_s={end_s} onPick={pick} />}
      {differs != null && <div class="differs" style={{ left: left(differs) }} />}
      <div class="playhead" style={{ left: left(Math.min(t, end_s)) }} />
    </div>
  );
}
