"""The page to sign: what one agent was shown to do, what it was not, and how to check that, in at most 250 words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from bench.contracts import SuspectEnds, TruthGiven, TruthSightings, plugins
from bench.simspec import agent_name

from .._campaign_data import ReportData, stopped_early
from ._campaign_sentences import missing_sentence
from ._fidelity import fidelity_note
from ._format import difficulties, listed, number, passed_interval, plural
from ._isolation import UNCONFINED, isolation_cell

# Chosen: a sheet has room for some names, and the appendix has all of them.
NAMED = 3


@dataclass(frozen=True, slots=True)
class SheetRow:
    """One principle: its node, its title, and the cells of the table."""

    node: str
    title: str
    passed: str
    interval: str
    competence: str
    floor: str


@dataclass(frozen=True, slots=True)
class Sheet:
    """One agent, as sentences and the table of principles. `warnings` come first: they weaken everything below."""

    agent: str
    version: str
    warnings: tuple[str, ...]
    flown: str
    rows: tuple[SheetRow, ...]
    not_shown: tuple[str, ...]
    confinement: str
    unconfined: bool
    digest: str
    signature: str


def sheets(data: ReportData) -> list[Sheet]:
    """A sheet for each agent under test, in the order of the campaign."""
    return [_sheet(data, agent) for agent in data.agents]


def _sheet(data: ReportData, agent: str) -> Sheet:
    runs = [run for run in data.runs if run.agent == agent]
    counted = [run for run in runs if run.counts]
    ways = Counter(isolation_cell(run) for run in counted)
    evidence = data.manifest.get("evidence")
    head = evidence.get("head") if isinstance(evidence, Mapping) else None
    scenes = len({run.scene for run in counted})
    tallies = (tally for node in data.study if (tally := data.tally(agent, node)) is not None)
    return Sheet(
        agent=agent,
        version=_version(data, agent),
        warnings=tuple(_warnings(data, agent)),
        flown=f"{plural(len(counted), 'run')} {'counts' if len(counted) == 1 else 'count'} of {len(runs)}, on {plural(scenes, 'scene')} "
        f"of campaign {data.name}, all simulated; difficulty {difficulties(tallies)} of 100.",
        rows=tuple(_rows(data, agent)),
        not_shown=tuple(_not_shown(data, agent)),
        confinement=_confinement(ways),
        unconfined=UNCONFINED in ways,
        digest=str(head) if head else "",
        # The page is written before its digest can be in manifest.json, and a signature is over that.
        signature="None when this was written; rebar verify DIR names a later signer.",
    )


def _confinement(ways: Counter[str]) -> str:
    """The ways in which runs were confined, the open ones first."""
    ordered = sorted(ways.items(), key=lambda item: (item[0] != UNCONFINED, -item[1], item[0]))
    texts = [
        f"{'NOT CONFINED' if way == UNCONFINED else way} in {plural(count, 'run')}"
        for way, count in ordered[:NAMED]
    ]
    return "; ".join([*texts, *_rest(len(ordered))]) or "nothing was flown"


def _rest(count: int) -> list[str]:
    """`2 more` of so many names."""
    return [f"{count - NAMED} more"] if count > NAMED else []


def _version(data: ReportData, agent: str) -> str:
    """The package that brings the agent, in the version that flew, and the options that it was given."""
    versions = data.manifest.get("versions")
    parts = []
    for spec in data.campaign.get("agents") or ():
        manifest = str(spec.get("manifest", "")) if isinstance(spec, Mapping) else ""
        if agent_name(manifest) != agent:
            continue
        point = plugins("rebar.agents").get(manifest)
        package = point.dist.name if point and point.dist else ""
        if isinstance(versions, Mapping) and package in versions:
            parts.append(f"of {package} {versions[package]}")
        options = spec.get("options")
        if isinstance(options, Mapping) and options:
            parts.append(f"with {plural(len(options), 'option')} of campaign.yaml")
    return ", ".join(parts) or "version not on record"


def _warnings(data: ReportData, agent: str) -> Iterator[str]:
    runs = [run for run in data.runs if run.agent == agent]
    if note := fidelity_note(data.campaign):
        yield note
    if missing := missing_sentence(data):
        # The appendix has the rest of the sentence.
        yield f"{missing.split(', so ')[0]}."
    if any(run.fact(TruthGiven) for run in runs):
        yield "It was given the truth: this is no agent’s result."
    if seen := sum(run.fact(TruthSightings) is not None for run in runs):
        yield f"It saw the truth in {plural(seen, 'run')}."
    if suspect := sum(run.fact(SuspectEnds) is not None for run in runs):
        yield f"The bench failed in {plural(suspect, 'run')} while it was there."
    if data.notes:
        yield f"{plural(len(data.notes), 'remark')}: see the appendix."


def _rows(data: ReportData, agent: str) -> Iterator[SheetRow]:
    for node in data.nodes.values():
        tally = data.tally(agent, node.id)
        if node.level != "principle" or tally is None:
            continue
        ability, floor = tally.competence.get("90"), data.floors.get(node.id)
        yield SheetRow(
            node.id,
            node.title,
            f"{tally.passes.passed} of {tally.passes.runs}" if tally.passes.runs else "no verdict",
            passed_interval(tally) if tally.passes.runs else "–",
            "not given"
            if ability is None
            else f"{'≥ ' if ability.at_least else ''}{number(ability.value)}, bound {number(ability.low)}",
            "not flown"
            if not data.floors
            else "no verdict"
            if floor is None or floor.verdict_considered is None
            else f"{floor.verdict_passed} of {floor.verdict_considered}",
        )


def _not_shown(data: ReportData, agent: str) -> Iterator[str]:
    """What a reader of the table might take for shown."""
    if unseen := list(_unseen(data, agent)):
        yield f"{listed(unseen)}: considered in no run."
    tallies = [data.tally(agent, node.id) for node in data.nodes.values() if node.level == "principle"]
    if any(tally is not None and "90" not in tally.competence for tally in tallies):
        yield "A limit of difficulty where “not given” stands."
    if flat := len(data.undiscriminating):
        yield f"Merit in {plural(flat, 'observable')}: agents without merit reach them."
    elif not data.floors:
        yield "What an agent without merit would reach."
    if stopped_early(data.scores):
        yield "A number of runs fixed beforehand: points stopped early."
    yield "Anything harder than was flown, outside the campaign’s factors, or real."


def _unseen(data: ReportData, agent: str) -> Iterator[str]:
    """How many key attributes and observables no run considered, and the names of some of the first."""
    for level, noun in (("ka", "key attribute"), ("observable", "observable")):
        nodes = [node.id for node in data.nodes.values() if node.level == level]
        unseen = [
            node for node in nodes if (tally := data.tally(agent, node)) is None or not tally.considered
        ]
        if unseen:
            names = f" ({', '.join([*unseen[:NAMED], *_rest(len(unseen))])})" if level == "ka" else ""
            yield f"{len(unseen)} of {plural(len(nodes), noun)}{names}"
