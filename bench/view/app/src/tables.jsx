// The campaign in tables: verdicts down the decomposition, runs, and the matrix of runs and observables.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import * as api from "./api.js";
import { useAnswer, useSize, useTheme, useWindow } from "./hooks.js";
import { colours } from "./map.jsx";
import { momentsOf } from "./entries.js";
import { oneLine } from "./visible.js";

const go = (hash) => (location.hash = hash);
// A node as the language of conditions names it.
const word = (node) => (/^\w[\w-]*$/.test(node) ? node : `\`${node}\``);
export const runsLink = (condition) => `#/runs?where=${encodeURIComponent(condition)}`;
const quoted = (text) => (text.includes('"') ? `'${text}'` : `"${text}"`);
const fixed = (value, digits = 1) => (value === null || value === undefined ? "–" : value.toFixed(digits));

function Interval({ row, floor }) {
  const [width, height] = [96, 12];
  const x = (share) => (share * width).toFixed(1);
  return (
    <svg class="interval" width={width} height={height} viewBox={`0 0 ${width} ${height}`} preserveAspectRatio="none" role="img" aria-label={`95 % interval ${fixed(row["passed.low"], 2)} to ${fixed(row["passed.high"], 2)}`}>
      <rect class="whole" width={width} height="4" y="4" />
      <rect class="band" x={x(row["passed.low"])} width={x(row["passed.high"] - row["passed.low"])} y="2" height="8" />
      {floor !== undefined && <line class="floor" x1={x(floor)} x2={x(floor)} y1="0" y2={height} />}
      <line class="share" x1={x(row.passed / row.runs)} x2={x(row.passed / row.runs)} y1="0" y2={height} />
    </svg>
  );
}

function Cell({ row, agent, node, floor }) {
  if (!row || !row.runs) return <td class="verdict none">not considered</td>;
  const failed = row.passed < row.runs;
  const condition = `agent == ${quoted(agent)} and ${word(node.id)}.passed == ${failed ? "false" : "true"}`;
  const name = `${node.title}, ${agent}: ${row.passed} of ${row.runs} passed`;
  return (
    <td class={`verdict ${failed ? (row.passed ? "some" : "bad") : "good"}`} data-node={node.id} data-agent={agent}>
      <a href={runsLink(condition)} aria-label={name} title={`95 % interval ${fixed(100 * row["passed.low"])} to ${fixed(100 * row["passed.high"])} %${floor === undefined ? "" : `; an agent without merit passes ${fixed(100 * floor)} %`}. Opens the runs that ${failed ? "failed" : "passed"}.`}>
        <span class="count"><b>{row.passed}</b> of {row.runs}</span>
        <Interval row={row} floor={floor} />
      </a>
      <span class="score" title="Mean score; difficulty up to which nine tenths pass, with its bound">
        score {fixed(row.score)}{row.competence_90 === null ? "" : ` · nine tenths to ${fixed(row.competence_90, 0)}, bound ${fixed(row["competence_90.low"], 0)}`}
      </span>
    </td>
  );
}

const CHILD = { principle: "key attribute", ka: "VAB", vab: "observable" };
const counted = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;
// With more rows than this, only the principles are open at first.
const OPEN_ROWS = 24;

