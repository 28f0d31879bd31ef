"""The journal of a campaign: state and outcome of every realization, in SQLite, correct after a kill at any moment.

Tables:

    realizations  one row for each realization: ids, levels, digests, state, outcome
    attempts      one row for each time that a realization was started
    recordings    digest of the recording behind each result
    stops         last replicate that counts, for each design point and agent that stopped early
    facts         what the folder was made for, by name

A realization is planned, running or done.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path

from bench.contracts import Outcome, SessionResult
from bench.errors import SetupError
from bench.realization import RealizationPlan

from ._evidence_log import EvidenceLog
from ._folder import EVIDENCE

# Each table in an order that does not depend on where SQLite put its rows. Without the digest's own fact.
_CONTENT = (
    "SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY name",
    "SELECT * FROM facts WHERE name != 'content_sha256' ORDER BY name",
    "SELECT * FROM realizations ORDER BY number",
    "SELECT * FROM attempts ORDER BY realization, number",
    "SELECT * FROM recordings ORDER BY realization",
    "SELECT * FROM stops ORDER BY design_point, agent",
)
_CONTENT_SHA256 = "content_sha256"

INTERRUPTED = "interrupted"
"""What the journal notes as the outcome of an attempt whose runner ended first. No session ends with it."""


Levels = Mapping[str, bool | int | float | str]
"""Factor levels by factor."""


class RealizationState(StrEnum):
    PLANNED = "planned"
    RUNNING = "running"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """One realization in the journal. `outcome`, `wall_s` and `result_sha256` are None until it is done."""

    id: str
    design_point: str
    replicate: int
    agent: str
    levels: Levels
    intent_sha256: str
    simspec_sha256: str
    state: RealizationState
    attempts: int
    outcome: Outcome | None
    reason: str
    wall_s: float | None
    result_sha256: str | None


@dataclass(frozen=True, slots=True)
class PlannedRealization:
    """A realization to be added: its plan, and digests of its SimSpec before placement and of its file in simspecs/."""

    plan: RealizationPlan
    intent_sha256: str
    simspec_sha256: str


class Journal:
    """An open journal. Every method is one transaction."""

    def __init__(self, database: sqlite3.Connection, path: Path) -> None:
        self._database = database
        self._path = path
        self._changed = False

    @cached_property
    def evidence(self) -> EvidenceLog:
        """The chain of evidence beside the journal, as it is at the first look."""
        return EvidenceLog(self._path.with_name(EVIDENCE))

    def entries(self) -> list[JournalEntry]:
        """All realizations in the order in which they were added.

        Raises SetupError if the file is damaged in a way that SQLite does not see.
        """
        try:
            return self._entries()
        except (ValueError, TypeError, sqlite3.DatabaseError) as error:
            raise damaged(self._path, str(error)) from error

    def _entries(self) -> list[JournalEntry]:
        rows = self._database.cursor()
        rows.row_factory = sqlite3.Row
        rows.execute(
            "SELECT *, (SELECT count(*) FROM attempts a WHERE a.realization = r.id) AS attempts "
            "FROM realizations r ORDER BY number"
        )
        # Realizations share design points, agents and levels: each is one object, however many have it.
        texts: dict[str, str] = {}
        levels: dict[str, Levels] = {}
        return [_entry(row, texts, levels) for row in rows]

    def fact(self, name: str) -> str | None:
        """A fact about the folder, None if it was never noted."""
        row = self._database.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
        return None if row is None else str(row[0])

    def note(self, name: str, value: str) -> None:
        """Note a fact about the folder, in place of an earlier value."""
        # Without a change the bytes stay those of the manifest.
        if self.fact(name) == value:
            return
        with self._change():
            self._database.execute("INSERT OR REPLACE INTO facts VALUES (?, ?)", (name, value))

    def add(self, realizations: Iterable[PlannedRealization]) -> None:
        """Add realizations after those that are there, as planned."""
        with self._change():
            (last,) = self._database.execute("SELECT coalesce(max(number), 0) FROM realizations").fetchone()
            self._database.executemany(
                "INSERT INTO realizations (id, number, design_point, replicate, agent, levels, intent_sha256, simspec_sha256) "
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    _row(number, realization)
                    for number, realization in enumerate(realizations, start=last + 1)
                ),
            )

    def start(self, realization: str, worker: str) -> int:
        """Note that a worker starts a realization, and return the number of this attempt, from 1."""
        with self._change():
            (number,) = self._database.execute(
                "SELECT count(*) + 1 FROM attempts WHERE realization = ?", (realization,)
            ).fetchone()
            self._database.execute(
                "UPDATE realizations SET state = 'running' WHERE id = ? AND state = 'planned'", (realization,)
            )
            self._database.execute(
                "INSERT INTO attempts (realization, number, worker, started_utc) VALUES (?, ?, ?, ?)",
                (realization, number, worker, _now()),
            )
            # The attempt overwrites the recording, so the digest of the earlier one would only accuse the new
            # one.
            self._database.execute("DELETE FROM recordings WHERE realization = ?", (realization,))
            # Only where the journal is younger than the chain: else it was withdrawn when it was forgotten.
            self.evidence.withdraw(realization, "its result is gone, and it is flown again")
        return int(number)

    def retry(self, realization: str, outcome: str, reason: str) -> None:
        """Note that the running attempt gave no lasting result; the realization is planned again."""
        with self._change():
            self._end_attempt(realization, outcome, reason)
            self._database.execute(
                "UPDATE realizations SET state = 'planned' WHERE id = ? AND state = 'running'", (realization,)
            )

    def finish(self, result: SessionResult, result_sha256: str) -> None:
        """Note the lasting result of a realization. A second result for the same realization changes nothing."""
        with self._change():
            self._end_attempt(result.realization, result.outcome, result.reason)
            # Before the journal's commit: a result that the journal has is in the chain.
            if self._set_result(result, result_sha256, "AND state != 'done'"):
                self.evidence.add_result("flown", result, result_sha256)

    def measure(self, result: SessionResult, result_sha256: str) -> None:
        """Note what measuring a recording again made of a result, in place of the result so far."""
        with self._change():
            self._set_result(result, result_sha256)
            self.evidence.add_result("measured", result, result_sha256)

    def _set_result(self, result: SessionResult, result_sha256: str, condition: str = "") -> bool:
        updated = self._database.execute(
            "UPDATE realizations SET state = 'done', outcome = ?, reason = ?, wall_s = ?, result_sha256 = ? "
            f"WHERE id = ? {condition}",
            (result.outcome, result.reason, result.wall_s, result_sha256, result.realization),
        )
        if updated.rowcount and result.recording_sha256 is not None:
            row = (result.realization, result.recording_sha256)
            self._database.execute("INSERT OR REPLACE INTO recordings VALUES (?, ?)", row)
        return updated.rowcount > 0

    def drop(self, realization: str, policy: str) -> None:
        """Note in the chain that the recording behind a result is about to be deleted."""
        with self._change():
            self.evidence.drop(realization, policy)

    def forget(self, realization: str, reason: str = "") -> None:
        """Plan a realization again because its result is lost, damaged or no longer wanted."""
        # Its recording's digest stays: a recording that was edited meanwhile must not become a result.
        with self._change():
            self._database.execute(
                "UPDATE realizations SET state = 'planned', outcome = NULL, reason = '', wall_s = NULL, result_sha256 = NULL "
                "WHERE id = ?",
                (realization,),
            )
            self.evidence.withdraw(realization, reason)

    def recordings(self) -> dict[str, str]:
        """SHA-256 of the recording behind each result, by realization. Kept when the result is lost."""
        return dict(self._database.execute("SELECT realization, sha256 FROM recordings").fetchall())

    def set_stops(self, stops: Mapping[tuple[str, str], int]) -> None:
        """Note the last replicate that counts, by design point and agent, in place of all that was noted before."""
        with self._change():
            self._database.execute("DELETE FROM stops")
            rows = [(*key, replicate) for key, replicate in sorted(stops.items())]
            self._database.executemany("INSERT INTO stops VALUES (?, ?, ?)", rows)

    def stops(self) -> dict[tuple[str, str], int]:
        """The last replicate that counts, by design point and agent, for those that stopped early."""
        rows = self._database.execute("SELECT design_point, agent, replicate FROM stops").fetchall()
        return {(point, agent): replicate for point, agent, replicate in rows}

    def release(self) -> list[str]:
        """Plan again whatever an earlier runner left running, and return the ids."""
        running = [entry.id for entry in self.entries() if entry.state is RealizationState.RUNNING]
        for realization in running:
            self.retry(realization, INTERRUPTED, "the runner ended before the session did")
        return running

    def seal(self) -> None:
        """Note the digest of everything that the journal holds; the next change removes it. Done whenever a journal
        that was changed is closed, so only a process that was killed leaves a journal without.
        """
        if self.fact(_CONTENT_SHA256) is None:
            self._database.execute("BEGIN IMMEDIATE")
            self._database.execute(
                "INSERT OR REPLACE INTO facts VALUES (?, ?)", (_CONTENT_SHA256, self._content_sha256())
            )
            self._database.execute("COMMIT")

    def seal_if_changed(self) -> None:
        """`seal`, if this object changed anything: a journal that was only read stays as it is."""
        if self._changed:
            self.seal()

    def settle(self) -> bool:
        """Move all changes into the journal's own file. False if a reader in another process prevents it."""
        (busy, _, _) = self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        return not busy

    @property
    def intact(self) -> bool:
        """Whether the journal holds what was sealed; True also if it was not sealed.

        Raises SetupError if the file is damaged.
        """
        try:
            sealed = self.fact(_CONTENT_SHA256)
            return sealed is None or sealed == self._content_sha256()
        # A damaged name of a column is no UTF-8.
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            raise damaged(self._path, str(error)) from error

    def _content_sha256(self) -> str:
        digest = hashlib.sha256()
        for query in _CONTENT:
            for row in self._database.execute(query):
                # `repr` tells 1, 1.0, '1' and NULL apart, and writes every text in one way.
                digest.update(repr(row).encode() + b"\n")
        return digest.hexdigest()

    def _end_attempt(self, realization: str, outcome: str, reason: str) -> None:
        self._database.execute(
            "UPDATE attempts SET ended_utc = ?, outcome = ?, reason = ? WHERE realization = ? AND ended_utc IS NULL",
            (_now(), outcome, reason, realization),
        )

    @contextmanager
    def _change(self) -> Iterator[None]:
        # IMMEDIATE takes the write lock at once: a reader that turned writer could fail in the middle of a
        # change.
        self._database.execute("BEGIN IMMEDIATE")
        try:
            self._database.execute("DELETE FROM facts WHERE name = ?", (_CONTENT_SHA256,))
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")
        self._changed = True


