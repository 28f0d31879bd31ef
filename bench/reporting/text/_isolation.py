"""How the agents were confined, from the results of their runs: a part of every answer."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from bench.agents.confinement import HOLDINGS, Host, leaves_open, wall_text
from bench.contracts import Confinement, ServicesLetIn

from .._campaign_data import ReportData, Run
from ._fidelity import fidelity_note
from ._format import listed, plural
from ._service_use import services_sentence

NOT_RECORDED = "not recorded"
UNCONFINED = "none"
OWN_NETWORK = "own"


@dataclass(frozen=True, slots=True)
class ConfinementNote:
    """One agent: the sentence about its runs, and whether some of them were not confined."""

    agent: str
    text: str
    unconfined: bool
    open_walls: tuple[str, ...] = ()


def confinement_notes(data: ReportData) -> list[ConfinementNote]:
    """For each agent that flew; none where surrogates took the place of sessions."""
    return [note for agent in data.agents if (note := confinement_note(data, agent)) is not None]


def confinement_note(data: ReportData, agent: str) -> ConfinementNote | None:
    """How an agent was confined over its runs that count; None where it flew none."""
    runs = [run for run in data.runs if run.agent == agent and run.outcome and run.outcome.counts]
    if not runs or fidelity_note(data.campaign):
        return None
    ways = Counter(map(_way, runs))
    sentences = []
    for way, count in sorted(ways.items(), key=lambda item: (_rank(item[0]), -item[1])):
        where = "" if len(ways) == 1 else f" in {plural(count, 'run')}"
        sentences.append(_sentence(way, where))
    if services := services_sentence(runs):
        sentences.append(services)
    free = [way.gaps for way in ways if way.isolation == UNCONFINED]
    open_walls = dict.fromkeys(gap for gaps in free for gap in gaps)
    return ConfinementNote(agent, " ".join(sentences), bool(free), tuple(open_walls))


@dataclass(frozen=True, slots=True)
class _Way:
    """One way in which sessions were confined. `gaps` are the walls that it left open, in words."""

    isolation: str | None
    network: str | None
    gaps: tuple[str, ...]
    recorded: bool
    """Whether the results name the gaps of their host; otherwise they are those on the best of hosts."""


def _way(run: Run) -> _Way:
    confinement = run.fact(Confinement)
    if confinement is None:
        return _Way(None, None, (), recorded=False)
    isolation, network, walls = confinement.isolation, confinement.network, confinement.open_walls
    if walls is not None:
        return _Way(isolation, network, tuple(map(wall_text, walls)), recorded=True)
    return _Way(isolation, network, _open(isolation, network), recorded=False)


def _rank(way: _Way) -> tuple[int, int, str]:
    """Order of the sentences: unconfined runs first, then by the number of open walls, unknown ones last."""
    place = 0 if way.isolation == UNCONFINED else 2 if way.isolation is None else 1
    return place, -len(way.gaps), way.isolation or ""


def _sentence(way: _Way, where: str) -> str:
    if way.isolation is None:
        return f"How it was confined is {NOT_RECORDED}{f' for {where[4:]}' if where else ''}."
    if way.isolation == UNCONFINED:
        return (
            f"It was NOT CONFINED{where} (isolation none): it had the rights of the bench, so that its results "
            "hold only for an agent that is trusted."
        )
    network = ", with a network of its own" if way.network == OWN_NETWORK else ", on the host’s network"
    missing = f" Walls that were missing: {'; '.join(way.gaps)}." if way.gaps else ""
    complete = " No wall was missing." if way.recorded and not way.gaps else ""
    return f"It was confined by {way.isolation}{where}{network}.{missing}{complete}"


def _open(isolation: str, network: str) -> tuple[str, ...]:
    """What a rung leaves open on the best of hosts, but for the network: for results that do not say it."""
    if isolation not in HOLDINGS or (isolation != UNCONFINED and network == OWN_NETWORK):
        return ()
    best = Host(
        root=True,
        landlock=100,
        memory_groups=True,
        process_groups=True,
        own_network=network == OWN_NETWORK,
        own_user=True,
        own_root=True,
    )
    return tuple(leaves_open(isolation, best))


def isolation_cell(run: Run) -> str:
    """The cell in the list of runs."""
    confinement, services = run.fact(Confinement), run.fact(ServicesLetIn)
    if confinement is None or confinement.isolation == UNCONFINED:
        return UNCONFINED if confinement else NOT_RECORDED
    shared = "" if confinement.network == OWN_NETWORK else ", host’s network"
    walls = confinement.open_walls
    gaps = f", {plural(len(walls), 'wall')} open" if walls else ""
    names = f", let in: {listed([use.name for use in services.uses])}" if services else ""
    return f"{confinement.isolation}{shared}{gaps}{names}"
