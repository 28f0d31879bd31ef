"""How the agents were confined, from the results of their runs: a part of every answer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bench.agents.confinement import wall_text
from bench.contracts import Confinement, ServicesLetIn, ServiceUse

from .._campaign_data import ReportData, Run
from ._fidelity import fidelity_note
from ._format import listed, plural

NOT_RECORDED = "not recorded"
UNCONFINED = "none"
OWN_NETWORK = "own"
_COUNTS = ("connections", "failed", "refused", "bytes_sent", "bytes_received")


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
    ways = Counter(run.fact(Confinement) for run in runs)
    sentences = []
    for way, count in sorted(ways.items(), key=lambda item: (_rank(item[0]), -item[1])):
        where = "" if len(ways) == 1 else f" in {plural(count, 'run')}"
        sentences.append(_sentence(way, where))
    if services := _services_sentence(runs):
        sentences.append(services)
    free = [way for way in ways if way is not None and way.isolation == UNCONFINED]
    open_walls = dict.fromkeys(gap for way in free for gap in _gaps(way))
    return ConfinementNote(agent, " ".join(sentences), bool(free), tuple(open_walls))


def _gaps(way: Confinement) -> list[str]:
    """The walls that it left open, in words; none where its agent never started."""
    return [wall_text(name) for name in way.open_walls or ()]


def _rank(way: Confinement | None) -> tuple[int, int, str]:
    """Order of the sentences: unconfined runs first, then by the number of open walls, unknown ones last."""
    if way is None:
        return 2, 0, ""
    return int(way.isolation != UNCONFINED), -len(way.open_walls or ()), way.isolation


def _sentence(way: Confinement | None, where: str) -> str:
    if way is None:
        return f"How it was confined is {NOT_RECORDED}{f' for {where[4:]}' if where else ''}."
    if way.isolation == UNCONFINED:
        return (
            f"It was NOT CONFINED{where} (isolation none): it had the rights of the bench, so that its results "
            "hold only for an agent that is trusted."
        )
    network = ", with a network of its own" if way.network == OWN_NETWORK else ", on the host’s network"
    missing = f" Walls that were missing: {'; '.join(_gaps(way))}." if way.open_walls else ""
    complete = " No wall was missing." if way.open_walls == () else ""
    return f"It was confined by {way.isolation}{where}{network}.{missing}{complete}"


def _services_sentence(runs: Sequence[Run]) -> str:
    """The services of these runs and what went over each; empty where nothing was let in."""
    served = [services for run in runs if (services := run.fact(ServicesLetIn))]
    if not served:
        return ""
    totals = _totals(use for services in served for use in services.uses)
    return (
        f"Services from outside were let in, in {plural(len(served), 'run')}: {'; '.join(map(str, totals))}. "
        "Nobody can repeat what they answered."
    )


def _totals(uses: Iterable[ServiceUse]) -> list[ServiceUse]:
    """One use for each service, in the order in which they come; counted when every run could tell."""
    totals: dict[tuple[str, str, int], ServiceUse] = {}
    for use in uses:
        total = totals.setdefault((use.name, use.host, use.port), use)
        if total is not use:
            sums = {count: getattr(total, count) + getattr(use, count) for count in _COUNTS}
            sums["counted"] = total.counted and use.counted
            totals[use.name, use.host, use.port] = total.model_copy(update=sums)
    return list(totals.values())


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
