"""The pass rate of one node over difficulty."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from bench.statistics import Curve, CurveState

from .._campaign_data import Tally
from ..statistics._trials import NodeTrials
from ._style import AgentStyle
from ._svg import Plot, round_ticks


def curve_figure(
    shown: Sequence[AgentStyle],
    trials: Mapping[str, NodeTrials],
    tallies: Mapping[str, Tally],
    label: str = "",
) -> Plot:
    """One node's pass rate over difficulty: a disc for each difficulty flown, the logistic curve with its
    band where there is one.

    `trials` and `tallies` are by agent. Triangles on the lines of 50 and 90 % are competence, the line to
    their left reaches down to its lower bound.
    """
    difficulties = [hard for agent_trials in trials.values() for hard in agent_trials.difficulty]
    extent = (max(0.0, min(difficulties, default=0.0) - 8.0), max(difficulties, default=100.0) + 8.0)
    # Room for whole discs at 0 and 100 %.
    plot = Plot(label, 400, 250, extent, (-9, 109), (48, 10, 8, 38))
    plot.x_axis(round_ticks(*extent), "difficulty")
    # Competence is defined at pass rates of 50 and 90 %.
    plot.y_axis([(rate, str(rate)) for rate in (0, 50, 90, 100)], "runs passed, %")
    flown = [style for style in shown if style.name in trials]
    for style in flown:
        _curve(plot, style, trials[style.name].curve())
    for place, style in enumerate(shown):
        # Shifted sideways: discs of agents with the same difficulty and rate would hide each other.
        aside = (place - (len(shown) - 1) / 2) * 0.012 * (extent[1] - extent[0])
        if style in flown:
            _pass_rates(plot, style, trials[style.name], aside)
            _competences(plot, style, tallies.get(style.name), 4.0 * (place - (len(shown) - 1) / 2))
    return plot


def _curve(plot: Plot, style: AgentStyle, curve: Curve) -> None:
    if not curve.drawn:
        return
    x = curve.difficulty.tolist()
    middle, low, high = ((100 * shares).tolist() for shares in (curve.probability, curve.low, curve.high))
    band = [*zip(x, high, strict=True), *reversed(list(zip(x, low, strict=True)))]
    plot.line(band, "none", fill=style.fill, opacity=0.5)
    # Dotted where the runs do not fix the curve: all passed, none passed, or separated.
    dash = "" if curve.state is CurveState.FITTED else "2 4"
    title = f"{style.letter} {style.name}: logistic curve"
    plot.line(zip(x, middle, strict=True), style.colour, title, width=2, dash=dash)


def _pass_rates(plot: Plot, style: AgentStyle, trials: NodeTrials, aside: float) -> None:
    # Equal to six decimals, as in difficulty configurations (docs/rulings.md 14).
    tried = Counter(round(hard, 6) for hard in trials.difficulty)
    passed = Counter(round(hard, 6) for hard, ok in zip(trials.difficulty, trials.passed, strict=True) if ok)
    for hard, runs in sorted(tried.items()):
        size = min(22.0, 6.0 + 2.0 * math.sqrt(runs))
        title = f"{style.letter} {style.name}, difficulty {hard:.1f}: {passed[hard]} of {runs} runs passed"
        rate = 100 * passed[hard] / runs
        plot.mark(style.marker, (hard + aside, rate), size, style.colour, title, fill=style.fill, width=1.4)


def _competences(plot: Plot, style: AgentStyle, tally: Tally | None, aside: float) -> None:
    for rate, competence in (tally.competence if tally is not None else {}).items():
        # 0 means that the fit never reaches the rate, so there is no difficulty to draw it at.
        if competence.value <= 0.0:
            continue
        y = int(rate) + aside
        at_least = "at least " if competence.at_least else ""
        title = f"{style.letter} {style.name}, competence {rate}: {at_least}{competence.value:.1f}, lower bound {competence.low:.1f}"
        plot.line(((competence.low, y), (competence.value, y)), style.colour, title, width=1.6)
        plot.mark("bar", (competence.low, y), 7, style.colour, width=1.6)
        end = "triangle-right" if competence.at_least else "bar"
        plot.mark(end, (competence.value, y), 10, style.colour, width=1.6)
