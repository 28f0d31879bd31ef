"""The sections of the page, as values for its template."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from bench.contracts import Outcome

from ._campaign_data import ALL_CONFIGURATIONS, ReportData, Run, Tally
from .figures._configuration import configuration_figure
from .figures._map import MAX_RINGED_REPORTS, labelled_reports, map_figure
from .figures._pairings import pairings_figure
from .figures._pass_rates import curve_figure
from .figures._style import AgentStyle, agent_styles
from .map._run_map import MESSAGE_ROWS, RunMap
from .statistics._agent_comparison import Comparison, compare_agents
from .statistics._pairings import Pairing, pair_agents
from .statistics._sensor import only_about_sensor
from .statistics._trials import AllTrials, NodeTrials
from .text._campaign_facts import factor_levels
from .text._format import listed, passed_runs, percent, plural, score, span, verdict
from .text._glossary import METHODS, NO_INTERVAL
from .text._node_sentences import curve_remark, node_sentences
from .text._outcomes import AFTER_STOP, outcome_name


@dataclass(frozen=True, slots=True)
class AgentPair:
    first: AgentStyle
    second: AgentStyle
    comparison: Comparison
    pairings: Mapping[str, Pairing]
    figure: Markup


def agent_pairs(data: ReportData) -> list[AgentPair]:
    """The first agent against each of the others that flew a scene with it."""
    # Not all pairs: n agents would give n (n - 1) / 2 figures, and `rebar compare` compares any two.
    pairs: list[AgentPair] = []
    shown = agent_styles(data.agents)
    for second in shown[1:]:
        pairings = pair_agents(data.scores, data.study, shown[0].name, second.name)
        if not any(pairing.scenes for pairing in pairings):
            continue
        parts = [
            f"{pairing.node} {100 * pairing.mean_confidence_difference:+.0f} points"
            for pairing in pairings
            if pairing.mean_confidence_difference is not None
        ]
        label = f"Mean difference in confidence, {second.name} minus {shown[0].name}: {', '.join(parts)}"
        comparison = compare_agents(data, shown[0].name, second.name)
        by_node = {pairing.node: pairing for pairing in pairings}
        figure = pairings_figure(pairings, label)
        pairs.append(AgentPair(shown[0], second, comparison, by_node, figure))
    return pairs


def outcome_counts(data: ReportData, shown: Sequence[AgentStyle]) -> tuple[list[str], list[dict[str, Any]]]:
    order = [outcome.value.replace("_", " ") for outcome in Outcome] + [AFTER_STOP, "not finished"]
    ends = Counter((run.agent, outcome_name(run)) for run in data.runs)
    # Outcomes that did not occur have no column, except `completed`: that nothing completed should be
    # visible.
    names = [name for name in order if name == "completed" or any(ends[style.name, name] for style in shown)]
    rows = [
        {"style": style, "counts": counts, "all": sum(counts)}
        for style in shown
        if sum(counts := [ends[style.name, name] for name in names])
    ]
    return names, rows


def studied_nodes(data: ReportData, shown: Sequence[AgentStyle], trials: AllTrials) -> list[dict[str, Any]]:
    """Each node under study: a figure of its pass rates over difficulty, and every agent's numbers in sentences."""
    sections = []
    for node in data.study:
        tallies = {
            style.name: tally for style in shown if (tally := data.tally(style.name, node)) is not None
        }
        flown = {style.name: trials[style.name, node] for style in shown if (style.name, node) in trials}
        agents = [
            {
                "style": style,
                "lines": node_sentences(tallies.get(style.name), flown.get(style.name, NodeTrials())),
                "remark": curve_remark(flown[style.name].curve()) if style.name in flown else "",
            }
            for style in shown
        ]
        passed = [f"{name} passed {passed_runs(tallies[name])}" for name in flown]
        sections.append(
            {
                "node": node,
                "asks": data.nodes[node].asks if node in data.nodes else "",
                "agents": agents,
                "figure": curve_figure(
                    shown, flown, tallies, f"Pass rate of {node} over difficulty. {'; '.join(passed)}"
                ).markup()
                if flown
                else "",
            }
        )
    return sections


def node_trees(data: ReportData, shown: Sequence[AgentStyle]) -> list[dict[str, Any]]:
    """For each agent that flew: one branch for every root, with the rows of all nodes under it."""
    if not data.tallies:
        return []
    flown = {run.agent for run in data.runs}
    about_sensor = only_about_sensor(data.scores)
    return [
        {
            "style": style,
            "branches": [
                {
                    "node": data.nodes[root],
                    "summary": _branch_summary(data.tally(style.name, root)),
                    "rows": list(_tree_rows(data, style.name, root, about_sensor)),
                }
                for root in data.roots
            ],
            "method": _methods(data, style.name),
        }
        for style in shown
        if style.name in flown
    ]


def _branch_summary(tally: Tally | None) -> str:
    if tally is None or not tally.considered:
        return "never considered"
    return f"{verdict(tally)}; score {score(tally.score)}{' †' if tally.raised else ''}"


