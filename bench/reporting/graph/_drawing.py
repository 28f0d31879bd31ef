"""A decomposition as a drawing and as a page, coloured by the results of one agent in a campaign."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, Literal

from markupsafe import Markup

from bench.errors import SetupError
from decompositions import Decomposition, KeyFactor, Level

from .._campaign_data import ReportData, Tally
from .._html import (
    content_security_policy,
    json_script_text,
    normalized_script,
    template_environment,
    template_text,
)
from ..statistics._trials import NodeTrials, trials_of
from ..text._format import listed, plural
from ..text._node_sentences import node_sentences
from ._layout import lay_out

Measurement = Literal["confidence", "score", "competence"]
MEASUREMENT_NAMES: dict[Measurement, str] = {
    "confidence": "Confidence",
    "score": "ARL score",
    "competence": "Competence 50",
}
LEVELS = {
    Level.PRINCIPLE: ("Principle", "Principles"),
    Level.KEY_ATTRIBUTE: ("Key attribute", "Key attributes"),
    Level.VAB: ("Behaviour", "Behaviours"),
    Level.OBSERVABLE: ("Observable", "Observables"),
}
UNSCORED, UNCONSIDERED, ABSENT = "unscored", "unconsidered", "absent"
STATES = {
    UNSCORED: "not scored: nothing achieved",
    UNCONSIDERED: "never considered",
    ABSENT: "not in this campaign",
}
# graph.css and graph_svg.css have the classes s0 to s9.
COLOUR_STEPS = 10

ROW_PX, BOX_PX, COLUMN_PX, WIDTH_PX, TOP_PX, EDGE_PX = 36, 30, 372, 306, 108, 24
# What fits into a box of 306 px at a font size of 11 px, without and with the number of the node.
MAX_TITLE_CHARACTERS = 46
NUMBER_CHARACTERS = 7


@dataclass(frozen=True, slots=True)
class NodeColour:
    """How one node is coloured: `step` 0 to 9 of the scale or one of STATES, and the number that it stands for."""

    step: str
    text: str


def graph_svg(
    decomposition: Decomposition,
    data: ReportData | None = None,
    agent: str | None = None,
    by: Measurement = "confidence",
) -> str:
    """The whole decomposition as an SVG file; the same input gives the same bytes.

    Raises SetupError for an agent that the campaign does not have.
    """
    flown = _agent(data, agent)
    laid = lay_out(decomposition)
    place = {
        name: (EDGE_PX + laid.column[name] * COLUMN_PX, round(TOP_PX + laid.row[name] * ROW_PX, 1))
        for name in decomposition.nodes
    }
    coloured = (
        {name: colour(data.tally(flown, name), by) for name in decomposition.nodes}
        if data is not None
        else {}
    )
    context = {
        "decomposition": decomposition,
        "width": 2 * EDGE_PX + (len(laid.columns) - 1) * COLUMN_PX + WIDTH_PX,
        "height": round(TOP_PX + laid.rows * ROW_PX + EDGE_PX),
        "heads": [
            (EDGE_PX + at * COLUMN_PX, f"{LEVELS[level][1]} ({len(decomposition.at_level(level))})")
            for at, level in enumerate(laid.columns)
        ],
        "edges": [
            # First edges before the dashed ones, and all of them before the boxes: SVG paints in this order.
            (edge, _curve(place[edge.parent], place[edge.child]))
            for edge in sorted(laid.edges, key=lambda edge: not edge.first)
        ],
        "nodes": [
            {
                "node": node,
                "x": place[name][0],
                "y": place[name][1],
                # SVG does not wrap text; the tooltip has the whole title.
                "short": _short(
                    node.title, MAX_TITLE_CHARACTERS - (NUMBER_CHARACTERS if data is not None else 0)
                ),
                "studied": name in decomposition.document.study,
                "also": f"{parents} parents" if (parents := len(decomposition.parents[name])) > 1 else "",
                "coloured": coloured.get(name),
            }
            for name, node in decomposition.nodes.items()
        ],
        "box_width": WIDTH_PX,
        "box_height": BOX_PX,
        "legend": f"{MEASUREMENT_NAMES[by]} of {flown}" if data is not None else "",
        "campaign": data.name if data is not None else "",
        "states": STATES,
        "steps": range(COLOUR_STEPS),
        "raised": by == "score" and any(shade.text.endswith("†") for shade in coloured.values()),
        "many": sum(not edge.first for edge in laid.edges),
        "css": Markup(template_text("graph_svg.css")),
    }
    return template_environment().get_template("graph.svg.j2").render(context) + "\n"


def graph_page(
    decomposition: Decomposition,
    data: ReportData | None = None,
    agent: str | None = None,
    by: Measurement = "confidence",
) -> str:
    """The decomposition as one HTML file that fetches nothing; the same input gives the same bytes.

    Every agent of the campaign can be chosen in it; `agent` is shown first. Raises SetupError for one that
    there is not.
    """
    script = normalized_script(template_text("graph.js"))
    document = {
        "nodes": [_described(decomposition, name) for name in decomposition.nodes],
        "levels": [LEVELS[level][1] for level in lay_out(decomposition).columns],
        "states": STATES,
        "measured": [[key, name] for key, name in MEASUREMENT_NAMES.items()] if data is not None else [],
        "by": by,
        "agents": list(data.agents) if data is not None else [],
        "agent": _agent(data, agent),
        "shown": _shown(decomposition, data) if data is not None else {},
    }
    context = {
        "decomposition": decomposition,
        "counts": ", ".join(
            plural(len(decomposition.at_level(level)), LEVELS[level][0].lower(), LEVELS[level][1].lower())
            for level in Level
            if decomposition.at_level(level)
        ),
        "data": data,
        "notes": _notes(decomposition, data) if data is not None else [],
        "states": STATES,
        "steps": range(COLOUR_STEPS),
        "css": Markup(template_text("graph.css")),
        "script": Markup(script),
        "policy": content_security_policy(script),
        "document": json_script_text(document),
        "svg": Markup(graph_svg(decomposition, data, agent, by)),
        "version": version("rebar-bench"),
    }
    return template_environment().get_template("graph.html.j2").render(context)


def colour(tally: Tally | None, by: Measurement) -> NodeColour:
    """The colour of a node on the scale.

    A node without a number has a state, which must not look like a low number.
    """
    if tally is None:
        return NodeColour(ABSENT, "–")
    if not tally.considered:
        return NodeColour(UNCONSIDERED, "–")
    if by == "confidence":
        # A considered node always has a confidence; only scores can be missing.
        assert tally.confidence is not None
        return NodeColour(_step(100.0 * tally.confidence), f"{100.0 * tally.confidence:.0f} %")
    if by == "competence":
        competence = tally.competence.get("50")
        if competence is None:
            return NodeColour(ABSENT, "–")
        mark = "≥ " if competence.at_least else ""
        return NodeColour(_step(competence.value), f"{mark}{competence.value:.0f}")
    if tally.score is None:
        return NodeColour(UNSCORED, "none")
    return NodeColour(_step(tally.score), f"{tally.score:.0f}{' †' if tally.raised else ''}")


def _step(value: float) -> str:
    # Scores may exceed 100 or fall below 0 (docs/rulings.md 7 and 8), but the scale ends there.
    return str(min(COLOUR_STEPS - 1, max(0, int(value * COLOUR_STEPS / 100.0))))


def _agent(data: ReportData | None, agent: str | None) -> str:
    if data is None:
        return ""
    if agent is not None and agent not in data.agents:
        raise SetupError(
            "--agent", f"{agent!r} did not fly in {data.name}", f"agents: {', '.join(data.agents) or 'none'}"
        )
    if not data.agents:
        raise SetupError("--campaign", f"{data.name} has no agents", "draw the decomposition without it")
    return agent or data.agents[0]


def _notes(decomposition: Decomposition, data: ReportData) -> Iterator[str]:
    yield from data.notes
    # None: the decomposition of the campaign could not be read, which has a note already.
    if data.decomposition_sha256 not in (None, decomposition.digest):
        yield f"{data.name} was scored with another decomposition than this one: numbers are matched only by the ids of nodes."
    if absent := sum(name not in data.nodes for name in decomposition.nodes):
        yield f"{plural(absent, 'node is', 'nodes are')} not in this campaign."


def _curve(parent: tuple[float, float], child: tuple[float, float]) -> str:
    """From the right edge of the parent to the left edge of the child."""
    # Both control points are half way, so that the curve leaves and arrives horizontally.
    start, end = parent[0] + WIDTH_PX, child[0]
    middle = (start + end) / 2
    from_y, to_y = (round(y + BOX_PX / 2, 1) for y in (parent[1], child[1]))
    return f"M{start:g} {from_y:g}C{middle:g} {from_y:g} {middle:g} {to_y:g} {end:g} {to_y:g}"


def _short(title: str, max_characters: int) -> str:
    return title if len(title) <= max_characters else f"{title[: max_characters - 1].rstrip()}…"


def _described(decomposition: Decomposition, name: str) -> dict[str, Any]:
    """One node with everything that its document says about it, for the script of the page."""
    node = decomposition.nodes[name]
    return {
        "id": name,
        "level": LEVELS[node.level][0],
        "title": node.title,
        "asks": node.asks,
        "children": list(node.children),
        "studied": name in decomposition.document.study,
        "facts": list(_facts(decomposition, name)),
        "tables": [_table(row) for row in decomposition.key_factors(name)]
        if node.level is Level.OBSERVABLE
        else [],
    }


def _facts(decomposition: Decomposition, name: str) -> Iterator[tuple[str, str]]:
    if decomposition.level_of(name) is not Level.OBSERVABLE:
        under = decomposition.observables_under(name)
        factors = dict.fromkeys(
            row.factor for observable in under for row in decomposition.key_factors(observable)
        )
        yield "Observables under it", str(len(under))
        yield "Key factors", listed(list(factors)) or "none"
        return
    observable = decomposition.observables[name]
    yield "Measure", observable.measure or "none: values are given with the runs"
    if observable.options:
        yield "Options", ", ".join(f"{key} = {_plain(value)}" for key, value in observable.options.items())
    yield "Threshold", f"{observable.threshold:g}. {observable.threshold_reason or ''}".rstrip()
    yield "Partial credit", "yes" if observable.partial_credit else "no"
    if decomposition.near_miss(name):
        yield "Near miss", f"{decomposition.near_miss(name):g} below the threshold still scores"
    yield (
        "Considered",
        observable.considered + (" It applies in every run." if observable.always_considered else ""),
    )


def _plain(value: bool | float | str) -> str:
    # Booleans as YAML writes them, because options are read in a YAML document.
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _table(row: KeyFactor) -> dict[str, Any]:
    unit = "" if row.unit == "1" else f", {row.unit}"
    return {
        "name": f"{row.factor}{unit}",
        "interpolation": "Steps from column to column" if row.mapping == "step" else "Linear between columns",
        "ratings": [f"{rating:g}" for rating in row.ratings],
        "values": [f"{value:g}" for value in row.values],
        "reason": row.reason,
    }


def _shown(decomposition: Decomposition, data: ReportData) -> dict[str, dict[str, Any]]:
    """By agent and node: the colour for each measurement, and the sentences; only nodes that the campaign has."""
    trials = trials_of(data.scores)
    return {
        agent: {
            name: {
                **{
                    key: [shade.step, shade.text]
                    for key in MEASUREMENT_NAMES
                    for shade in [colour(tally, key)]
                },
                "sentences": node_sentences(tally, trials.get((agent, name), NodeTrials())),
            }
            for name in decomposition.nodes
            if (tally := data.tally(agent, name)) is not None
        }
        for agent in data.agents
    }
