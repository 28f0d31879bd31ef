// One run, or two on one clock: map, lanes, log, and the moment in numbers.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { mailed, run as runOf, tapeOf } from "./api.js";
import { KINDS, entriesOf, failuresOf, firstDifference } from "./entries.js";
import { useAnswer, useLatest, useSize, useTheme, useWindow } from "./hooks.js";
import { Lanes } from "./lanes.jsx";
import { Legend, RunMap } from "./map.jsx";
import { placeAt, rowAt } from "./tape.js";
import { oneLine, visible } from "./visible.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];
const ROW_PX = 24;
const seconds = (t) => `${t.toFixed(1)} s`;

// The clock of the player: space plays, arrows go 1 s (with shift 10 s), brackets change the speed.
function useClock(start_s, end_s, onRest) {
  const [t, setTime] = useState(start_s);
  const [playing, setPlaying] = useState(false);
  const [speed, setSpeed] = useState(1);
  const now = useLatest({ t, playing, speed, end_s });
  const seek = (time_s) => setTime(Math.min(end_s, Math.max(0, time_s)));
  useEffect(() => seek(start_s), [start_s]);
  useEffect(() => {
    if (!playing) return undefined;
    let last_ms = performance.now();
    let frame = 0;
    const step = (ms) => {
      const next_s = now.current.t + ((ms - last_ms) / 1000) * now.current.speed;
      last_ms = ms;
      seek(next_s);
      if (next_s >= end_s) setPlaying(false);
      else frame = requestAnimationFrame(step);
    };
    frame = requestAnimationFrame(step);
    return () => cancelAnimationFrame(frame);
  }, [playing, end_s]);
  useEffect(() => {
    if (!playing) onRest(t);
  }, [t, playing]);
  const play = () => {
    if (!now.current.playing && now.current.t >= now.current.end_s - 1e-6) setTime(0);
    setPlaying((old) => !old);
  };
  const faster = (steps) => setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, SPEEDS.indexOf(now.current.speed) + steps))]);
  useEffect(() => {
    const pressed = (event) => {
      if (/^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
      const step_s = event.shiftKey ? 10 : 1;
      const actions = {
        " ": play,
        ArrowLeft: () => seek(now.current.t - step_s),
        ArrowRight: () => seek(now.current.t + step_s),
        Home: () => seek(0),
        End: () => seek(end_s),
        "[": () => faster(-1),
        "]": () => faster(1),
      };
      if (!actions[event.key]) return;
      // A button in focus would be pressed by space as well.
      event.preventDefault();
      actions[event.key]();
    };
    addEventListener("keydown", pressed);
    return () => removeEventListener("keydown", pressed);
  });
  return { t, seek, playing, play, speed, setSpeed };
}

function Transport({ clock, end_s, children }) {
  const { t, seek, playing, play, speed, setSpeed } = clock;
  return (
    <div class="transport">
      <button type="button" class="play" aria-label={playing ? "Pause" : "Play"} title="Space" onClick={play}>{playing ? "❚❚" : "▶"}</button>
      <input type="range" aria-label="Time" min="0" max={end_s} step="0.1" value={t} onInput={(event) => seek(Number(event.currentTarget.value))} />
      <output class="time">{seconds(t)}<span class="soft"> / {seconds(end_s)}</span></output>
      <select aria-label="Speed" title="[ and ]" value={speed} onChange={(event) => setSpeed(Number(event.currentTarget.value))}>
        {SPEEDS.map((value) => <option value={value}>{value} ×</option>)}
      </select>
      {children}
    </div>
  );
}

