// A campaign while it flies, and the page to sign.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { recordingAddress } from "./api.js";
import { useSize, useTheme } from "./hooks.js";
import { Lanes } from "./lanes.jsx";
import { Legend, RunMap, colours } from "./map.jsx";
import { Tape, readOn, rowAt } from "./tape.js";
import { oneLine } from "./visible.js";

const RATE_SPAN_MS = 5 * 60_000;
const TAIL_MS = 1000;
const NEWS = 200;

// The state of the campaign as the server sends it, what has changed since this page looks, and results a minute.
export function useLive() {
  const [live, setLive] = useState(null);
  const [news, setNews] = useState([]);
  const seen = useRef([]);
  const last = useRef("");
  const [lost, setLost] = useState(false);
  useEffect(() => {
    const source = new EventSource("/api/live");
    source.onopen = () => setLost(false);
    source.onerror = () => setLost(true);
    source.onmessage = ({ data }) => {
      const state = JSON.parse(data);
      const names = [...state.cells].map((sign) => state.legend[sign.charCodeAt(0) - 48]);
      const now_ms = Date.now();
      seen.current = [...seen.current.filter(([ms]) => now_ms - ms < RATE_SPAN_MS), [now_ms, state.done]];
      if (last.current) {
        const ended = names.flatMap((name, index) => (name !== last.current[index] && name !== "running" && name !== "planned" ? [{ index, outcome: name, ms: now_ms }] : []));
        if (ended.length) setNews((old) => [...ended.reverse(), ...old].slice(0, NEWS));
      }
      last.current = names;
      setLive({ ...state, names });
    };
    return () => source.close();
  }, []);
  const [[first_ms, first] = [0, 0], [last_ms, done] = [0, 0]] = [seen.current[0], seen.current.at(-1)];
  return { live, news, lost, rate: last_ms > first_ms ? ((done - first) / (last_ms - first_ms)) * 60_000 : null };
}

const span = (s) => (s === null ? "–" : s < 120 ? `${s.toFixed(0)} s` : s < 7200 ? `${(s / 60).toFixed(0)} min` : `${(s / 3600).toFixed(1)} h`);
const tone = (name) => (name === "completed" ? "good" : name === "planned" ? "planned" : name === "running" ? "running" : name === "settled" ? "settled" : "bad");

function Grid({ live, plan }) {
  useTheme();
  const box = useRef();
  const canvas = useRef();
  const { width } = useSize(box);
  const cell = live.names.length > 2000 ? 6 : live.names.length > 300 ? 10 : 16;
  const across = Math.max(1, Math.floor(width / cell));
  const height = Math.ceil(live.names.length / across) * cell;
  useEffect(() => {
    if (!width) return;
    const [g, c, ratio] = [canvas.current.getContext("2d"), colours(), devicePixelRatio || 1];
    const good = getComputedStyle(canvas.current).getPropertyValue("--matrix-good");
    Object.assign(canvas.current, { width: width * ratio, height: height * ratio });
    g.scale(ratio, ratio);
    const paint = { good, bad: c.forbidden, running: c.accent, planned: c.line, settled: c["ink-soft"] };
    live.names.forEach((name, index) => {
      g.fillStyle = paint[tone(name)];
      g.fillRect((index % across) * cell, Math.floor(index / across) * cell, cell - 1.5, cell - 1.5);
    });
  });
  const at = (event) => {
    const rect = canvas.current.getBoundingClientRect();
    return plan[Math.floor((event.clientY - rect.top) / cell) * across + Math.floor((event.clientX - rect.left) / cell)];
  };
  return (
    <div ref={box} class="grid">
      <canvas ref={canvas} role="img" aria-label="Realizations in the order of the plan" style={{ width: `${width}px`, height: `${height}px` }} onClick={(event) => at(event) && (location.hash = `/run/${encodeURIComponent(at(event)[0])}`)} onPointerMove={(event) => (canvas.current.title = at(event)?.[0] ?? "")} />
    </div>
  );
}

// The recording of a session in flight, as far as it is written; a new one when the session starts again.
function Tail({ id, titles }) {
  const [tape, setTape] = useState(null);
  const [, setMessages] = useState(0);
  useEffect(() => {
    let wanted = true;
    let [own, from] = [new Tape(), 0];
    setTape(own);
    const look = async () => {
      while (wanted) {
        try {
          from = await readOn(own, recordingAddress(id), from, () => (setMessages(own.messages), wanted));
        } catch {
          // Not begun yet, or begun anew.
          if (from) [own, from] = [new Tape(), 0];
        }
        if (own.fault) [own, from] = [new Tape(), 0];
        setTape(own);
        setMessages(own.messages);
        await new Promise((done) => setTimeout(done, TAIL_MS));
      }
    };
    look();
    return () => (wanted = false);
  }, [id]);
  if (!tape?.simspec) return <p class="wait">waiting for the recording of {id}</p>;
  const phase = rowAt(tape.status, tape.end_s)?.phase ?? "";
  return (
    <section class="tail">
      <h2><a href={`#/run/${encodeURIComponent(id)}`}>{id}</a> <span class="soft">written up to {tape.end_s.toFixed(1)} s, {phase.replaceAll("_", " ")}</span></h2>
      <RunMap tape={tape} t={tape.end_s} label={id} />
      <Legend />
      <Lanes tape={tape} run={null} titles={titles} t={tape.end_s} onSeek={() => {}} />
    </section>
  );
}

