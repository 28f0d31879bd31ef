"""How every figure looks: the style of each agent and the empty figure.

Colours are CSS variables (`var(--agent-1)`), which the page resolves for light, dark and print. No figure
relies on colour alone: agents also differ in letter, marker and hatching, roles in marker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import plotly.graph_objects as go

# As many markers and hatchings as colours, so that an agent keeps one combination.
MARKERS = ("circle", "square", "diamond", "triangle-up", "cross", "hexagon")
HATCHES = ("", "/", "x", ".", "-", "|")

# templates/report.css defines --agent-1 to --agent-6 and their soft variants.
PALETTE_SIZE = 6


@dataclass(frozen=True, slots=True)
class AgentStyle:
    """How one agent looks in every figure and in the key beside it."""

    name: str
    letter: str
    colour: str
    fill: str
    marker: str
    hatch: str


def agent_styles(agents: Sequence[str]) -> tuple[AgentStyle, ...]:
    """A style for each agent, by its position.

    From the seventh on, colours repeat, and the letter makes the difference.
    """
    return tuple(
        AgentStyle(
            name=name,
            letter=chr(ord("A") + place % 26),
            colour=f"var(--agent-{place % PALETTE_SIZE + 1})",
            fill=f"var(--agent-{place % PALETTE_SIZE + 1}-soft)",
            marker=MARKERS[place % len(MARKERS)],
            hatch=HATCHES[place % len(HATCHES)],
        )
        for place, name in enumerate(agents)
    )


def empty_figure(height: int, margin: dict[str, int]) -> go.Figure:
    """An empty figure in the style of the page."""
    return go.Figure(
        layout={
            # Empty: the default template of Plotly has fixed colours, which would not follow the theme of the
            # page.
            "template": go.layout.Template(),
            "height": height,
            "margin": margin,
            "paper_bgcolor": "var(--paper)",
            "plot_bgcolor": "var(--paper)",
            "font": {"family": "system-ui, sans-serif", "size": 12, "color": "var(--ink)"},
            "hoverlabel": {
                "bgcolor": "var(--paper)",
                "bordercolor": "var(--line)",
                "font": {"color": "var(--ink)"},
            },
        }
    )
