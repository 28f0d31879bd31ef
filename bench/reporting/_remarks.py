"""Remarks on single runs that stand before all numbers of a report."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from bench.contracts import SessionResult, firmware_ends_of, suspicions_of, truth_sightings_of


@dataclass(slots=True)
class Remarks:
    """What readers must know of single runs before they look at any number."""

    strangers: dict[str, int] = field(default_factory=dict)
    informed: list[str] = field(default_factory=list)
    suspects: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    failed_measures: Counter[str] = field(default_factory=Counter)

    def add(self, name: str, result: SessionResult) -> None:
        """Look at the result of a run."""
        if count := result.counters.get("tick_strangers", 0):
            self.strangers[name] = count
        for names, holds in (
            (self.informed, truth_sightings_of(result.details)),
            (self.suspects, suspicions_of(result.details)),
            (self.failed, firmware_ends_of(result.details)),
        ):
            if holds:
                names.append(name)
        self.failed_measures.update({observation.failure for observation in result.observations} - {""})

    def write(self, notes: list[str]) -> None:
        """Add a sentence for each kind of remark that there is."""
        notes += [
            f"A measure failed in {count} of the runs, so its observables are not considered there: {failure}."
            for failure, count in sorted(self.failed_measures.items())
        ]
        if self.strangers:
            notes.append(
                f"Programs other than the agent connected to a session's clock {sum(self.strangers.values())} times and were "
                f"refused, in {', '.join(self.strangers)}."
            )
        if self.informed:
            # Before all others: no number of such an agent means what it says.
            notes.insert(
                0,
                "An agent saw the truth: it reported a honeypot, a target that nothing but the SimSpec shows, in "
                f"{', '.join(self.informed)}. The tables of runs list these first.",
            )
        if self.suspects:
            notes.append(
                "The bench failed while an agent was there, which the host or the agent may have caused, in "
                f"{', '.join(self.suspects)}. The tables of runs list these first."
            )
        if self.failed:
            notes.append(
                "A real autopilot failed in flight, which the firmware or the agent's messages may have caused, in "
                f"{', '.join(self.failed)}. Such a run is flown once more; result.json says how it failed."
            )
