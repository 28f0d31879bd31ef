"""The table of runs in a browser: it filters as `rebar runs --where` does, sorts, opens a run, and 10,000 rows scroll; maps on paper."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import polars as pl
from chromium import dom_of, needs_chromium, with_script
from made_campaign import AGENTS, Made, made_simspec, made_tape, make_campaign, write_recording

from bench.contracts import Observation, Outcome, SessionResult
from bench.errors import SetupError
from bench.reporting import load_report_data, matching, render_report, runs_table, write_report
from bench.reporting._html import json_script_text
from bench.reporting._runs_table import runs_document

pytestmark = needs_chromium
CONDITIONS = (
    "KA-18.passed == false and fog > 1",
    "not KA-18.passed == false",
    "fog == 0 or fog == 2 and replicate == 1",
    "(fog == 0 or fog == 2) and not replicate == 1",
    'outcome != "completed"',
    "outcome == 'agent crashed' or failed >= 4",
    "P-RELIABLE.passed != true",
    "P-RELIABLE.passed == none",
    "`KA-09`.passed == true and simulated_s <= 1.2e2",
    "seed == '1001'",
    "fog >",
    "fog > 'x'",
    "nothing == 1",
    "(fog > 1",
    "fog > 1 failed",
    "intelligence > 1",
    "(" * 40 + "fog > 1" + ")" * 40,
    "(" * 41 + "fog > 1" + ")" * 41,
)
SCRIPT = """
window.addEventListener("error", (event) => { document.body.dataset.error = event.message; });
window.addEventListener("load", () => {
  const input = document.getElementById("where"), says = document.getElementById("where-says");
  const view = document.getElementById("runs-view");
  const rows = () => [...view.querySelectorAll("tr[data-row]")].map((row) => row.cells[0].textContent);
  const filter = (text) => { input.value = text; input.dispatchEvent(new Event("input")); };
  const states = {};
  for (const text of CONDITIONS) { filter(text); states[text] = [says.textContent, says.classList.contains("bad"), rows()]; }
  filter("");
  const head = view.querySelector('th[data-column="failed"]');
  const control = head && head.querySelector("button");
  const sorted = [];
  if (control) for (const _ of [1, 2]) { control.click(); sorted.push(rows().length && [...view.querySelectorAll("tr[data-row]")].map((row) => Number(row.cells[head.cellIndex].textContent))); }
  view.querySelector("tr[data-row]").click();
  const first = rows();
  view.scrollTop = view.scrollHeight;
  view.dispatchEvent(new Event("scroll"));
  const scrolled = rows();
  const button = view.querySelectorAll("tr[data-row] button")[5];
  button.focus({ preventScroll: true });
  view.dispatchEvent(new Event("scroll"));
  const focused = document.activeElement.textContent === button.textContent && document.activeElement !== button;
  window.dispatchEvent(new Event("beforeprint"));
  const printed = rows();
  window.dispatchEvent(new Event("afterprint"));
  const again = rows().join() === scrolled.join();
  document.body.dataset.states = JSON.stringify({
    states, sorted, detail: document.getElementById("run-detail").textContent, last: scrolled.at(-1),
    drawn: scrolled.length, first, focused, printed, again,
    height: view.scrollHeight,
  });
});
"""


def browsed(page: str, folder: Path, conditions: tuple[str, ...] = CONDITIONS) -> dict[str, Any]:
    """What a browser shows of the table of runs."""
    dom = dom_of(with_script(page, SCRIPT.replace("CONDITIONS", json.dumps(conditions))), folder)
    assert "data-error" not in dom[:10_000].split("<body", 1)[-1].split(">")[0]
    states = re.search(r'data-states="([^"]*)"', dom)
    assert states is not None
    shown: dict[str, Any] = json.loads(unescape(states[1]))
    return shown


def refusal(table: pl.DataFrame, condition: str) -> str | None:
    """Why a condition cannot be read; None for one that can."""
    try:
        matching(table, condition, "--where")
    except SetupError as refused:
        return refused.faults[0].what
    return None


def test_the_page_filters_as_the_command_does(tmp_path: Path) -> None:
    """The same runs in the same order, or the same reason why not; failed runs come first, and a click opens one."""
    endings = {
        "p003-r0-reference-naive": (Outcome.AGENT_CRASHED, "exit 1"),
        "p004-r0-reference-bystander-aware": (Outcome.PLACEMENT_INFEASIBLE, "no place"),
    }
    folder = make_campaign(tmp_path / "c", Made(endings=endings))
    for file in folder.glob("runs/*/result.json"):
        result = SessionResult.model_validate_json(file.read_text())
        observations = [
            Observation(observable=node, considered=True, x=0.5, stages=f"{node} of {file.parent.name}")
            for node in ("OBS-181", "OBS-201", "OBS-999")
        ]
        result = result.model_copy(update={"observations": tuple(observations)})
        file.write_text(result.model_dump_json())
    data = load_report_data(folder)
    # Recordings that are not there have no row that opens; their paths are all that is asked for.
    runs = [replace(run, recording=folder / "runs" / run.realization / "recording.mcap") for run in data.runs]
    data = replace(data, runs=tuple(runs))
    table = runs_table(data)
    shown = browsed(render_report(data), tmp_path)
    chosen = set()
    for condition in CONDITIONS:
        says, is_bad, rows = shown["states"][condition]
        if (reason := refusal(table, condition)) is not None:
            assert is_bad, condition
            # In nearly the same words, such as `has its end where a value should be`.
            assert says.split()[:2] == reason.split()[:2], (says, reason)
            continue
        wanted = matching(table, condition, "--where")["run"].to_list()
        assert (rows, is_bad) == (wanted, False), condition
        assert says == f"{len(wanted)} of 12 runs"
        chosen.add(len(wanted))
    assert len(chosen) > 4
    ascending, descending = shown["sorted"]
    assert ascending == sorted(ascending)
    assert descending == sorted(descending, reverse=True)
    assert "SHA-256" in shown["detail"]
    assert "Not passed" in shown["detail"]
    opened = shown["detail"].split("Ended")[0]
    for node in ("OBS-181", "OBS-201"):
        failed = table.filter(run=opened)[f"{node}.passed"][0] is False
        assert (f"{node} of {opened}" in shown["detail"]) is failed, node
    assert "OBS-999" not in shown["detail"]
    assert f"rebar explain DIR/runs/{opened}" in shown["detail"]


def test_ten_thousand_rows_scroll(tmp_path: Path) -> None:
    """The document holds only the rows in view, its data are small, a row keeps the focus, paper has the first rows."""
    data = load_report_data(make_campaign(tmp_path / "c", Made(scenes=2)))
    page = render_report(data)
    few = runs_table(data)
    named = (pl.lit(f"q{place:04d}-") + pl.col("run") for place in range(2500))
    many = pl.concat([few.with_columns(run=name) for name in named])
    assert many.height == 10_000
    packed = str(json_script_text(runs_document(many, {}, {})))
    assert len(packed) < 3_000_000
    begin = '<script type="application/json" id="data-runs">'
    before, after = page.split(begin)
    page = f"{before}{begin}{packed}{after[after.index('</script>') :]}"
    shown = browsed(page, tmp_path, ("fog == 1",))
    assert shown["states"]["fog == 1"][0] == "5000 of 10000 runs"
    assert shown["height"] > 10_000 * 30
    assert shown["drawn"] < 100
    assert shown["last"].startswith("q")
    assert shown["focused"]
    # As many as the page lists without the script.
    assert shown["printed"] == shown["first"][: few.height]
    assert shown["again"]


# Notes what is shown before printing, on paper and afterwards, where the DOM that is dumped holds it.
OBSERVER = """
const shown = () => [...document.querySelectorAll(".mapbox")].filter((box) => !box.hidden).map((box) => box.id);
window.addEventListener("load", () => {
  const state = [shown().join(" ")];
  window.dispatchEvent(new Event("beforeprint"));
  setTimeout(() => {
    state.push(shown().join(" "), String(new Set([...document.querySelectorAll(
      ".mapbox:not([hidden]) .figure > svg")].map((svg) => svg.closest(".mapbox").id)).size));
    window.dispatchEvent(new Event("afterprint"));
    state.push(shown().join(" "));
    document.body.dataset.states = state.join("|");
  }, 0);
});
"""


def test_every_map_is_printed(tmp_path: Path) -> None:
    """Two runs have a map: a screen shows the first, paper both with their figures, then the screen the first again."""
    folder = make_campaign(tmp_path / "campaign", Made(scenes=1))
    for agent in AGENTS:
        simspec = made_simspec(0, agent)
        path = folder / "runs" / f"p000-r0-{agent}" / "recording.mcap"
        write_recording(path, simspec, made_tape(simspec))
    dom = dom_of(with_script(write_report(folder).read_text(), OBSERVER), tmp_path)
    states = re.search(r'data-states="([^"]*)"', dom)
    assert states is not None
    boxes = re.findall(r'<div class="mapbox" id="([^"]+)"', dom)
    assert len(boxes) == 2
    assert states[1].split("|") == [boxes[0], " ".join(boxes), "2", boxes[0]]