export function LivePanel({ summary, titles }) {
  const { live, news, lost, rate } = useLive();
  const [chosen, setChosen] = useState(null);
  if (!live) return <p class="wait">{lost ? "the server does not answer" : "asking the campaign"}</p>;
  const flying = live.running.includes(chosen) ? chosen : live.running[0];
  const outcomes = Object.entries(live.outcomes);
  return (
    <div class="page live">
      <h1>{live.campaign} <span class="soft">{live.process ? (live.paused ? "paused" : "flying") : live.complete ? "complete" : "not flying"}</span></h1>
      {lost && <p class="note">The server does not answer; this is what it last said.</p>}
      <dl class="figures">
        <div><dt>results</dt><dd data-live="done">{live.done} of {live.total}</dd></div>
        <div><dt>in the air</dt><dd>{live.running.length}</dd></div>
        <div><dt>sessions a minute</dt><dd>{live.process && rate !== null ? rate.toFixed(1) : "–"}</dd></div>
        <div><dt>time left, about</dt><dd>{span(live.left_s)}</dd></div>
        <div><dt>flown more than once</dt><dd>{live.retried}</dd></div>
      </dl>
      <div class="bar" role="img" aria-label={outcomes.map(([name, count]) => `${count} ${name}`).join(", ")}>
        {outcomes.map(([name, count]) => <i class={`o-${tone(name)}`} style={{ width: `${(100 * count) / live.total}%` }} title={`${count} ${name}`} />)}
      </div>
      <p class="outcomes">{outcomes.length ? outcomes.map(([name, count]) => <span class="sign"><i class={`o-${tone(name)}`} />{count} {name}</span>) : "no result yet"}</p>
      <div class="columns-2">
        <div>
          <Grid live={live} plan={summary.plan} />
          <h2>as they came</h2>
          {news.length ? (
            <ol class="news">
              {news.map(({ index, outcome, ms }) => (
                <li><time>{new Date(ms).toLocaleTimeString([], { hour12: false })}</time> <b class={tone(outcome) === "bad" ? "bad" : ""}>{outcome}</b> <a href={`#/run/${encodeURIComponent(summary.plan[index]?.[0] ?? "")}`}>{summary.plan[index]?.[0]}</a></li>
              ))}
            </ol>
          ) : <p class="soft">nothing since this page was opened</p>}
        </div>
        <div>
          {live.running.length > 1 && (
            <p class="chips">{live.running.map((id) => <button type="button" class="chip" aria-pressed={id === flying} onClick={() => setChosen(id)}>{id}</button>)}</p>
          )}
          {flying ? <Tail key={flying} id={flying} titles={titles} /> : <p class="soft">No session is in the air.</p>}
        </div>
      </div>
    </div>
  );
}

export function SignPanel({ summary }) {
  const { sheets, signature, manifest_sha256 } = summary;
  if (!sheets.length) return <p class="wait">nothing was flown</p>;
  return (
    <div class="page sheets">
      {sheets.map((sheet) => (
        <article class="sheet">
          <h1>{oneLine(sheet.agent)} <span class="soft">{oneLine(sheet.version)}</span></h1>
          {sheet.warnings.map((text) => <p class="note">{oneLine(text)}</p>)}
          <p>{oneLine(sheet.flown)}</p>
          <div class="scroll">
            <table>
              <thead><tr><th>principle</th><th>runs passed</th><th>95 % interval</th><th>nine tenths pass up to difficulty</th><th>floor</th></tr></thead>
              <tbody>{sheet.rows.map((row) => <tr data-principle={row.node}><th scope="row">{row.title}</th><td>{row.passed}</td><td>{row.interval}</td><td>{row.competence}</td><td>{row.floor}</td></tr>)}</tbody>
            </table>
          </div>
          <h2>Never shown</h2>
          <ul>{sheet.not_shown.map((text) => <li>{oneLine(text)}</li>)}</ul>
          <dl class="facts">
            <dt>confined by</dt><dd>{oneLine(sheet.confinement)}</dd>
            <dt>digest of the evidence</dt><dd><code>{sheet.digest || "not on record"}</code></dd>
            <dt>SHA-256 of manifest.json</dt><dd><code>{manifest_sha256 ?? "none: the campaign is not complete"}</code></dd>
            <dt>signature</dt><dd>{signature.key ? <><code>{signature.key}</code>: {oneLine(signature.state)}</> : oneLine(signature.state)}</dd>
            <dt>check</dt><dd><code>rebar verify DIR</code> compares every file with these digests; this page did not.</dd>
          </dl>
          <p class="signer"><span>name</span><span>date</span><span>signature</span></p>
        </article>
      ))}
      <p class="no-print"><button type="button" onClick={() => print()}>print</button></p>
    </div>
  );
}