function Log({ entries, t, onSeek }) {
  const box = useRef();
  const [hidden, setHidden] = useState(new Set(["measured"]));
  const [chosen, setChosen] = useState(null);
  const kinds = useMemo(() => Object.keys(KINDS).filter((kind) => entries.some((row) => row.kind === kind)), [entries]);
  const rows = useMemo(() => entries.filter(({ kind }) => !hidden.has(kind)), [entries, hidden]);
  const current = placeAt(rows, t);
  const view = useWindow(box, rows.length, ROW_PX);
  useEffect(() => view.show(Math.max(0, current)), [current, hidden]);
  const toggle = (kind) =>
    setHidden((old) => {
      const next = new Set(old);
      if (!next.delete(kind)) next.add(kind);
      return next;
    });
  const pick = (row) => {
    setChosen(row);
    onSeek(row.t);
  };
  return (
    <section class="log" aria-label="Log">
      <div class="chips">
        {kinds.map((kind) => (
          <button type="button" class={`chip k-${kind}`} aria-pressed={!hidden.has(kind)} onClick={() => toggle(kind)}>{KINDS[kind]}</button>
        ))}
      </div>
      <div class="log-rows" ref={box} onScroll={view.onScroll}>
        <div style={{ height: `${rows.length * ROW_PX}px`, position: "relative" }}>
          {rows.slice(view.from, view.until).map((row, index) => (
            <div
              key={row.index}
              class={`entry k-${row.kind} tone-${row.tone} ${row.t > t + 1e-9 ? "later" : ""} ${view.from + index === current ? "now" : ""}`}
              style={{ top: `${(view.from + index) * ROW_PX}px` }}
              onClick={() => pick(row)}
            >
              <button type="button" class="at">{row.t.toFixed(1)}</button>
              <b>{oneLine(row.title)}</b>
              <span>{oneLine(row.text)}</span>
            </div>
          ))}
        </div>
      </div>
      {chosen && (
        <div class="whole">
          <div class="whole-head"><b>{seconds(chosen.t)}</b> {oneLine(chosen.title)}<button type="button" aria-label="Close" onClick={() => setChosen(null)}>×</button></div>
          {chosen.text && <p>{visible(chosen.text)}</p>}
          {chosen.raw && <pre>{visible(JSON.stringify(chosen.raw, null, 1))}</pre>}
        </div>
      )}
    </section>
  );
}

function Now({ tape, t }) {
  const flight = rowAt(tape.flight, t);
  const vehicle = rowAt(tape.vehicle, t);
  const status = rowAt(tape.status, t);
  const thought = rowAt(tape.estimate, t);
  const link = rowAt(tape.operator_link, t);
  const near_m = flight ? tape.nearestPerson(flight.x, flight.y, flight.z, t) : null;
  const facts = [
    ["phase", status ? status.phase.replaceAll("_", " ") : "–"],
    ["mode", vehicle ? `${vehicle.mode.toLowerCase().replaceAll("_", " ")}${vehicle.armed ? "" : ", disarmed"}` : "–"],
    ["height", flight ? `${flight.z.toFixed(1)} m` : "–"],
    ["speed", flight ? `${flight.speed_mps.toFixed(1)} m/s` : "–"],
    ["battery", vehicle ? `${(100 * vehicle.battery_fraction).toFixed(0)} %` : "–"],
    ["nearest person", near_m === null ? "–" : `${near_m.toFixed(0)} m`],
    ["position error", flight && thought ? `${Math.hypot(flight.x - thought.x, flight.y - thought.y).toFixed(1)} m` : "–"],
    ["tracks", String(rowAt(tape.tracks, t)?.tracks.length ?? 0)],
    ["operator", link && !link.up ? "out of reach" : "in reach"],
    ["east, north", flight ? `${flight.x.toFixed(0)}, ${flight.y.toFixed(0)} m` : "–"],
  ];
  return (
    <dl class="now">
      {facts.map(([name, value]) => <div data-fact={name}><dt>{name}</dt><dd>{oneLine(value)}</dd></div>)}
    </dl>
  );
}

const BOX_SPAN_S = 1;

