"""Figures of the report as files of their own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from .._campaign_data import ReportData
from ..statistics._trials import trials_of
from ._configuration import configuration_figure
from ._pass_rates import curve_figure
from ._style import AgentStyle, agent_styles, file_style
from ._svg import Plot


def figure_files(data: ReportData) -> Iterator[tuple[str, str]]:
    """Names and texts of SVG files: the pass rates of each node under study over difficulty, and scores and confidences of
    each difficulty configuration.
    """
    shown, trials = agent_styles(data.agents), trials_of(data.scores)
    for node in data.study:
        flown = {style.name: trials[style.name, node] for style in shown if (style.name, node) in trials}
        tallies = {name: tally for name in flown if (tally := data.tally(name, node)) is not None}
        if flown:
            plot = curve_figure(shown, flown, tallies, f"Pass rate of {node} over difficulty")
            yield f"pass-rates-{node}.svg", _with_key(plot, shown)
    for configuration in data.configurations:
        plot = configuration_figure(data, configuration, f"Configuration {configuration.label}")
        yield f"configuration-{configuration.label}.svg", _with_key(plot, shown)


def _with_key(plot: Plot, shown: Sequence[AgentStyle]) -> str:
    # In the report the key stands beside all figures.
    for style in shown:
        plot.explain(style.marker, style.colour, f"{style.letter} {style.name}", fill=style.fill)
    return plot.file(file_style())
