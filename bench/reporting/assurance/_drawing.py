"""An assurance case as a drawing: a column for each step of the argument, contexts below what stands in them."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from functools import cached_property

from markupsafe import Markup

from .._html import template_environment, template_text
from ._case import AssuranceCase, Element, Kind

BOX_PX, COLUMN_PX, GAP_PX, TOP_PX, EDGE_PX, LINE_PX = 236, 292, 18, 76, 24, 13
INDENT_PX, SOLUTION_PX, DIAMOND_PX = 24, 92, 14
# What fits into a line of a shape at a font size of 11 px, and its most lines; the tooltip has all of the text.
CHARACTERS: dict[Kind, int] = {
    "goal": 36, "strategy": 32, "solution": 14, "context": 28, "assumption": 28, "justification": 28,
}  # fmt: skip
MAX_LINES = 7


def assurance_svg(case: AssuranceCase) -> str:
    """The case as an SVG file that needs no page around it; the same case gives the same bytes."""
    # Imported here: every report imports this module, and few draw a case.
    import networkx as nx

    boxes = {element.id: _Box(element) for element in case.elements}
    support = nx.DiGraph((parent.id, child) for parent in case.elements for child in parent.supported_by)
    for name in nx.topological_sort(support):
        for child in support[name]:
            boxes[child].column = max(boxes[child].column, boxes[name].column + 1)
    _place(case.elements[0].id, boxes, {})
    context = {
        "case": case,
        "width": max(box.x + box.width for box in boxes.values()) + EDGE_PX,
        "height": round(max(box.y + box.height for box in boxes.values()) + 2 * EDGE_PX),
        "boxes": boxes.values(),
        "supports": [_curve(boxes[parent], boxes[child]) for parent, child in support.edges],
        "contexts": [
            (owner, boxes[name]) for owner in boxes.values() for name in owner.element.in_context_of
        ],
        "indent": INDENT_PX,
        "css": Markup(template_text("graph_svg.css")),
    }
    return template_environment().get_template("assurance.svg.j2").render(context) + "\n"


@dataclass
class _Box:
    """The shape of an element: its column, the pixel of its top, and how it is drawn."""

    element: Element
    column: int = 0
    y: float = field(default=-1.0)

    @cached_property
    def lines(self) -> list[str]:
        return textwrap.wrap(
            self.element.text, CHARACTERS[self.element.kind], max_lines=MAX_LINES, placeholder=" …"
        )

    @property
    def is_oval(self) -> bool:
        return self.element.kind in ("assumption", "justification")

    @property
    def indent(self) -> int:
        return INDENT_PX if self.is_oval or self.element.kind == "context" else 0

    @property
    def x(self) -> int:
        return EDGE_PX + self.column * COLUMN_PX + self.indent

    @property
    def width(self) -> int:
        return SOLUTION_PX if self.element.kind == "solution" else BOX_PX - self.indent

    @property
    def height(self) -> int:
        if self.element.kind == "solution":
            return SOLUTION_PX
        # Ovals have less room at their ends.
        return LINE_PX * (len(self.lines) + 1) + (30 if self.is_oval else 14)


def _place(name: str, boxes: dict[str, _Box], ends: dict[int, float]) -> None:
    """Place an element beside the first of what is placed as its support, and its contexts below it."""
    box = boxes[name]
    first_y = 0.0
    for child in box.element.supported_by:
        if boxes[child].y < 0.0:
            _place(child, boxes, ends)
            first_y = first_y or boxes[child].y
    box.y = max(ends.get(box.column, TOP_PX), first_y)
    end = box.y + box.height + GAP_PX + (DIAMOND_PX if box.element.undeveloped else 0)
    for context in (boxes[context] for context in box.element.in_context_of):
        context.column, context.y = box.column, end
        end += context.height + GAP_PX
    ends[box.column] = end


def _curve(parent: _Box, child: _Box) -> str:
    x, y = parent.x + parent.width, parent.y + parent.height / 2
    end_x, end_y = child.x - 7, child.y + child.height / 2
    middle = (x + end_x) / 2
    return f"M{x:g} {y:g}C{middle:g} {y:g} {middle:g} {end_y:g} {end_x:g} {end_y:g}"