def damaged(path: Path, what: str) -> SetupError:
    remedy = (
        f"restore it from a copy, or move {path.name}* away and run again: it is made anew, with the results in runs/ "
        f"that {EVIDENCE} knows"
    )
    return SetupError(path, f"is not a campaign journal, or is damaged: {' '.join(what.split())}", remedy)


def _now() -> str:
    return dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")


def _row(number: int, realization: PlannedRealization) -> tuple[str | int, ...]:
    plan = realization.plan
    levels = json.dumps(dict(plan.levels))
    ids = (plan.id, number, plan.design_point, plan.replicate, plan.agent)
    return (*ids, levels, realization.intent_sha256, realization.simspec_sha256)


def _entry(row: sqlite3.Row, texts: dict[str, str], known_levels: dict[str, Levels]) -> JournalEntry:
    levels, outcome, wall_s = str(row["levels"]), row["outcome"], row["wall_s"]
    if levels not in known_levels:
        known_levels[levels] = json.loads(levels)
    return JournalEntry(
        id=str(row["id"]),
        design_point=texts.setdefault(str(row["design_point"]), str(row["design_point"])),
        replicate=int(str(row["replicate"])),
        agent=texts.setdefault(str(row["agent"]), str(row["agent"])),
        levels=known_levels[levels],
        intent_sha256=str(row["intent_sha256"]),
        simspec_sha256=str(row["simspec_sha256"]),
        state=RealizationState(str(row["state"])),
        attempts=int(str(row["attempts"])),
        outcome=None if outcome is None else Outcome(str(outcome)),
        reason=str(row["reason"]),
        wall_s=None if wall_s is None else float(str(wall_s)),
        result_sha256=None if row["result_sha256"] is None else str(row["result_sha256"]),
    )
