// The shell: which panel the address names, and the campaign that all of them show.
import { render } from "preact";
import { useEffect, useMemo, useState } from "preact/hooks";
import * as api from "./api.js";
import css from "./app.css";
import { useAnswer, useTheme } from "./hooks.js";
import { LivePanel, SignPanel } from "./live.jsx";
import { PairPanel, RunPanel } from "./player.jsx";
import { MatrixPanel, RunsPanel, VerdictPanel } from "./tables.jsx";
import { oneLine } from "./visible.js";

// A style element would need an exception in the policy of the page.
const sheet = new CSSStyleSheet();
sheet.replaceSync(css);
document.adoptedStyleSheets = [sheet];

const PANELS = { verdict: "Verdict", runs: "Runs", matrix: "Matrix", live: "Live", sign: "Sign" };

function useRoute() {
  const [hash, setHash] = useState(location.hash);
  useEffect(() => {
    const changed = () => setHash(location.hash);
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  const [path, query = ""] = hash.replace(/^#?\/?/, "").split("?");
  const [panel, ...names] = path.split("/").map((part) => {
    try {
      return decodeURIComponent(part);
    } catch {
      return part;
    }
  });
  const words = new URLSearchParams(query);
  const t = Number(words.get("t"));
  return { panel, names, where: words.get("where") ?? "", t: Number.isFinite(t) && t > 0 ? t : 0 };
}

function Panel({ route, summary, titles }) {
  const { panel, names, t } = route;
  if (panel === "run" && names[0]) return <RunPanel key={names[0]} id={names[0]} start_s={t} titles={titles} />;
  if (summary.kind === "run") return <RunPanel key={summary.run} id={summary.run} start_s={t} titles={titles} />;
  if (panel === "pair" && names[1]) return <PairPanel key={names.join("/")} ids={names} start_s={t} titles={titles} />;
  if (panel === "runs") return <RunsPanel summary={summary} condition={route.where} />;
  if (panel === "matrix") return <MatrixPanel summary={summary} />;
  if (panel === "live") return <LivePanel summary={summary} titles={titles} />;
  if (panel === "sign") return <SignPanel summary={summary} />;
  return <VerdictPanel summary={summary} />;
}

function App() {
  useTheme();
  const route = useRoute();
  const [known, setKnown] = useState(null);
  // A complete campaign does not change; one that flies is asked again for each panel.
  const ask = () => (known && (known.kind === "run" || known.manifest_sha256) ? known : api.summary());
  const answer = useAnswer(ask, route.panel === "run" || route.panel === "pair" ? "" : route.panel);
  useEffect(() => answer.value && setKnown(answer.value), [answer.value]);
  const titles = useMemo(() => new Map((known?.nodes ?? []).map(({ id, title }) => [id, title])), [known]);
  if (answer.error && !known) return <p class="note" role="alert">{oneLine(answer.error)}</p>;
  if (!known) return <p class="wait">reading the folder</p>;
  const current = PANELS[route.panel] ? route.panel : route.panel === "run" || route.panel === "pair" ? "runs" : "verdict";
  return (
    <>
      <nav>
        <a class="brand" href="#/verdict">REBAR</a>
        <span class="campaign">{oneLine(known.name)}</span>
        {known.kind === "campaign" && Object.entries(PANELS).map(([name, title]) => (
          <a href={`#/${name}`} aria-current={name === current ? "page" : undefined}>{title}</a>
        ))}
      </nav>
      <main><Panel route={route} summary={known} titles={titles} /></main>
    </>
  );
}

render(<App />, document.body);
