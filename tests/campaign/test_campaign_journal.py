"""The journal against a model of it: random sequences of events, with the process killed in between."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from campaign_fakes import small_campaign
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from bench.campaign import Journal, RealizationState, open_journal, realizations
from bench.campaign.storage._journal import PlannedRealization
from bench.contracts import Outcome, SessionResult

NAMES = [plan.id for plan in realizations(small_campaign(points=1, replicates=2))]

name = st.sampled_from(NAMES)
outcome = st.sampled_from([Outcome.COMPLETED, Outcome.WORKER_LOST, Outcome.BENCH_ERROR])
digest = st.sampled_from(["a" * 64, "b" * 64])


@dataclass
class ModelEntry:
    """What a reader of the documentation expects of one realization."""

    state: str = "planned"
    outcome: str | None = None
    result_sha256: str | None = None
    recording_sha256: str | None = None
    attempts: list[str | None] = field(default_factory=list)

    def end_attempts(self, outcome: str) -> None:
        self.attempts = [ended or outcome for ended in self.attempts]


class JournalMachine(RuleBasedStateMachine):
    """Two realizations; every event may come for either at any time, also twice."""

    @initialize()
    def plan(self) -> None:
        self.folder = tempfile.TemporaryDirectory()
        self.model = {name: ModelEntry() for name in NAMES}
        self.open()
        plans = realizations(small_campaign(points=1, replicates=2))
        self.journal.add(PlannedRealization(plan, "0" * 64, "1" * 64) for plan in plans)

    def open(self) -> None:
        self.context = open_journal(Path(self.folder.name) / "journal.sqlite")
        self.journal: Journal = self.context.__enter__()

    @rule(name=name)
    def start(self, name: str) -> None:
        entry = self.model[name]
        entry.attempts.append(None)
        entry.recording_sha256 = None
        entry.state = "running" if entry.state == "planned" else entry.state
        assert self.journal.start(name, "w1") == len(entry.attempts)

    @rule(name=name, outcome=outcome)
    def retry(self, name: str, outcome: Outcome) -> None:
        entry = self.model[name]
        entry.end_attempts(outcome)
        entry.state = "planned" if entry.state == "running" else entry.state
        self.journal.retry(name, outcome, "again")

    @rule(name=name, outcome=outcome, result_sha256=digest, recording_sha256=st.none() | digest)
    def finish(self, name: str, outcome: Outcome, result_sha256: str, recording_sha256: str | None) -> None:
        entry = self.model[name]
        entry.end_attempts(outcome)
        if entry.state != "done":
            entry.state, entry.outcome, entry.result_sha256 = "done", outcome, result_sha256
            entry.recording_sha256 = recording_sha256 or entry.recording_sha256
        self.journal.finish(
            SessionResult(realization=name, outcome=outcome, recording_sha256=recording_sha256), result_sha256
        )

    @rule(name=name)
    def forget(self, name: str) -> None:
        entry = self.model[name]
        entry.state, entry.outcome, entry.result_sha256 = "planned", None, None
        self.journal.forget(name)

    @rule()
    def kill_and_release(self) -> None:
        """A new connection sees whatever the killed one had written; its runner releases what was running."""
        killed = self.context
        self.open()
        running = [name for name, entry in self.model.items() if entry.state == "running"]
        assert self.journal.release() == running
        for name in running:
            self.model[name].end_attempts("interrupted")
            self.model[name].state = "planned"
        killed.__exit__(None, None, None)

    @invariant()
    def agrees(self) -> None:
        entries = {entry.id: entry for entry in self.journal.entries()}
        assert list(entries) == NAMES
        for name, expected in self.model.items():
            entry = entries[name]
            assert (entry.state, entry.outcome, entry.result_sha256) == (
                RealizationState(expected.state),
                expected.outcome,
                expected.result_sha256,
            )
            assert entry.attempts == len(expected.attempts)
        digests = {
            name: entry.recording_sha256 for name, entry in self.model.items() if entry.recording_sha256
        }
        assert self.journal.recordings() == digests

    def teardown(self) -> None:
        if hasattr(self, "context"):
            self.context.__exit__(None, None, None)
            self.folder.cleanup()


# Every step is a transaction on disk, so few and short runs; a failure is shrunk to its shortest sequence.
JournalMachine.TestCase.settings = settings(max_examples=15, stateful_step_count=20, deadline=None)
TestJournal = JournalMachine.TestCase