def _methods(data: ReportData, agent: str) -> str:
    used = sorted(
        {
            tally.method
            for (who, where, _), tally in data.tallies.items()
            if (who, where) == (agent, ALL_CONFIGURATIONS)
        }
    )
    named = [METHODS.get(method, method) for method in used if method != NO_INTERVAL]
    return f"Intervals of confidence: {listed(named)}." if named else ""


def _tree_rows(
    data: ReportData, agent: str, root: str, about_sensor: Collection[tuple[str, str]]
) -> Iterator[dict[str, Any]]:
    # A node may have several parents (docs/rulings.md 12). It has a row under each, and every row names the
    # others.
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
            "also": listed([other for other in parents.get(name, []) if other != parent]),
            "tally": data.tally(agent, name),
            "about_sensor": (agent, name) in about_sensor,
        }
        for child in node.children:
            yield from below(child, min(depth + 1, 3), name)

    yield from below(root, 0, "")


def configuration_panels(data: ReportData, shown: Sequence[AgentStyle]) -> list[dict[str, Any]]:
    panels = []
    for configuration in data.configurations:
        rows = [
            (style, tally)
            for node in data.study
            for style in shown
            if (tally := data.tally(style.name, node, configuration.key)) is not None
        ]
        panels.append(
            {
                "configuration": configuration,
                "levels": factor_levels(configuration),
                "rows": rows,
                "figure": configuration_figure(
                    data, configuration, _panel_label(configuration.label, [tally for _, tally in rows])
                ).markup(),
            }
        )
    return panels


def _panel_label(name: str, tallies: Iterable[Tally]) -> str:
    parts = [
        f"{tally.node}, {tally.agent}: difficulty {span(tally.difficulty_low, tally.difficulty_high)}, score {score(tally.score)}, "
        f"confidence {percent(tally.confidence)}"
        for tally in tallies
    ]
    return f"Configuration {name}. {'; '.join(parts)}"


def map_section(chart: RunMap, place: int) -> dict[str, Any]:
    run: Run = chart.run
    reports, consents = chart.reports, chart.consents
    title = f"{run.agent} · {run.design_point}, replicate {run.replicate} · {outcome_name(run)}"
    label = (
        f"Map of {run.realization}: {plural(reports.count, 'report')}, {reports.marked} marked, "
        f"{reports.forbidden} of them with a bystander within {chart.no_mark_within_m:g} m; {len(chart.actors)} actors"
    )
    if consents.count:
        label += f"; {plural(consents.count, 'request')} for consent, {consents.granted} granted"
    return {
        "box": f"map-{place}-box",
        "figure": map_figure(chart, label),
        "chart": chart,
        "title": title,
        "reports": reports.drawn[:MESSAGE_ROWS],
        "reports_text": _all_or_first(reports.count, len(reports.drawn), "report")
        + (f"; {reports.forbidden} marked against the rule" if reports.forbidden else ""),
        "ringed_text": _drawn_text(chart),
        "consents": consents.drawn[:MESSAGE_ROWS],
        "consents_text": _all_or_first(consents.count, len(consents.drawn), "request"),
        "decisions": chart.decisions,
        "decisions_text": _all_or_first(chart.decision_count, chart.decision_count, "line")
        + _actions_text(chart),
    }


def _drawn_text(chart: RunMap) -> str:
    """What of the messages of a run the map does not show; empty where it shows all."""
    reports, consents, sentences = chart.reports, chart.consents, []
    if reports.count > len(reports.drawn):
        sentences.append(
            f"{reports.count - len(reports.drawn)} of the {reports.count} reports are not drawn. Drawn are the first and "
            "last about each adversary, marks against the rule, the first and last at each place, and others evenly "
            "over the run."
        )
    if consents.count > len(consents.drawn):
        sentences.append(
            f"{consents.count - len(consents.drawn)} of the {consents.count} requests for consent are not drawn."
        )
    if len(reports.drawn) > MAX_RINGED_REPORTS:
        sentences.append(
            f"Rings are drawn for {MAX_RINGED_REPORTS} of the {len(reports.drawn)} reports, marks "
            "against the rule first; every report has its cross."
            if reports.count == len(reports.drawn)
            else f"Rings are drawn for {MAX_RINGED_REPORTS}, marks against the rule first."
        )
    ringed, labelled = min(len(reports.drawn), MAX_RINGED_REPORTS), len(labelled_reports(chart))
    if labelled < ringed:
        sentences.append(f"Labels are drawn for {labelled} reports that do not hide each other.")
    return " ".join(sentences)


def _all_or_first(count: int, drawn: int, noun: str) -> str:
    """How many messages there are, and which of them a table shows."""
    if count > drawn:
        return f"{plural(count, noun)}, {drawn} of them drawn, the first {MESSAGE_ROWS} of these shown"
    return plural(count, noun) + (f", the first {MESSAGE_ROWS} shown" if count > MESSAGE_ROWS else "")


def _actions_text(chart: RunMap) -> str:
    """The most frequent actions of a log that is longer than its table; empty for any other."""
    if chart.decision_count <= len(chart.decisions):
        return ""
    return f"; most often {listed([f'{action} ({count})' for action, count in chart.frequent_actions])}"
