"""How the agents were confined, from the results of their runs: a part of every answer."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from bench.agents.confinement import HOLDINGS, Host, leaves_open

from .._campaign_data import ReportData, Run
from ._fidelity import fidelity_note
from ._format import listed, plural

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
    ways = Counter((run.isolation, run.network) for run in runs)
    sentences = []
    for (isolation, network), count in sorted(ways.items(), key=lambda way: _seriousness(way[0][0], way[1])):
        where = "" if len(ways) == 1 else f" in {plural(count, 'run')}"
        sentences.append(_sentence(isolation, network, where))
    unconfined = any(isolation == UNCONFINED for isolation, _ in ways)
    return ConfinementNote(
        agent, " ".join(sentences), unconfined, _open(UNCONFINED, "") if unconfined else ()
    )


def _seriousness(isolation: str | None, count: int) -> tuple[int, str, int]:
    """Order of the sentences: unconfined runs first, unknown ones last."""
    place = 0 if isolation == UNCONFINED else 2 if isolation is None else 1
    return place, isolation or "", -count


def _sentence(isolation: str | None, network: str | None, where: str) -> str:
    if isolation is None:
        return f"How it was confined is {NOT_RECORDED}{f' for {where[4:]}' if where else ''}."
    if isolation == UNCONFINED:
        return (
            f"It was NOT CONFINED{where} (isolation none): it had the rights of the bench, so that its results "
            "hold only for an agent that is trusted."
        )
    confined = f"It was confined by {isolation}{where}"
    if network is None or network == OWN_NETWORK:
        return f"{confined}{', with a network of its own' if network else ''}."
    gaps = _open(isolation, network)
    return (
        f"{confined}, on the host’s network, which leaves open: {listed(gaps)}." if gaps else f"{confined}."
    )


def _open(isolation: str, network: str) -> tuple[str, ...]:
    """What a rung leaves open on the best of hosts, but for the network."""
    if isolation not in HOLDINGS:
        return ()
    best = Host(
        root=True,
        landlock=100,
        memory_groups=True,
        process_groups=True,
        own_network=network == OWN_NETWORK,
        own_user=True,
    )
    return tuple(leaves_open(isolation, best))


def isolation_cell(run: Run) -> str:
    """The cell in the list of runs."""
    if run.isolation is None:
        return NOT_RECORDED
    shared = run.network is not None and run.network != OWN_NETWORK
    return f"{run.isolation}, host’s network" if shared else run.isolation
