"""The page: report data laid out in one self-contained HTML file that fetches nothing."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from bench.contracts import Outcome
from bench.errors import SetupError
from bench.recording import read_simspec, read_tape

from ._campaign_data import ALL, ReportData
from ._campaign_folder import load_report_data
from ._html import environment, policy, script_text, template_text
from ._page_sections import (
    PageFigures,
    agent_pairs,
    configuration_panels,
    flattened,
    map_section,
    node_trees,
    outcome_counts,
    studied_nodes,
)
from .figures._configuration import VIOLIN_FROM, VIOLIN_SPREAD
from .figures._factor_effects import factors_figure
from .figures._style import looks
from .map._run_choice import choose_runs
from .map._run_map import RunMap, draw_map
from .statistics._agent_comparison import compare_agents
from .statistics._design_quality import quality_of
from .statistics._factor_effects import factors_that_matter
from .statistics._trials import trials_of
from .text._campaign_facts import describe, factor_rows, provenance_of
from .text._campaign_sentences import differences, extremes, not_claimed, what_was_flown
from .text._fidelity import fidelity_note, told_in_tables
from .text._format import interval, number, p_value, percent, score, span
from .text._glossary import GLOSSARY
from .text._outcomes import outcome_name, outcome_text

MANIFEST_ROWS = 5000


def write_report(folder: Path, *, runs_on_map: int = 6) -> Path:
    """Write `report.html` into a campaign's folder and return its path; the same folder gives the same bytes.

    Raises SetupError when `folder` holds no campaign. What is missing or damaged in it is said in the report.
    """
    data = load_report_data(folder)
    path = folder / "report.html"
    draft = folder / "report.html.part"
    draft.write_text(render_report(data, *_charts(data, runs_on_map)), encoding="utf-8")
    draft.replace(path)
    return path


def render_report(data: ReportData, charts: Sequence[RunMap] = (), map_notes: Sequence[str] = ()) -> str:
    """The page as text. `charts` are the runs to show from above, `map_notes` what to say of runs that cannot be shown."""
    figures = PageFigures()
    comparisons = agent_pairs(data, figures)
    matter = factors_that_matter(data)
    plotly, script = (script_text(text) for text in (get_plotlyjs(), template_text("report.js")))
    shown = looks(data.agents)
    trials = trials_of(data.scores)
    names, counts = outcome_counts(data, shown)
    context: dict[str, Any] = {
        "data": data,
        "fidelity": fidelity_note(data.campaign),
        "looks": shown,
        "css": Markup(template_text("report.css")),
        "policy": policy(plotly, script),
        "flown": what_was_flown(data),
        "differences": [line for one in comparisons for line in differences(data, one.pairings)],
        "not_claimed": not_claimed(data),
        "facts": describe(data),
        "quality": quality_of(data),
        "raised": any(t.raised for (_, where, _), t in data.tallies.items() if where == ALL),
        "factors": factor_rows(data),
        "outcome_names": names,
        "outcome_counts": counts,
        "studied": studied_nodes(data, shown, trials, figures) if data.tallies else [],
        "trees": node_trees(data, shown, trials),
        "panels": configuration_panels(data, shown, figures),
        "maps": [map_section(chart, place, figures) for place, chart in enumerate(charts, start=1)],
        "map_notes": map_notes,
        "comparisons": comparisons,
        "settled": {one.id: compare_agents(data, one.first.name, one.second.name) for one in comparisons},
        "matter": matter,
        "factors_id": figures.add("factors-1", factors_figure(matter)) if matter.tables else "",
        "failures": [run for run in data.runs if run.outcome is not Outcome.COMPLETED],
        "provenance": provenance_of(data),
        # The page's own digest cannot stand in the page.
        "manifest": [row for row in flattened(data.manifest) if "report.html" not in row[0]][:MANIFEST_ROWS],
        "labels": {one.key: one.label for one in data.configurations},
        "glossary": GLOSSARY,
        "violin_from": VIOLIN_FROM,
        "violin_spread": f"{VIOLIN_SPREAD:g}",
        "version": version("rebar-bench"),
        "figures": figures.drawn,
        "plotly": Markup(plotly),
        "script": Markup(script),
    }
    page = _environment().get_template("report.html.j2").render(context)
    return told_in_tables(page, context["fidelity"])


def _charts(data: ReportData, count: int) -> tuple[list[RunMap], list[str]]:
    """Maps of the chosen runs, and a sentence for each recording that could not be read."""
    charts, notes = [], []
    for run in choose_runs(data, count):
        assert run.recording is not None  # only recorded runs are chosen
        try:
            simspec = read_simspec(run.recording)
            charts.append(draw_map(run, simspec, read_tape(run.recording, simspec)))
        except (SetupError, OSError):
            notes.append(f"The recording of {run.realization} cannot be read, so it is not drawn.")
    absent = [run.realization for run in data.runs if run.recording is None and run.outcome and run.outcome.counts]
    if absent:
        more = f" and {len(absent) - 3} more" if len(absent) > 3 else ""
        notes.append(f"No recording is here of {', '.join(absent[:3])}{more}.")
    return charts, notes


def _environment() -> jinja2.Environment:
    found = environment()
    found.globals.update(
        number=number,
        percent=percent,
        score=score,
        interval=interval,
        span=span,
        p_value=p_value,
        outcome_name=outcome_name,
        outcome_text=outcome_text,
        extremes=extremes,
    )
    return found