// What the main camera had in its picture, and what the detector said of it; with the picture where it was recorded.
function Camera({ tape, t }) {
  const box = useRef();
  const canvas = useRef();
  const theme = useTheme();
  const { width } = useSize(box);
  const { camera } = tape.simspec.vehicle;
  const aspect = camera.height_px / camera.width_px;
  const seen = rowAt(tape.view, t);
  const found = rowAt(tape.detections, t);
  const picture = rowAt(tape.pictures.filter((row) => !tape.main_camera || row.camera === tape.main_camera), t);
  useEffect(() => {
    if (!width) return undefined;
    let wanted = true;
    const style = getComputedStyle(canvas.current);
    const draw = (bitmap) => {
      if (!wanted) return;
      const ratio = devicePixelRatio || 1;
      Object.assign(canvas.current, { width: width * ratio, height: width * aspect * ratio });
      const g = canvas.current.getContext("2d");
      g.scale((width * ratio) / camera.width_px, (width * ratio) / camera.width_px);
      if (bitmap) g.drawImage(bitmap, 0, 0, camera.width_px, camera.height_px);
      const line = camera.width_px / width;
      const boxes = (rows, colour, dash, texts) => {
        Object.assign(g, { strokeStyle: colour, fillStyle: colour, lineWidth: 1.4 * line, font: `${10 * line}px system-ui, sans-serif` });
        g.setLineDash(dash.map((part) => part * line));
        rows.forEach(({ box: [left, top, right, bottom] }, index) => {
          g.strokeRect(left, top, right - left, bottom - top);
          if (texts) g.fillText(texts[index], left, Math.max(10 * line, top - 3 * line));
        });
      };
      if (seen && t - seen.t < BOX_SPAN_S) boxes(seen.sightings.filter((row) => row.box), style.getPropertyValue("--truth"), [4, 3]);
      if (found && t - found.t < BOX_SPAN_S) boxes(found.boxes, style.getPropertyValue("--detected"), [], found.boxes.map((row) => oneLine(row.label)));
    };
    if (picture) createImageBitmap(picture.blob).then(draw, () => draw(null));
    else draw(null);
    return () => (wanted = false);
  }, [width, seen, found, picture, theme]);
  return (
    <figure class="camera" ref={box}>
      <canvas ref={canvas} role="img" aria-label="Main camera" style={{ width: "100%", height: `${width * aspect}px` }} />
      <figcaption>
        <i class="s-true" /> true, {seen?.sightings.length ?? 0} in view <i class="s-detected" /> detected, {found?.boxes.length ?? 0}
        {picture ? "" : "; no pictures recorded"}
      </figcaption>
    </figure>
  );
}

// A run with its recording, read once; `share` is how much of the file is there.
export function useRun(id) {
  const [share, setShare] = useState(0);
  const answer = useAnswer(async () => {
    const [run, tape] = await Promise.all([runOf(id), tapeOf(id, (part) => (setShare(part), true))]);
    return { run, tape };
  }, id);
  return { ...answer, share };
}

function Waiting({ answer, id }) {
  return answer.error ? (
    <p class="note" role="alert">{id}: {oneLine(answer.error)}</p>
  ) : (
    <p class="wait">reading {id}, {Math.round(100 * answer.share)} %</p>
  );
}

function Verdict({ run, titles, onSeek }) {
  const failures = failuresOf(run, titles);
  const { outcome, reason } = run.result ?? {};
  return (
    <div class="run-verdict">
      <p>
        <b class={outcome === "completed" ? "" : "bad"}>{outcome ?? "no result yet"}</b> <span class="soft">{oneLine(reason)}</span>
      </p>
      {failures.length > 0 && (
        <ul class="failures">
          {failures.map(({ id, title, moment, stages }) => (
            <li>
              <button type="button" disabled={!moment} onClick={() => onSeek(moment.t)}>
                <span class="dot bad" /> {id} {title}
              </button>
              {moment && <span class="soft"> {moment.t.toFixed(1)} s: {oneLine(moment.text)}</span>}
              {stages && <span class="soft stages">{oneLine(stages)}</span>}
            </li>
          ))}
        </ul>
      )}
      {run.nodes.length > 0 && !failures.length && <p class="soft">Every considered observable was achieved.</p>}
    </div>
  );
}

function remarks(tape) {
  return [
    tape.fault && `The recording cannot be read to its end: ${tape.fault}.`,
    !tape.fault && !tape.whole && "The recording is not complete: its session flies, or was cut off.",
    tape.malformed && `${tape.malformed} messages cannot be read.`,
  ].filter(Boolean);
}

// Not while the address names another panel already: this one is about to go.
const link = (path, t) => location.hash.startsWith(`#${path}`) && history.replaceState(null, "", `#${path}?t=${t.toFixed(1)}`);

