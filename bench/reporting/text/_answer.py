"""How hard a situation an agent can be trusted in, and how sure that is: one paragraph to quote.

Every number in it stands in the tables of the page.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.contracts import TruthGiven, TruthSightings

from .._campaign_data import ReportData, Tally, stopped_early
from ._campaign_sentences import missing_sentence
from ._fidelity import fidelity_note
from ._format import difficulties, interval, listed, number, passed_runs, percent, plural
from ._isolation import confinement_note

RATE_WORDS = {"90": "nine in ten", "50": "half"}


def answer_paragraph(data: ReportData, agent: str) -> str:
    """The answer about one agent over the nodes under study, with what weakens it; empty where nothing was scored."""
    tallies = [tally for node in data.study if (tally := data.tally(agent, node)) is not None]
    considered = [tally for tally in tallies if tally.considered]
    caveats = _caveats(data, agent, tallies)
    if not tallies:
        return ""
    if not considered:
        return " ".join(
            [f"Nothing can be said about {agent}: no run considered a node under study.", *caveats]
        )
    runs = max(tally.runs for tally in tallies)
    scenes = len({run.scene for run in data.runs if run.agent == agent and run.counts})
    sentences = [
        f"In {plural(runs, 'simulated run')} that {'counts' if runs == 1 else 'count'}, on {plural(scenes, 'scene')}, {agent} met "
        f"difficulties of {difficulties(considered)} on the scale from 0 to 100.",
        *_limits(considered),
        _weakest(data, considered),
        *caveats,
    ]
    # No-break spaces: a line must not end between a number and its unit.
    return " ".join(sentences).replace(" %", "\u00a0%")


def _limits(considered: Sequence[Tally]) -> list[str]:
    tallies = [tally for tally in considered if tally.competence]
    others = [tally.node for tally in considered if not tally.competence]
    unknown = "these runs do not show that failures rise with the rated difficulty"
    if not tallies:
        return [f"No limit of difficulty is given: {unknown}."]
    subject = f"each of {listed([tally.node for tally in tallies])}" if len(tallies) > 1 else tallies[0].node
    rest = [f"No limit is given for {listed(others)}: {unknown}."] if others else []
    if min(tally.competence["50"].value for tally in tallies) <= 0.0:
        return [f"At no difficulty does even half of such runs pass {subject}.", *rest]
    return [*(_limit(tallies, rate, subject) for rate in RATE_WORDS), *rest]


def _limit(tallies: Sequence[Tally], rate: str, subject: str) -> str:
    """The lowest competence among the nodes under study.

    The lowest of their bounds is a 95 % bound of it: it is too high only if the bound of the node with the lowest
    true competence is.
    """
    lowest = min(tallies, key=lambda tally: tally.competence[rate].value)
    competence = lowest.competence[rate]
    bound = min(tally.competence[rate].low for tally in tallies)
    if competence.value <= 0.0:
        return f"At no difficulty do {RATE_WORDS[rate]} of such runs pass {subject}."
    end = f" (the hardest flown of {lowest.node})" if competence.at_least else f" (where {lowest.node} ends)"
    sure = "with 95 % confidence, these runs support no difficulty above 0"
    if bound > 0.0:
        sure = f"with 95 % confidence they do up to {number(bound)}"
    words = RATE_WORDS[rate].capitalize()
    return f"{words} of such runs pass {subject} up to difficulty {number(competence.value)}{end}; {sure}."


def _weakest(data: ReportData, tallies: Sequence[Tally]) -> str:
    # The id breaks ties, so that the same folder gives the same sentence.
    weakest = min(tallies, key=lambda tally: (tally.confidence or 0.0, tally.node))
    return (
        f"Its lowest confidence is in {weakest.node} ({data.title(weakest.node)}). It passed {passed_runs(weakest)}. "
        f"The confidence, the mean share of achieved observables, is {percent(weakest.confidence)}, 95 % interval {interval(weakest)}."
    )


def _caveats(data: ReportData, agent: str, tallies: Sequence[Tally]) -> Iterator[str]:
    """What weakens the answer, most serious first; the last one always holds."""
    yield from _caveats_of_runs(data, agent)
    if unseen := [tally.node for tally in tallies if not tally.considered]:
        known = "it" if len(unseen) == 1 else "them"
        yield f"Nothing is known about {listed(unseen)}: no run considered {known}."
    if flawed := len(_undiscriminating_under_study(data)):
        yield (
            f"{plural(flawed, 'observable')} under the key attributes under study {'does' if flawed == 1 else 'do'} not "
            "discriminate: agents without merit reach them too, so passing shows less than it seems."
        )
    elif not data.floors:
        yield "What an agent without merit would reach was not flown (rebar run --floor)."
    if stopped_early(data.scores):
        yield "The number of runs depended on the results; the bounds allow for that."
    yield "This holds for the situations of this campaign and as far as the simulation does; it is no claim about harder ones."


def _caveats_of_runs(data: ReportData, agent: str) -> Iterator[str]:
    """How the agent was flown, as far as that weakens what its runs say."""
    runs = [run for run in data.runs if run.agent == agent]
    if seen := sum(run.fact(TruthSightings) is not None for run in runs):
        yield f"It saw the truth in {plural(seen, 'run')}: it reported a honeypot, which nothing but the SimSpec shows."
    if incomplete := missing_sentence(data):
        yield incomplete.strip()
    if note := fidelity_note(data.campaign):
        yield f"{note} No session was flown."
    if any(run.fact(TruthGiven) for run in runs):
        yield "It was given the truth, so this shows what can be reached, and is no agent’s result."
    if (confinement := confinement_note(data, agent)) is not None:
        yield confinement.text


def _undiscriminating_under_study(data: ReportData) -> list[str]:
    below: set[str] = set()
    pending = list(data.study)
    while pending:
        node = pending.pop()
        if node not in below and node in data.nodes:
            below.add(node)
            pending += data.nodes[node].children
    return [node.id for node in data.undiscriminating if node.id in below]
