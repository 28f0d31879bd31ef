"""The share of variance that each factor explains."""

from __future__ import annotations

from markupsafe import Markup

from ..statistics._factor_effects import SIGNIFICANCE_LEVEL, FactorEffects
from ._svg import Plot


def factor_effects_figure(effects: FactorEffects) -> Markup:
    """A disc for each node, agent and main effect: its area is the share of the variance of confidence, dark if significant.

    Empty where there is no share to draw.
    """
    tables = [
        table for table in effects.tables if any(row.confidence_share is not None for row in table.rows)
    ]
    # Interactions (`a x b`) are many; the table lists those that are significant.
    factors = list(
        dict.fromkeys(row.factor for table in tables for row in table.rows if " x " not in row.factor)
    )
    if not factors:
        return Markup("")
    label = (
        "Share of the variance of confidence that each factor explains; the numbers are in the table below"
    )
    rows = len(tables)
    plot = Plot(label, 960, 50 + 34 * rows, (-0.6, len(factors) - 0.4), (rows - 0.4, -0.6), (260, 24, 8, 30))
    plot.x_axis([(place, factor) for place, factor in enumerate(factors)])
    plot.y_axis([(place, f"{table.node} {table.agent}") for place, table in enumerate(tables)])
    for place, table in enumerate(tables):
        for row in table.rows:
            if row.factor not in factors or row.confidence_share is None:
                continue
            # The p value is the adjusted one. The root makes the area proportional to the share; 3 px keep a share of 0 visible.
            is_significant = row.confidence_p is not None and row.confidence_p < SIGNIFICANCE_LEVEL
            size = 3.0 + 27.0 * max(0.0, row.confidence_share) ** 0.5
            title = f"{row.factor}: {100 * row.confidence_share:.1f} % of the variance of confidence"
            fill = "var(--accent)" if is_significant else "var(--bar)"
            plot.mark("circle", (factors.index(row.factor), place), size, "var(--bar-edge)", title, fill=fill)
    return plot.markup()