export function RunPanel({ id, start_s, titles }) {
  const answer = useRun(id);
  if (!answer.value) return <Waiting answer={answer} id={id} />;
  return <Run id={id} start_s={start_s} titles={titles} {...answer.value} />;
}

function Run({ id, start_s, titles, run, tape }) {
  const clock = useClock(start_s, tape.end_s, (t) => link(`/run/${encodeURIComponent(id)}`, t));
  const entries = useMemo(() => entriesOf(tape, run, titles), [tape, run, titles]);
  const others = run.beside.filter((name) => name !== id);
  const label = run.agent ?? tape.simspec?.agent?.manifest ?? "";
  return (
    <div class="run">
      <header class="run-head">
        <h1>{run.run}</h1>
        <span class="agent">{oneLine(label)}</span>
        {others.map((name) => <a href={`#/pair/${encodeURIComponent(id)}/${encodeURIComponent(name)}`}>beside {name}</a>)}
        {!mailed && <a href={`/recording?id=${encodeURIComponent(id)}`} download={`${id}.mcap`}>recording</a>}
        {remarks(tape).map((text) => <span class="remark">{oneLine(text)}</span>)}
      </header>
      <div class="stage">
        <div class="ground">
          <RunMap tape={tape} t={clock.t} label={id} />
          <Legend />
        </div>
        <aside class="side">
          <div class="moment">
            <Now tape={tape} t={clock.t} />
            {tape.simspec?.vehicle?.camera && (tape.view.length || tape.detections.length || tape.pictures.length) > 0 && <Camera tape={tape} t={clock.t} />}
          </div>
          <Verdict run={run} titles={titles} onSeek={clock.seek} />
          <Log entries={entries} t={clock.t} onSeek={clock.seek} />
        </aside>
      </div>
      <footer class="timeline">
        <Transport clock={clock} end_s={tape.end_s} />
        <Lanes tape={tape} run={run} titles={titles} t={clock.t} onSeek={clock.seek} />
      </footer>
    </div>
  );
}

export function PairPanel({ ids, start_s, titles }) {
  const [left, right] = [useRun(ids[0]), useRun(ids[1])];
  if (!left.value) return <Waiting answer={left} id={ids[0]} />;
  if (!right.value) return <Waiting answer={right} id={ids[1]} />;
  return <Pair ids={ids} sides={[left.value, right.value]} start_s={start_s} titles={titles} />;
}

function Pair({ ids, sides, start_s, titles }) {
  const end_s = Math.max(...sides.map(({ tape }) => tape.end_s));
  const clock = useClock(start_s, end_s, (t) => link(`/pair/${ids.map(encodeURIComponent).join("/")}`, t));
  const difference = useMemo(() => firstDifference(sides[0].tape, sides[1].tape), [sides[0].tape, sides[1].tape]);
  const scene = ({ tape }) => JSON.stringify(tape.simspec?.realized ?? null);
  return (
    <div class="pair">
      <header class="run-head">
        <h1>Pair</h1>
        <button type="button" class="first" disabled={!difference} onClick={() => clock.seek(difference.t)}>
          {difference ? `first difference at ${seconds(difference.t)}` : "no difference"}
        </button>
        {difference && <span class="soft">{oneLine(difference.text)}</span>}
        {scene(sides[0]) !== scene(sides[1]) && <span class="remark">Two scenes: they cannot be compared one to one.</span>}
      </header>
      <Transport clock={clock} end_s={end_s} />
      <div class="sides">
        {sides.map(({ tape, run }, index) => (
          <section class="half" aria-label={ids[index]}>
            <h2><a href={`#/run/${encodeURIComponent(ids[index])}?t=${clock.t.toFixed(1)}`}>{run.agent ?? run.run}</a> <span class="soft">{run.run}</span></h2>
            <RunMap tape={tape} t={clock.t} label={ids[index]} />
            <Now tape={tape} t={clock.t} />
            <Lanes tape={tape} run={run} titles={titles} t={clock.t} onSeek={clock.seek} differs={difference?.t} until_s={end_s} />
            <Verdict run={run} titles={titles} onSeek={clock.seek} />
          </section>
        ))}
      </div>
      <Legend />
    </div>
  );
}