export function VerdictPanel({ summary }) {
  const nodes = useMemo(() => new Map(summary.nodes.map((node) => [node.id, node])), [summary]);
  const scores = useMemo(() => new Map(summary.scores.map((row) => [`${row.agent} ${row.node}`, row])), [summary]);
  const first = summary.roots.flatMap((id) => nodes.get(id)?.children ?? []);
  const [open, setOpen] = useState(new Set(first.length <= OPEN_ROWS ? summary.roots.map((id) => `/${id}`) : []));
  const toggle = (path) =>
    setOpen((old) => {
      const next = new Set(old);
      if (!next.delete(path)) next.add(path);
      return next;
    });
  const rows = [];
  const walk = (id, depth, above) => {
    const node = nodes.get(id);
    const path = `${above}/${id}`;
    if (!node) return;
    rows.push({ node, depth, path });
    if (open.has(path)) node.children.forEach((child) => walk(child, depth + 1, path));
  };
  summary.roots.forEach((id) => walk(id, 0, ""));
  return (
    <div class="page">
      <h1>{summary.name}</h1>
      <p class="lead">{oneLine(summary.description)}</p>
      {summary.notes.map((text) => <p class="note">{oneLine(text)}</p>)}
      {!summary.scores.length && <p class="note">No scores yet: they are made when the campaign ends. <a href="#/live">Live</a> shows where it stands.</p>}
      <div class="scroll">
        <table class="verdicts">
          <thead><tr><th>asked of the agent</th>{summary.agents.map((agent) => <th>{oneLine(agent)}</th>)}</tr></thead>
          <tbody>
            {rows.map(({ node, depth, path }) => (
              <tr class={`level-${node.level}`}>
                <th scope="row" style={{ paddingLeft: `${8 + 18 * depth}px` }}>
                  {node.children.length ? (
                    <button type="button" class="opener" aria-expanded={open.has(path)} onClick={() => toggle(path)}>
                      <i>{open.has(path) ? "▾" : "▸"}</i> {depth ? <code>{node.id}</code> : null} {node.title}
                      <span class="soft">{open.has(path) ? "" : ` ${counted(node.children.length, CHILD[node.level] ?? "part")}`}</span>
                    </button>
                  ) : (
                    <span class="leaf"><code>{node.id}</code> {node.title}</span>
                  )}
                  {open.has(path) && node.asks && <p class="asks">{node.asks}</p>}
                </th>
                {summary.agents.map((agent) => <Cell row={scores.get(`${agent} ${node.id}`)} agent={agent} node={node} floor={summary.floors[node.id]} />)}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      <p class="soft small">
        Runs passed of runs that considered the node; the band is the exact 95 % interval{Object.keys(summary.floors).length ? ", the dotted line what the best agent without merit passes" : ""}.
        Beside it: the mean score{summary.scores.some((row) => row.competence_90 !== null) ? " and the difficulty up to which nine tenths pass, with its bound" : ""}. A count opens the runs behind it.
      </p>
    </div>
  );
}

// A column of the table of runs, unpacked cell by cell.
function column(packed) {
  const { name, kind } = packed;
  const cell =
    "shared" in packed ? () => packed.shared
    : packed.flags ? (row) => ({ t: true, f: false })[packed.flags[row]] ?? null
    : packed.codes ? (row) => packed.words[packed.codes[row]]
    : (row) => packed.numbers[row];
  return { name, kind, cell, shared: "shared" in packed };
}

export function useTable(reload) {
  const answer = useAnswer(api.runs, reload);
  const table = useMemo(() => {
    if (!answer.value) return null;
    const columns = answer.value.columns.map(column);
    return { rows: answer.value.rows, columns, by: new Map(columns.map((c) => [c.name, c])) };
  }, [answer.value]);
  return { table, error: answer.error };
}

const shown = (value) =>
  value === null || value === undefined || value === "" ? "–" : value === true ? "✓" : value === false ? "✗" : typeof value === "number" ? String(Math.round(value * 1000) / 1000) : oneLine(value);
const USUAL = ["run", "agent", "configuration", "outcome", "failed", "simulated_s", "mark", "reason"];
const ROW_PX = 27;
const CHARACTER_PX = 7.1;
const SAMPLE = 400; // rows that the width of a column is measured on

const widthOf = ({ cell, name, kind }, rows) => {
  let most = name.replace(".passed", "").length + 2;
  if (kind === "text") for (let row = 0; row < Math.min(rows, SAMPLE); row += 1) most = Math.max(most, shown(cell(row)).length);
  return Math.round(Math.min(46, Math.max(most, 6)) * CHARACTER_PX + 18);
};

const ordered = (rows, { cell }, down) =>
  [...rows].sort((a, b) => {
    const [x, y] = [cell(a), cell(b)];
    const [noX, noY] = [x === null || x === "", y === null || y === ""];
    // Empty cells come last whichever way.
    if (noX || noY) return noX - noY || a - b;
    return (x < y ? -1 : x > y ? 1 : 0) * (down ? -1 : 1) || a - b;
  });

export function RunsPanel({ summary, condition }) {
  const { table, error } = useTable(summary);
  if (error) return <p class="note" role="alert">{oneLine(error)}</p>;
  if (!table) return <p class="wait">reading the runs</p>;
  return <Runs table={table} summary={summary} condition={condition} />;
}

function Runs({ table, summary, condition }) {
  const [typed, setTyped] = useState(condition);
  useEffect(() => setTyped(condition), [condition]);
  useEffect(() => {
    const wait = setTimeout(() => typed !== condition && location.hash.startsWith("#/runs") && history.replaceState(null, "", typed.trim() ? runsLink(typed) : "#/runs"), 400);
    return () => clearTimeout(wait);
  }, [typed]);
  const [asked, setAsked] = useState(condition);
  useEffect(() => {
    const wait = setTimeout(() => setAsked(typed), 200);
    return () => clearTimeout(wait);
  }, [typed]);
  const answer = useAnswer(() => (asked.trim() ? api.where(asked) : { rows: null }), asked, table);
  const last = useRef(null);
  if (answer.value && !answer.value.fault) last.current = answer.value.rows;
  const fault = answer.value?.fault ?? answer.error;
  const [sort, setSort] = useState(null);
  const principles = summary.nodes.filter(({ level }) => level === "principle").map(({ id }) => `${id}.passed`);
  const [names, setNames] = useState(() => {
    const usual = [...USUAL.slice(0, 5), ...principles, ...USUAL.slice(5)];
    return usual.filter((name) => name === "run" || (table.by.has(name) && !table.by.get(name).shared));
  });
  const asks = useMemo(() => table.columns.filter(({ name }) => asked.includes(name) && name.length > 3 && !names.includes(name)).map(({ name }) => name), [asked, names]);
  const columns = [...names, ...asks].map((name) => table.by.get(name));
  const widths = useMemo(() => new Map(table.columns.map((c) => [c.name, widthOf(c, table.rows)])), [table]);
  const rows = useMemo(() => {
    const chosen = last.current ?? [...Array(table.rows).keys()];
    return sort ? ordered(chosen, table.by.get(sort.name), sort.down) : chosen;
  }, [last.current, sort, table]);
  const [picked, setPicked] = useState([]);
  const box = useRef();
  const view = useWindow(box, rows.length, ROW_PX);
  useEffect(() => {
    if (box.current) box.current.scrollTop = 0;
  }, [last.current, sort]);
  const pick = (run) => setPicked((old) => (old.includes(run) ? old.filter((name) => name !== run) : [...old, run].slice(-2)));
  const next = (name) => setSort((old) => (old?.name !== name ? { name, down: false } : old.down ? null : { name, down: true }));
  const run = table.by.get("run");
  const titles = new Map(summary.nodes.map((node) => [`${node.id}.passed`, node.title]));
  const same = USUAL.map((name) => table.by.get(name)).filter((c) => c?.shared && table.rows && shown(c.cell(0)) !== "–");
  const total = columns.reduce((sum, c) => sum + widths.get(c.name), 30);
  return (
    <div class="page full">
      <form class="filter" onSubmit={(event) => event.preventDefault()}>
        <label for="where">where</label>
        <input id="where" spellcheck={false} autocomplete="off" placeholder="KA-18.passed == false and fog > 3" value={typed} onInput={(event) => setTyped(event.currentTarget.value)} aria-invalid={Boolean(fault)} />
        <output class={fault ? "bad" : ""}>{fault ? oneLine(fault) : `${rows.length} of ${table.rows} runs`}</output>
        {picked.length === 2 && <a class="button" href={`#/pair/${picked.map(encodeURIComponent).join("/")}`}>compare the two</a>}
        <Columns table={table} names={names} setNames={setNames} titles={titles} />
        <a class="button" href={api.csvAddress(fault ? "" : asked)} download="runs.csv">CSV</a>
      </form>
      {same.length > 0 && <p class="soft small same">all runs: {same.map((c) => `${c.name} ${shown(c.cell(0))}`).join(", ")}</p>}
      <div class="rows" ref={box} onScroll={view.onScroll} role="region" aria-label="Runs" tabindex="0">
        <table style={{ width: `${total}px` }} aria-rowcount={rows.length + 1}>
          <colgroup><col style={{ width: "30px" }} />{columns.map((c) => <col style={{ width: `${widths.get(c.name)}px` }} />)}</colgroup>
          <thead>
            <tr>
              <th aria-label="picked for a pair" />
              {columns.map((c) => (
                <th data-column={c.name} title={titles.get(c.name) ?? c.name} class={c.kind === "number" ? "n" : ""} aria-sort={sort?.name === c.name ? (sort.down ? "descending" : "ascending") : "none"}>
                  <button type="button" onClick={() => next(c.name)}>{c.name.replace(".passed", "")}{sort?.name === c.name ? (sort.down ? " ▼" : " ▲") : ""}</button>
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            <tr class="space" style={{ height: `${view.from * ROW_PX}px` }}><td /></tr>
            {rows.slice(view.from, view.until).map((row, index) => {
              const name = run.cell(row);
              return (
                <tr key={row} data-row={name} aria-rowindex={view.from + index + 2} onClick={(event) => event.target.closest("a, input") || go(`/run/${encodeURIComponent(name)}`)}>
                  <td><input type="checkbox" aria-label={`pick ${name}`} checked={picked.includes(name)} onChange={() => pick(name)} /></td>
                  {columns.map((c) => {
                    const value = c.cell(row);
                    const tone = value === false && c.name.endsWith(".passed") ? "bad" : value === true && c.name.endsWith(".passed") ? "good" : c.name === "outcome" && value !== "completed" ? "bad" : "";
                    return <td class={`${c.kind === "number" ? "n" : ""} ${tone}`} title={c.kind === "text" ? shown(value) : undefined}>{c === run ? <a href={`#/run/${encodeURIComponent(name)}`}>{name}</a> : shown(value)}</td>;
                  })}
                </tr>
              );
            })}
            <tr class="space" style={{ height: `${(rows.length - view.until) * ROW_PX}px` }}><td /></tr>
          </tbody>
        </table>
      </div>
    </div>
  );
}

function Columns({ table, names, setNames, titles }) {
  const [text, setText] = useState("");
  const rows = table.columns.filter(({ name }) => name !== "run" && `${name} ${titles.get(name) ?? ""}`.toLowerCase().includes(text.toLowerCase()));
  const toggle = (name) => setNames((old) => (old.includes(name) ? old.filter((other) => other !== name) : [...old, name]));
  return (
    <details class="columns">
      <summary class="button">columns</summary>
      <div class="menu">
        <input type="search" placeholder="find a column" aria-label="find a column" value={text} onInput={(event) => setText(event.currentTarget.value)} />
        {rows.map(({ name }) => (
          <label><input type="checkbox" checked={names.includes(name)} onChange={() => toggle(name)} /> {name} <span class="soft">{titles.get(name)}</span></label>
        ))}
      </div>
    </details>
  );
}

const CELL_PX = 18;
const MAX_NAMES_PX = 236; // a third of a narrow window
const HEAD_PX = 214;
const TITLE = 34; // characters of an observable's title

export function MatrixPanel({ summary }) {
  const { table, error } = useTable(summary);
  if (error) return <p class="note" role="alert">{oneLine(error)}</p>;
  if (!table) return <p class="wait">reading the runs</p>;
  return <Matrix table={table} summary={summary} />;
}

function Matrix({ table, summary }) {
  useTheme();
  const [byAgent, setByAgent] = useState(false);
  const [cursor, setCursor] = useState(null);
  const observables = useMemo(() => {
    const seen = new Set();
    const nodes = new Map(summary.nodes.map((node) => [node.id, node]));
    const group = (id, above) => {
      const node = nodes.get(id);
      if (!node || seen.has(`${id}${node.level === "observable" ? "" : above}`)) return [];
      if (node.level !== "observable") return node.children.flatMap((child) => group(child, node.level === "ka" ? id : above));
      seen.add(id);
      return table.by.has(`${id}.passed`) ? [{ ...node, group: above, cell: table.by.get(`${id}.passed`).cell }] : [];
    };
    return summary.roots.flatMap((id) => group(id, ""));
  }, [table, summary]);
  const rows = useMemo(() => {
    const [point, replicate, agent] = ["design_point", "replicate", "agent"].map((name) => table.by.get(name).cell);
    const keys = byAgent ? [agent, point, replicate] : [point, replicate, agent];
    return [...Array(table.rows).keys()].sort((a, b) => {
      for (const key of keys) if (key(a) !== key(b)) return key(a) < key(b) ? -1 : 1;
      return 0;
    });
  }, [table, byAgent]);
  const box = useRef();
  const canvas = useRef();
  const size = useSize(box);
  const names_px = Math.min(MAX_NAMES_PX, Math.max(90, size.width / 3));
  const [scroll, setScroll] = useState([0, 0]);
  const run = table.by.get("run").cell;
  const state = (row, node) => ({ true: "passed", false: "failed", null: "not considered" })[node.cell(row)];
  useEffect(() => {
    if (!size.width) return;
    const [g, c, ratio] = [canvas.current.getContext("2d"), colours(), devicePixelRatio || 1];
    const good = getComputedStyle(canvas.current).getPropertyValue("--matrix-good");
    Object.assign(canvas.current, { width: size.width * ratio, height: size.height * ratio });
    g.scale(ratio, ratio);
    g.clearRect(0, 0, size.width, size.height);
    g.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    const [left, top] = scroll;
    const firstRow = Math.floor(top / CELL_PX);
    const lastRow = Math.min(rows.length, firstRow + Math.ceil(size.height / CELL_PX) + 1);
    const firstColumn = Math.floor(left / CELL_PX);
    const lastColumn = Math.min(observables.length, firstColumn + Math.ceil(size.width / CELL_PX) + 1);
    for (let r = firstRow; r < lastRow; r += 1) {
      const y = HEAD_PX + r * CELL_PX - top;
      for (let o = firstColumn; o < lastColumn; o += 1) {
        const x = names_px + o * CELL_PX - left;
        const passed = observables[o].cell(rows[r]);
        if (passed === null) {
          g.fillStyle = c.line;
          g.fillRect(x + CELL_PX / 2 - 1, y + CELL_PX / 2 - 1, 2, 2);
        } else {
          g.fillStyle = passed ? good : c.forbidden;
          g.fillRect(x + 1, y + 1, CELL_PX - 2, CELL_PX - 2);
        }
        if (cursor && cursor[0] === r && cursor[1] === o) {
          Object.assign(g, { strokeStyle: c.ink, lineWidth: 2 });
          g.strokeRect(x, y, CELL_PX, CELL_PX);
        }
      }
    }
    g.fillStyle = c.paper;
    g.fillRect(0, 0, names_px, size.height);
    g.fillRect(0, 0, size.width, HEAD_PX);
    for (let r = firstRow; r < lastRow; r += 1) {
      const y = HEAD_PX + r * CELL_PX - top;
      if (y < HEAD_PX - CELL_PX / 2) continue;
      g.fillStyle = cursor?.[0] === r ? c.ink : c["ink-soft"];
      g.textAlign = "right";
      g.fillText(run(rows[r]).slice(0, 40), names_px - 8, y + 13, names_px - 14);
    }
    for (let o = firstColumn; o < lastColumn; o += 1) {
      const x = names_px + o * CELL_PX - left;
      if (x < names_px - 2) continue;
      if (o === 0 || observables[o].group !== observables[o - 1].group) {
        g.fillStyle = c.line;
        g.fillRect(x, 0, 1, Math.min(size.height, HEAD_PX + rows.length * CELL_PX - top));
        g.fillStyle = c.ink;
        g.textAlign = "left";
        const wide = observables.filter(({ group }) => group === observables[o].group).length * CELL_PX;
        if (wide > 2 * CELL_PX - 1) g.fillText(observables[o].group, x + 3, 11, wide - 5);
      }
      g.save();
      g.translate(x + 13, HEAD_PX - 5);
      g.rotate(-Math.PI / 2);
      g.fillStyle = cursor?.[1] === o ? c.ink : c["ink-soft"];
      g.textAlign = "left";
      const { id, title } = observables[o];
      g.fillText(`${id} ${title.length > TITLE ? `${title.slice(0, TITLE - 1)}…` : title}`, 0, 0, HEAD_PX - 26);
      g.restore();
    }
  });
  const cellAt = (event) => {
    const rect = canvas.current.getBoundingClientRect();
    const o = Math.floor((event.clientX - rect.left - names_px + scroll[0]) / CELL_PX);
    const r = Math.floor((event.clientY - rect.top - HEAD_PX + scroll[1]) / CELL_PX);
    return r >= 0 && r < rows.length && o >= 0 && o < observables.length && event.clientX - rect.left > names_px ? [r, o] : null;
  };
  // The run at the first moment that the measure states of this observable.
  const open = async ([r, o]) => {
    const name = run(rows[r]);
    const moment = momentsOf(await api.run(name), new Map()).find(({ id }) => id === observables[o].id);
    go(`/run/${encodeURIComponent(name)}${moment ? `?t=${moment.t.toFixed(1)}` : ""}`);
  };
  const pressed = (event) => {
    const step = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    if (event.key === "Enter" && cursor) open(cursor);
    if (!step) return;
    event.preventDefault();
    const [r, o] = cursor ?? [0, 0];
    const to = cursor ? [Math.min(rows.length - 1, Math.max(0, r + step[0])), Math.min(observables.length - 1, Math.max(0, o + step[1]))] : [0, 0];
    setCursor(to);
    const [x, y] = [to[1] * CELL_PX, to[0] * CELL_PX];
    const room = [size.width - names_px - CELL_PX, size.height - HEAD_PX - CELL_PX];
    box.current.scrollTo(Math.max(x - room[0], Math.min(x, scroll[0])), Math.max(y - room[1], Math.min(y, scroll[1])));
  };
  const node = cursor && observables[cursor[1]];
  return (
    <div class="page full">
      <div class="filter">
        <label><input type="checkbox" checked={byAgent} onChange={() => setByAgent(!byAgent)} /> by agent</label>
        <output class="readout">
          {cursor ? <><b class={state(rows[cursor[0]], node) === "failed" ? "bad" : ""}>{state(rows[cursor[0]], node)}</b> {node.group}, {node.id} {node.title} · {run(rows[cursor[0]])}</> : `${rows.length} runs, ${observables.length} observables; a cell opens the run at the moment of the failure`}
        </output>
        <span class="sign"><i class="m-good" />passed</span><span class="sign"><i class="m-bad" />failed</span><span class="sign"><i class="m-none" />not considered</span>
      </div>
      <div class="matrix" ref={box} tabindex="0" role="application" aria-label="Runs and observables; arrows move, Enter opens the run" onKeyDown={pressed} onScroll={(event) => setScroll([event.currentTarget.scrollLeft, event.currentTarget.scrollTop])}>
        <div style={{ width: `${names_px + observables.length * CELL_PX + 8}px`, height: `${HEAD_PX + rows.length * CELL_PX + 8}px` }}>
          <canvas
            ref={canvas}
            style={{ width: `${size.width}px`, height: `${size.height}px` }}
            onPointerMove={(event) => setCursor(cellAt(event) ?? cursor)}
            onClick={(event) => cellAt(event) && open(cellAt(event))}
          />
        </div>
      </div>
    </div>
  );
}
