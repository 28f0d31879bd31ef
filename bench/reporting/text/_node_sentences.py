"""One node of one agent in plain sentences: score, competence, confidence, and what the runs prove."""

from __future__ import annotations

from collections.abc import Iterator

from bench.statistics import Curve, CurveState

from .._campaign_data import Tally
from ..statistics._trials import NodeTrials
from ._format import number, percent, plural, verdict

PASS_SHARES = {"50": "half", "90": "nine tenths"}


NO_CURVE_REASONS = {
    CurveState.TOO_FEW: "No curve is drawn: fewer than ten runs considered the node.",
    CurveState.ONE_DIFFICULTY: "No curve is drawn: all runs have one difficulty, so they do not show how passing depends on it.",
}


CURVE_CAVEATS = {
    CurveState.ALL_PASSED: "All runs passed: the curve is below 100 % only where so few runs cannot exclude it.",
    CurveState.NONE_PASSED: "No run passed: the curve is above 0 only where so few runs cannot exclude it.",
    CurveState.SEPARATED: "All passes and failures are on either side of one difficulty, so the runs do not show how steep the curve is there.",
}


def node_sentences(tally: Tally | None, trials: NodeTrials) -> list[str]:
    """The results of one node and agent over all runs, in sentences."""
    # No-break spaces: a line must not end between a number and its unit.
    return [sentence.replace(" %", "\u00a0%") for sentence in _sentences(tally, trials)]


def _sentences(tally: Tally | None, trials: NodeTrials) -> list[str]:
    if tally is None:
        return ["There is no record of it."]
    if not tally.considered:
        return [
            f"Never considered: none of {plural(tally.runs, 'run')} offered anything that exercises it, so there is no result."
        ]
    return [
        f"{verdict(tally).capitalize()}.",
        *_score(tally),
        *(_competence(tally, rate) for rate in tally.competence),
        *([] if tally.competence else [_no_competence(tally, trials)]),
        _confidence(tally),
    ]


def _score(tally: Tally) -> Iterator[str]:
    considered = plural(tally.considered, "considered run")
    if tally.score is None:
        yield f"Not scored: nothing under it was achieved in any of {considered}. This is not a score of 0."
        return
    ends = ""
    if tally.score_low is not None and tally.score_high is not None:
        ends = f" (flown again with new seeds: {number(tally.score_low)} to {number(tally.score_high)}, 95 %)"
    yield f"ARL score {number(tally.score)}{ends}, the mean of the {tally.scored} of {considered} that have a score."
    if tally.raised:
        yield (
            f"Failures raised this score, because a failed observable has no score and does not count in the mean. If every failed "
            f"observable had passed exactly at its threshold, the score would be {number(tally.passed_score)}."
        )


def _competence(tally: Tally, rate: str) -> str:
    competence = tally.competence[rate]
    if competence.value <= 0.0:
        return f"Competence {rate}: 0. The pass rate, fitted so that it never rises with difficulty, never reaches {PASS_SHARES[rate]}."
    value, low = number(competence.value), "these runs give no lower bound above 0"
    if competence.at_least:
        value = f"at least {value}, the highest difficulty flown"
    if competence.low > 0:
        low = f"with 95 % confidence it is {number(competence.low)} or more"
    return f"Competence {rate}: {value}. Up to this difficulty the pass rate, fitted so that it never rises, is {PASS_SHARES[rate]} or more; {low}."


def _confidence(tally: Tally) -> str:
    ends = ""
    if tally.confidence_low is not None and tally.confidence_high is not None:
        ends = f", 95 % interval {100 * tally.confidence_low:.0f} to {100 * tally.confidence_high:.0f} %"
    return f"Confidence {percent(tally.confidence)}{ends}."


def _no_competence(tally: Tally, trials: NodeTrials) -> str:
    if tally.passed == tally.considered:
        why = "every run achieved everything under it"
    elif not tally.passed:
        why = "no run achieved everything under it"
    elif len(set(trials.difficulty)) < 2:
        why = "all runs have one difficulty"
    else:
        curve = trials.curve()
        is_rising = curve.drawn and curve.probability[-1] > curve.probability[0]
        why = "the curve rises" if is_rising else "the runs are too few, or difficulty explains too little"
    return f"No competence is given: {why}, so these runs do not show that failures rise with the rated difficulty."


def curve_remark(curve: Curve) -> str:
    """Why there is no curve, or what to keep in mind looking at the one that is drawn."""
    if not curve.drawn:
        return NO_CURVE_REASONS[curve.state]
    if curve.state in CURVE_CAVEATS:
        return CURVE_CAVEATS[curve.state]
    if curve.half_at is not None:
        return f"The curve passes an even chance at difficulty {number(curve.half_at)}; this is not the competence, because it rises when easy runs fail."
    if curve.probability[-1] > curve.probability[0]:
        return "The curve rises: harder runs passed at least as often as easier ones, so the rated difficulty does not explain the failures."
    # Neither rising nor crossing 50 %: the last value is on the same side as all others.
    side = "above" if curve.probability[-1] > 0.5 else "below"
    return f"The curve stays {side} an even chance at every difficulty flown."
