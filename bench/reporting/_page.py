"""The page: report data laid out in one self-contained HTML file that fetches nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from bench.contracts import Outcome
from bench.errors import SetupError
from bench.recording import read_simspec, read_tape

from . import _words as words
from ._data import ALL, ReportData, Run, Tally, load_report_data
from ._design import quality_of
from ._facts import describe, factor_levels, factor_rows, provenance_of
from ._fidelity import fidelity_note, told_in_tables
from ._figures import VIOLIN_FROM, VIOLIN_SPREAD, AgentLook, configuration_figure, curve_figure, looks, pairs_figure
from ._map import RunMap, choose_runs, draw_map
from ._map_figure import map_figure
from ._offline import data_text, environment, policy, script_text, template_text
from ._pairs import Pairing, pair_agents
from ._statistics import compare_agents, factors_figure, factors_that_matter
from ._told import AllTrials, Trials, curve_remark, sentences, trials_of

MANIFEST_ROWS = 5000
DECISION_ROWS = 200


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
    figures = _Figures()
    comparisons = _comparisons(data, figures)
    matter = factors_that_matter(data)
    plotly, script = (script_text(text) for text in (get_plotlyjs(), template_text("report.js")))
    shown = looks(data.agents)
    trials = trials_of(data.scores)
    names, counts = _outcome_counts(data, shown)
    context: dict[str, Any] = {
        "data": data,
        "fidelity": fidelity_note(data.campaign),
        "looks": shown,
        "css": Markup(template_text("report.css")),
        "policy": policy(plotly, script),
        "flown": words.what_was_flown(data),
        "differences": [line for one in comparisons for line in words.differences(data, one.pairings)],
        "not_claimed": words.not_claimed(data),
        "facts": describe(data),
        "quality": quality_of(data),
        "raised": any(t.raised for (_, where, _), t in data.tallies.items() if where == ALL),
        "factors": factor_rows(data),
        "outcome_names": names,
        "outcome_counts": counts,
        "studied": _studied(data, shown, trials, figures) if data.tallies else [],
        "trees": _trees(data, shown, trials),
        "panels": _panels(data, shown, figures),
        "maps": [_map(chart, place, figures) for place, chart in enumerate(charts, start=1)],
        "map_notes": map_notes,
        "comparisons": comparisons,
        "settled": {one.id: compare_agents(data, one.first.name, one.second.name) for one in comparisons},
        "matter": matter,
        "factors_id": figures.add("factors-1", factors_figure(matter)) if matter.tables else "",
        "failures": [run for run in data.runs if run.outcome is not Outcome.COMPLETED],
        "provenance": provenance_of(data),
        # The page's own digest cannot stand in the page.
        "manifest": [row for row in _flattened(data.manifest) if "report.html" not in row[0]][:MANIFEST_ROWS],
        "labels": {one.key: one.label for one in data.configurations},
        "glossary": words.GLOSSARY,
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
            charts.append(draw_map(run, read_simspec(run.recording), read_tape(run.recording)))
        except (SetupError, OSError):
            notes.append(f"The recording of {run.realization} cannot be read, so it is not drawn.")
    absent = [run.realization for run in data.runs if run.recording is None and run.outcome and run.outcome.counts]
    if absent:
        more = f" and {len(absent) - 3} more" if len(absent) > 3 else ""
        notes.append(f"No recording is here of {', '.join(absent[:3])}{more}.")
    return charts, notes


class _Figures:
    """The figures of one page under their fixed ids, in the order in which they were added."""

    def __init__(self) -> None:
        self.drawn: list[tuple[str, Markup]] = []

    def add(self, name: str, figure: go.Figure) -> str:
        self.drawn.append((name, data_text(figure.to_plotly_json())))
        return name


@dataclass(frozen=True, slots=True)
class _Comparison:
    id: str
    first: AgentLook
    second: AgentLook
    pairings: tuple[Pairing, ...]
    label: str


def _comparisons(data: ReportData, figures: _Figures) -> list[_Comparison]:
    """The first agent against each of the others."""
    found: list[_Comparison] = []
    shown = looks(data.agents)
    for place, second in enumerate(shown[1:], start=1):
        pairings = pair_agents(data.scores, data.study, shown[0].name, second.name)
        if not any(one.scenes for one in pairings):
            continue
        name = figures.add(f"pairs-{place}", pairs_figure(pairings))
        parts = [
            f"{one.node} {100 * one.mean_confidence_difference:+.0f} points"
            for one in pairings
            if one.mean_confidence_difference is not None
        ]
        label = f"Mean difference in confidence, {second.name} minus {shown[0].name}: {', '.join(parts)}"
        found.append(_Comparison(name, shown[0], second, pairings, label))
    return found


def _outcome_counts(data: ReportData, shown: Sequence[AgentLook]) -> tuple[list[str], list[dict[str, Any]]]:
    order = [outcome.value.replace("_", " ") for outcome in Outcome] + [words.PAST, "not finished"]
    ends = Counter((run.agent, words.outcome_name(run)) for run in data.runs)
    names = [name for name in order if name == "completed" or any(ends[look.name, name] for look in shown)]
    rows = [
        {"look": look, "counts": counts, "all": sum(counts)}
        for look in shown
        if sum(counts := [ends[look.name, name] for name in names])
    ]
    return names, rows


def _studied(data: ReportData, shown: Sequence[AgentLook], trials: AllTrials, figures: _Figures) -> list[dict[str, Any]]:
    """Each node under study: a figure of its pass rates over difficulty, and every agent's numbers in sentences."""
    found = []
    for place, node in enumerate(data.study, start=1):
        tallies = {look.name: tally for look in shown if (tally := data.tally(look.name, node)) is not None}
        flown = {look.name: trials[look.name, node] for look in shown if (look.name, node) in trials}
        agents = [
            {
                "look": look,
                "lines": sentences(tallies.get(look.name), flown.get(look.name, Trials())),
                "remark": curve_remark(flown[look.name].curve()) if look.name in flown else "",
            }
            for look in shown
        ]
        passed = [f"{name}: {one.passes} of {len(one.passed)} runs passed" for name, one in flown.items()]
        found.append(
            {
                "node": node,
                "asks": data.nodes[node].asks if node in data.nodes else "",
                "agents": agents,
                "id": figures.add(f"curve-{place}", curve_figure(shown, flown, tallies)) if flown else "",
                "label": f"Pass rate of {node} over difficulty. {'; '.join(passed)}",
            }
        )
    return found


