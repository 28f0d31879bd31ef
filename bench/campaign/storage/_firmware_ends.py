"""How real autopilots failed in flight in each realization, and which realizations are not flown again for it.

An agent talks to the firmware, so it may have found a message on which it fails, and could draw another session for one
that goes badly. Nobody can tell that from a firmware that fails by itself, so the draws are limited, and shown. They are
counted in the journal, over all runs of a campaign: otherwise each `rebar run` would give new ones.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from bench.contracts import FIRMWARE_FAILED, FirmwareEnds, Outcome

from ._journal import Journal

MAX_RERUNS = 1
"""Further flights of a realization after its firmware has failed in flight; each more has to be asked for."""


def firmware_ends(journal: Journal) -> dict[str, list[str]]:
    """How the firmware failed in flight, one text for each attempt, by realization."""
    return dict(json.loads(journal.fact(FirmwareEnds.key) or "{}"))


def add_firmware_ends(journal: Journal, ends: Mapping[str, Sequence[str]]) -> None:
    """Note further failures, behind those that are there."""
    noted = firmware_ends(journal)
    for realization, texts in ends.items():
        noted[realization] = [*noted.get(realization, []), *texts]
    if noted:
        journal.note(FirmwareEnds.key, json.dumps(noted, sort_keys=True))


def drawn_out_realizations(journal: Journal) -> frozenset[str]:
    """The realizations whose firmware has failed in flight as often as it may, in their last attempt too."""
    ends = firmware_ends(journal)
    return frozenset(
        entry.id
        for entry in (journal.entries() if ends else ())
        if entry.outcome is Outcome.BENCH_ERROR
        and entry.reason.startswith(FIRMWARE_FAILED)
        and len(ends.get(entry.id, ())) > MAX_RERUNS
    )
