"""How each agent looks in every figure.

Colours are CSS variables (`var(--agent-1)`), for light, dark and print. No figure relies on colour alone: agents also
differ in letter and marker, roles in marker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .._html import template_text

# As many markers as colours, so that an agent keeps one combination.
MARKERS = ("circle", "square", "diamond", "triangle-up", "cross", "hexagon")

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
        )
        for place, name in enumerate(agents)
    )


def file_style() -> str:
    """The CSS of a drawing without a page: the colours of the report, light and dark."""
    page = template_text("report.css")
    light = page[page.index("{") + 1 : page.index("}")]
    dark = page[page.index("{", page.index("}")) + 1 : page.index("}", page.index("}") + 1)]
    return (
        f":root{{{light}}}@media (prefers-color-scheme: dark){{:root{{{dark}}}}}"
        'text{font:11px system-ui,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}'
    )
