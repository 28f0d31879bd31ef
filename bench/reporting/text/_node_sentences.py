"""One node of one agent in plain sentences: score, competence, confidence, and what the runs prove."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

from bench.statistics import Curve, CurveState, claim

from .._campaign_data import Tally
from ..statistics._trials import Trials
from ._format import number, percent, plural

SHARES = {"50": "half", "90": "nine tenths"}


NO_CURVE = {
    CurveState.TOO_FEW: "No curve is drawn: fewer than ten runs considered the node.",
    CurveState.ONE_DIFFICULTY: "No curve is drawn: all runs have one difficulty, so nothing shows how passing depends on it.",
}


DOUBTS = {
    CurveState.ALL_PASSED: "All runs passed: the curve falls only as far as so few runs cannot exclude.",
    CurveState.NONE_PASSED: "No run passed: the curve stands above 0 only as far as so few runs cannot exclude.",
    CurveState.SEPARATED: "Passes and failures lie on either side of one difficulty: how steep the curve is there, nothing shows.",
}


def sentences(tally: Tally | None, trials: Trials) -> list[str]:
    """What can be said of one node of one agent over all runs."""
    return [one.replace(" %", "\u00a0%") for one in _sentences(tally, trials)]


def _sentences(tally: Tally | None, trials: Trials) -> list[str]:
    if tally is None:
        return ["Nothing is on record of it."]
    if not tally.considered:
        return [
            f"Never considered: none of {plural(tally.runs, 'run')} offered anything that exercises it, so nothing is said of it."
        ]
    return [
        *_score(tally),
        *(_competence(tally, rate) for rate in tally.competence),
        _confidence(tally),
        _claim(tally, trials),
    ]


def _score(tally: Tally) -> Iterator[str]:
    considered = plural(tally.considered, "considered run")
    if tally.score is None:
        yield f"Not scored: nothing under it was achieved in any of {considered}. That is no score of 0."
        return
    ends = ""
    if tally.score_low is not None and tally.score_high is not None:
        ends = f" (95 % interval {number(tally.score_low)} to {number(tally.score_high)})"
    yield f"ARL score {number(tally.score)}{ends}, the mean of the {tally.scored} of {considered} that have a score."
    if tally.raised:
        yield (
            f"Failures raised this score: what failed has none and leaves the mean. Had every failed observable passed exactly at "
            f"its threshold, it would be {number(tally.passed_score)}."
        )


def _competence(tally: Tally, rate: str) -> str:
    found = tally.competence[rate]
    if found.value <= 0.0:
        return (
            f"Competence {rate}: 0. The pass rate, fitted so that it never rises with difficulty, reaches {SHARES[rate]} nowhere."
        )
    value = f"at least {number(found.value)}, the highest flown" if found.at_least else number(found.value)
    low = (
        f"with 95 % confidence it is {number(found.low)} or more"
        if found.low > 0
        else "no lower bound above 0 follows from these runs"
    )
    return (
        f"Competence {rate}: {value}. Up to there the pass rate, fitted so that it never rises, is {SHARES[rate]} or more; {low}."
    )


def _confidence(tally: Tally) -> str:
    ends = ""
    if tally.confidence_low is not None and tally.confidence_high is not None:
        ends = f", 95 % interval {100 * tally.confidence_low:.0f} to {100 * tally.confidence_high:.0f} %"
    return f"Confidence {percent(tally.confidence)}{ends}."


def _claim(tally: Tally, trials: Trials) -> str:
    said = _claimed(trials.passes, len(trials.passed))
    if tally.design_points < len(trials.passed):
        said += f" That takes the runs as independent; they come from {plural(tally.design_points, 'design point')}."
    if tally.method.startswith("anytime"):
        said += " It takes their number as fixed beforehand; here it hung on how they went."
    return said


@lru_cache(maxsize=4096)
def _claimed(passed: int, tried: int) -> str:
    """Hundreds of nodes share few counts, and an exact bound is dear."""
    return claim(passed, tried)


def curve_remark(curve: Curve) -> str:
    """Why there is no curve, or what to keep in mind looking at the one that is drawn."""
    if not curve.drawn:
        return NO_CURVE[curve.state]
    if curve.state in DOUBTS:
        return DOUBTS[curve.state]
    if curve.half_at is not None:
        return f"The curve passes an even chance at difficulty {number(curve.half_at)}; that is no competence, for it rises when easy runs fail."
    if curve.probability[-1] > curve.probability[0]:
        return "The curve rises: harder runs passed no less often than easier ones, so rated difficulty does not tell where it fails."
    side = "above" if curve.probability[-1] > 0.5 else "below"
    return f"The curve stays {side} an even chance at every difficulty flown."
