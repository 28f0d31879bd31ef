// Everything that was said or done in a run, as lines of one log in the order of time.
import { placeAt } from "./tape.js";

const place = (row) => `${row.east_m?.toFixed(0)} E ${row.north_m?.toFixed(0)} N`;
const share = (value) => (value === null || value === undefined ? "" : ` ${(100 * value).toFixed(0)} %`);

export const KINDS = {
  decision: "decisions",
  report: "reports",
  status: "phases",
  order: "operator",
  consent: "consents",
  measured: "measured",
  event: "session",
};

export function entriesOf(tape, run, titles) {
  const rows = [];
  const add = (kind, t, title, text, raw, tone = "") => rows.push({ kind, t, title, text, raw, tone });
  for (const row of tape.decisions) {
    add("decision", row.t, `${row.action}${row.subject ? ` ${row.subject}` : ""}`, row.reason, row);
  }
  for (const row of tape.reports) {
    const people = row.bystanders_seen === null || row.bystanders_seen === undefined ? "" : `, ${row.bystanders_seen} people seen`;
    const title = `${row.mark ? "mark" : "report"} ${row.class_label}${share(row.confidence)} at ${place(row)}${people}`;
    add("report", row.t, title, row.reason, row, row.mark ? "mark" : "good");
  }
  let said = "";
  for (const row of tape.status) {
    const words = `${row.phase} ${row.text}`;
    if (words !== said) add("status", row.t, row.phase, row.text, row);
    said = words;
  }
  for (const row of tape.orders) {
    const title = `order ${row.id}: ${row.kind}${row.intelligence_id ? ` ${row.intelligence_id}` : ""}`;
    add("order", row.t, title, `within ${row.within_s} s`, row, "warn");
  }
  for (const row of tape.answers) {
    add("order", row.t, `${row.accepted ? "accepts" : "refuses"} ${row.order}`, row.reason, row, row.accepted ? "" : "bad");
  }
  for (const row of tape.consent_requests) {
    add("consent", row.t, `asks to mark ${row.class_label} at ${place(row)}`, row.reason, row, "warn");
  }
  for (const row of tape.consents) {
    add("consent", row.t, `operator ${row.granted ? "grants" : "refuses"} ${row.request}`, "", row, row.granted ? "good" : "bad");
  }
  for (const row of tape.operator_link.slice(1)) {
    add("order", row.t, `operator's link ${row.up ? "up" : "down"}`, "", row, row.up ? "" : "bad");
  }
  for (const row of tape.intelligence) {
    add("order", row.t, `intelligence ${row.id}: ${row.class_label} within ${row.uncertainty_m} m`, `priority ${row.priority}`, row);
  }
  for (const row of tape.events) add("event", row.t, row.name, row.text, row);
  for (const row of momentsOf(run, titles)) {
    add("measured", row.t, `${row.id} ${row.title}`, row.text, null, row.passed ? "good" : row.considered ? "bad" : "");
  }
  return rows.map((row, index) => ({ ...row, index })).sort((a, b) => a.t - b.t || a.index - b.index);
}

// The moments behind each measured observable, and whether it was achieved.
export function momentsOf(run, titles) {
  const nodes = new Map((run?.nodes ?? []).map((row) => [row.node, row]));
  return (run?.result?.observations ?? []).flatMap((row) => {
    const node = nodes.get(row.observable);
    const passed = node ? node.considered > 0 && node.achieved === node.considered : undefined;
    const rest = { id: row.observable, title: titles.get(row.observable) ?? "", considered: row.considered && node, passed };
    return row.evidence.map(({ time_s, text }) => ({ ...rest, t: time_s, text }));
  });
}

// The observables that a run failed, each with its first stated moment and how far the agent came with its subject.
export function failuresOf(run, titles) {
  const moments = momentsOf(run, titles);
  const observed = new Map((run?.result?.observations ?? []).map((row) => [row.observable, row]));
  return (run?.nodes ?? [])
    .filter((row) => titles.has(row.node) && observed.has(row.node) && row.considered > 0 && row.achieved < row.considered)
    .map((row) => ({
      id: row.node,
      title: titles.get(row.node),
      moment: moments.find(({ id }) => id === row.node),
      stages: observed.get(row.node).stages,
    }));
}

// Phases as spans, the last to the end of the tape.
export function phasesOf(tape) {
  const spans = [];
  for (const row of tape.status) {
    if (spans.at(-1)?.phase !== row.phase) spans.push({ phase: row.phase, from: row.t });
  }
  return spans.map((span, index) => ({ ...span, until: spans[index + 1]?.from ?? tape.end_s }));
}

// Spans in which something was taken from the agent or the vehicle, as the situation configures them.
export function outagesOf(tape) {
  const spec = tape.simspec ?? {};
  const outages = (spec.outages ?? []).map((row) => ({ from: row.at_s, until: row.until_s ?? tape.end_s, text: row.kind.replaceAll("_", " ") }));
  const failures = (spec.vehicle?.failures ?? []).map((row) => ({
    from: row.at_s,
    until: row.duration_s == null ? tape.end_s : row.at_s + row.duration_s,
    text: row.kind.replaceAll("_", " "),
  }));
  return [...outages, ...failures].filter(({ from }) => from <= tape.end_s);
}

// Metres apart from which two flights differ. Chosen: above the noise of what is the same, below what one sees.
const APART_M = 1;

// The first moment at which two agents differ in what they say, decide, report or fly; null where they never do.
export function firstDifference(left, right) {
  const told = (tape) =>
    [
      ...tape.status.filter((row, index) => row.phase !== tape.status[index - 1]?.phase).map((row) => ({ t: row.t, what: `phase ${row.phase}` })),
      ...tape.decisions.map((row) => ({ t: row.t, what: `decision ${row.action} ${row.subject}` })),
      ...tape.reports.map((row) => ({ t: row.t, what: `${row.mark ? "mark" : "report"} ${row.class_label}` })),
      ...tape.answers.map((row) => ({ t: row.t, what: `${row.accepted ? "accepts" : "refuses"} ${row.order}` })),
    ].sort((a, b) => a.t - b.t || (a.what < b.what ? -1 : 1));
  const [a, b] = [told(left), told(right)];
  let found = null;
  for (let at = 0; at < Math.max(a.length, b.length); at += 1) {
    if (a[at]?.what === b[at]?.what && Math.abs(a[at].t - b[at].t) < 0.05) continue;
    const t = Math.min(a[at]?.t ?? Infinity, b[at]?.t ?? Infinity);
    const said = (row) => (row && row.t <= t + 0.05 ? row.what : "nothing");
    found = { t, text: `${said(a[at])} | ${said(b[at])}` };
    break;
  }
  for (const row of left.flight) {
    if (found && row.t >= found.t) break;
    const other = right.flight[placeAt(right.flight, row.t)];
    if (!other || row.t > other.t + 1) break;
    const apart_m = Math.hypot(row.x - other.x, row.y - other.y, row.z - other.z);
    if (apart_m > APART_M) return { t: row.t, text: `flights ${apart_m.toFixed(1)} m apart` };
  }
  return found;
}