def _trees(data: ReportData, shown: Sequence[AgentLook], trials: AllTrials) -> list[dict[str, Any]]:
    """For each agent that flew: its branches, one for every root, each with the rows of all that stands under it."""
    if not data.tallies:
        return []
    flown = {run.agent for run in data.runs}
    told = {
        (look.name, name): sentences(data.tally(look.name, name), trials.get((look.name, name), Trials()))
        for look in shown
        for name in data.nodes
    }
    return [
        {
            "look": look,
            "branches": [
                {
                    "node": data.nodes[root],
                    "said": _said(data.tally(look.name, root)),
                    "rows": list(_tree_rows(data, look.name, root, told)),
                }
                for root in data.roots
            ],
            "method": _methods(data, look.name),
        }
        for look in shown
        if look.name in flown
    ]


def _said(tally: Tally | None) -> str:
    if tally is None or not tally.considered:
        return "never considered"
    return f"score {words.score(tally.score)}{' †' if tally.raised else ''}, confidence {words.percent(tally.confidence)}"


def _methods(data: ReportData, agent: str) -> str:
    used = sorted({tally.method for (who, where, _), tally in data.tallies.items() if (who, where) == (agent, ALL)})
    named = [words.METHODS.get(one, one) for one in used if one != words.NO_INTERVAL]
    return f"Intervals of confidence: {words.listed(named)}." if named else ""


def _tree_rows(data: ReportData, agent: str, root: str, told: Mapping[tuple[str, str], list[str]]) -> Iterator[dict[str, Any]]:
    parents: dict[str, list[str]] = {}
    for node in data.nodes.values():
        for child in node.children:
            parents.setdefault(child, []).append(node.id)

    def below(name: str, depth: int, parent: str) -> Iterator[dict[str, Any]]:
        node = data.nodes[name]
        yield {
            "node": node,
            "depth": depth,
            "folds": bool(node.children),
            "studied": name in data.study,
            "also": words.listed([one for one in parents.get(name, []) if one != parent]),
            "tally": data.tally(agent, name),
            "lines": told[agent, name],
        }
        for child in node.children:
            yield from below(child, min(depth + 1, 3), name)

    yield from below(root, 0, "")


def _panels(data: ReportData, shown: Sequence[AgentLook], figures: _Figures) -> list[dict[str, Any]]:
    panels = []
    for place, configuration in enumerate(data.configurations, start=1):
        rows = [
            (look, tally)
            for node in data.study
            for look in shown
            if (tally := data.tally(look.name, node, configuration.key)) is not None
        ]
        panels.append(
            {
                "id": figures.add(f"configuration-{place}", configuration_figure(data, configuration)),
                "configuration": configuration,
                "levels": factor_levels(configuration),
                "rows": rows,
                "label": _panel_label(configuration.label, [tally for _, tally in rows]),
            }
        )
    return panels


def _panel_label(name: str, tallies: Iterable[Tally]) -> str:
    said = [
        f"{one.node}, {one.agent}: difficulty {words.span(one.difficulty_low, one.difficulty_high)}, score {words.score(one.score)}, "
        f"confidence {words.percent(one.confidence)}"
        for one in tallies
    ]
    return f"Configuration {name}. {'; '.join(said)}"


def _map(chart: RunMap, place: int, figures: _Figures) -> dict[str, Any]:
    run: Run = chart.run
    marked = sum(report.mark for report in chart.reports)
    forbidden = sum(report.forbidden for report in chart.reports)
    title = f"{run.agent} · {run.design_point}, replicate {run.replicate} · {words.outcome_name(run)}"
    label = (
        f"Map of {run.realization}: {words.plural(len(chart.reports), 'report')}, {marked} marked, "
        f"{forbidden} of them with a bystander within {chart.no_mark_within_m:g} m; {len(chart.actors)} actors"
    )
    return {
        "box": f"map-{place}-box",
        "id": figures.add(f"map-{place}", map_figure(chart)),
        "chart": chart,
        "title": title,
        "label": label,
        "decisions": chart.decisions[:DECISION_ROWS],
        "decisions_said": words.plural(len(chart.decisions), "line")
        + (f", the first {DECISION_ROWS} shown" if len(chart.decisions) > DECISION_ROWS else ""),
    }


def _flattened(value: object, name: str = "") -> Iterator[tuple[str, str]]:
    """Nested values as dotted names and texts."""
    if isinstance(value, Mapping):
        for key in value:
            yield from _flattened(value[key], f"{name}.{key}" if name else str(key))
    elif isinstance(value, list):
        for place, one in enumerate(value):
            yield from _flattened(one, f"{name}[{place}]")
    else:
        yield name, "" if value is None else str(value)


def _environment() -> jinja2.Environment:
    found = environment()
    found.globals.update(
        number=words.number,
        percent=words.percent,
        score=words.score,
        interval=words.interval,
        span=words.span,
        p_value=words.p_value,
        outcome_name=words.outcome_name,
        outcome_text=words.outcome_text,
        extremes=words.extremes,
    )
    return found
