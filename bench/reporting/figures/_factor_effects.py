"""The share of variance that each factor explains."""

from __future__ import annotations

from html import escape

import plotly.graph_objects as go

from ..statistics._factor_effects import SIGNIFICANCE_LEVEL, FactorEffects


def factor_effects_figure(effects: FactorEffects) -> go.Figure:
    """A disc for each node, agent and main effect: its area is the share of the variance of confidence, dark
    if significant.
    """
    rows = [table for table in effects.tables if any(row.confidence_share is not None for row in table.rows)]
    # Interactions (`a x b`) are many; the table lists those that are significant.
    factors = list(
        dict.fromkeys(row.factor for table in rows for row in table.rows if " x " not in row.factor)
    )
    discs = [
        (factors.index(row.factor), place, row.confidence_share, row.confidence_p)
        for place, table in enumerate(rows)
        for row in table.rows
        if row.factor in factors and row.confidence_share is not None
    ]
    figure = go.Figure(
        layout={
            "template": go.layout.Template(),
            "height": 90 + 34 * max(1, len(rows)),
            "margin": {"l": 260, "r": 24, "t": 10, "b": 46},
            "paper_bgcolor": "var(--paper)",
            "plot_bgcolor": "var(--paper)",
            "font": {"family": "system-ui, sans-serif", "size": 12, "color": "var(--ink)"},
            "showlegend": False,
        }
    )
    figure.add_scatter(
        x=[x for x, *_ in discs],
        y=[y for _, y, *_ in discs],
        mode="markers",
        marker={
            "symbol": "circle",
            # The root makes the area proportional to the share; 3 px keep a share of 0 visible.
            "size": [3.0 + 27.0 * share**0.5 for *_, share, _ in discs],
            # Dark for a significant effect. The p value is the adjusted one.
            "color": [
                "var(--accent)" if p is not None and p < SIGNIFICANCE_LEVEL else "var(--bar)"
                for *_, p in discs
            ],
            "line": {"color": "var(--bar-edge)", "width": 1},
        },
        hovertext=[
            f"{factors[x]}: {100 * share:.1f} % of the variance of confidence" for x, _, share, _ in discs
        ],
        hoverinfo="text",
    )
    axis = {"showgrid": True, "gridcolor": "var(--grid)", "zeroline": False, "fixedrange": True}
    figure.update_layout(
        xaxis={
            **axis,
            "tickvals": list(range(len(factors))),
            "ticktext": factors,
            "range": [-0.6, len(factors) - 0.4],
        },
        yaxis={
            **axis,
            "tickvals": list(range(len(rows))),
            "ticktext": [escape(f"{table.node} {table.agent}") for table in rows],
            # From high to low, so that the first row is at the top, as in the table.
            "range": [len(rows) - 0.4, -0.6],
        },
    )
    return figure
