"""What was let in from outside of the sessions: a part of how an agent was confined."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bench.contracts import ServicesLetIn, ServiceUse

from .._campaign_data import Run
from ._format import plural

_COUNTS = ("connections", "failed", "refused", "bytes_sent", "bytes_received")


def services_sentence(runs: Sequence[Run]) -> str:
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
