"""The journal: what has become of every realization, in SQLite, so that a kill at any moment leaves it true.

Tables: `realizations` (one row each: ids, levels, digests, state, outcome), `attempts` (one row for each time one was begun),
`recordings` (digest of each result's recording), `stops` (the last replicate that counts, where a design point was settled),
`facts` (what the folder was made for). States: planned, running, done.
"""

from __future__ import annotations

import datetime as dt
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from bench.contracts import Outcome, SessionResult
from bench.errors import Fault, SetupError
from bench.realization import RealizationPlan

_TABLES = """
CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS realizations (
    id TEXT PRIMARY KEY, number INTEGER NOT NULL UNIQUE,
    design_point TEXT NOT NULL, replicate INTEGER NOT NULL, agent TEXT NOT NULL, levels TEXT NOT NULL,
    intent_sha256 TEXT NOT NULL, simspec_sha256 TEXT NOT NULL,
    state TEXT NOT NULL DEFAULT 'planned' CHECK (state IN ('planned', 'running', 'done')),
    outcome TEXT, reason TEXT NOT NULL DEFAULT '', wall_s REAL, result_sha256 TEXT,
    CHECK ((state = 'done') = (outcome IS NOT NULL)));
CREATE TABLE IF NOT EXISTS attempts (
    realization TEXT NOT NULL REFERENCES realizations (id), number INTEGER NOT NULL, worker TEXT NOT NULL,
    started_utc TEXT NOT NULL, ended_utc TEXT, outcome TEXT, reason TEXT NOT NULL DEFAULT '',
    PRIMARY KEY (realization, number));
CREATE TABLE IF NOT EXISTS recordings (realization TEXT PRIMARY KEY REFERENCES realizations (id), sha256 TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS stops (
    design_point TEXT NOT NULL, agent TEXT NOT NULL, replicate INTEGER NOT NULL,
    PRIMARY KEY (design_point, agent)) WITHOUT ROWID;
"""
INTERRUPTED = "interrupted"


class State(StrEnum):
    PLANNED = "planned"
    RUNNING = "running"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Entry:
    """What the journal says of one realization."""

    id: str
    design_point: str
    replicate: int
    agent: str
    levels: Mapping[str, bool | int | float | str]
    intent_sha256: str
    simspec_sha256: str
    state: State
    attempts: int
    outcome: Outcome | None
    reason: str
    wall_s: float | None
    result_sha256: str | None


@dataclass(frozen=True, slots=True)
class Planned:
    """A realization to be entered: its plan, and digests of its intent (nothing placed) and of its file in simspecs/."""

    plan: RealizationPlan
    intent_sha256: str
    simspec_sha256: str


class Journal:
    """An open journal. Every method is one transaction."""

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database

    def entries(self) -> list[Entry]:
        """All realizations in the order in which they were entered."""
        rows = self._database.execute(
            "SELECT r.id, design_point, replicate, agent, levels, intent_sha256, simspec_sha256, state, "
            "(SELECT count(*) FROM attempts a WHERE a.realization = r.id), outcome, reason, wall_s, result_sha256 "
            "FROM realizations r ORDER BY number"
        )
        return [_entry(row) for row in rows]

    def fact(self, name: str) -> str | None:
        """A fact of the folder, None when it was never noted."""
        row = self._database.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
        return None if row is None else str(row[0])

    def note(self, name: str, value: str) -> None:
        """Note a fact of the folder."""
        with self._change():
            self._database.execute("INSERT OR REPLACE INTO facts VALUES (?, ?)", (name, value))

    def enter(self, planned: Iterable[Planned]) -> None:
        """Enter realizations behind those that are there."""
        with self._change():
            (last,) = self._database.execute("SELECT coalesce(max(number), 0) FROM realizations").fetchone()
            self._database.executemany(
                "INSERT INTO realizations (id, number, design_point, replicate, agent, levels, intent_sha256, simspec_sha256) "
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                [_row(number, one) for number, one in enumerate(planned, start=last + 1)],
            )

    def start(self, realization: str, worker: str) -> int:
        """A worker begins; the number of this attempt, from 1."""
        with self._change():
            (number,) = self._database.execute(
                "SELECT count(*) + 1 FROM attempts WHERE realization = ?", (realization,)
            ).fetchone()
            self._database.execute("UPDATE realizations SET state = 'running' WHERE id = ? AND state = 'planned'", (realization,))
            self._database.execute(
                "INSERT INTO attempts (realization, number, worker, started_utc) VALUES (?, ?, ?, ?)",
                (realization, number, worker, _now()),
            )
            self._database.execute("DELETE FROM recordings WHERE realization = ?", (realization,))
        return int(number)

    def again(self, realization: str, outcome: str, reason: str) -> None:
        """The attempt came to nothing that stays; the realization is planned once more."""
        with self._change():
            self._end_attempt(realization, outcome, reason)
            self._database.execute("UPDATE realizations SET state = 'planned' WHERE id = ? AND state = 'running'", (realization,))

    def finish(self, result: SessionResult, result_sha256: str) -> None:
        """The result that stays; noted once, whatever is said later."""
        with self._change():
            self._end_attempt(result.realization, result.outcome, result.reason)
            noted = self._database.execute(
                "UPDATE realizations SET state = 'done', outcome = ?, reason = ?, wall_s = ?, result_sha256 = ? "
                "WHERE id = ? AND state != 'done'",
                (result.outcome, result.reason, result.wall_s, result_sha256, result.realization),
            )
            if noted.rowcount and result.recording_sha256 is not None:
                row = (result.realization, result.recording_sha256)
                self._database.execute("INSERT OR REPLACE INTO recordings VALUES (?, ?)", row)

    def forget(self, realization: str) -> None:
        """The result is gone or damaged: plan the realization again."""
        with self._change():
            self._database.execute(
                "UPDATE realizations SET state = 'planned', outcome = NULL, reason = '', wall_s = NULL, result_sha256 = NULL "
                "WHERE id = ?",
                (realization,),
            )

    def recordings(self) -> dict[str, str]:
        """SHA-256 of the recording that each result was made of, by realization; kept when the result is lost."""
        return dict(self._database.execute("SELECT realization, sha256 FROM recordings").fetchall())

    def stop(self, stops: Mapping[tuple[str, str], int]) -> None:
        """Note for design points and agents the last replicate that counts, in place of all that was noted before."""
        with self._change():
            self._database.execute("DELETE FROM stops")
            rows = [(*key, replicate) for key, replicate in sorted(stops.items())]
            self._database.executemany("INSERT INTO stops VALUES (?, ?, ?)", rows)

    def stops(self) -> dict[tuple[str, str], int]:
        """The last replicate that counts, by design point and agent, where one was settled."""
        rows = self._database.execute("SELECT design_point, agent, replicate FROM stops").fetchall()
        return {(point, agent): replicate for point, agent, replicate in rows}

    def release(self) -> list[str]:
        """Put back whatever a runner that is gone had begun; the ids."""
        running = [entry.id for entry in self.entries() if entry.state is State.RUNNING]
        for realization in running:
            self.again(realization, INTERRUPTED, "the runner ended before the session did")
        return running

    def faults(self, realization: str) -> int:
        """How often an attempt ended by a fault of the bench's own."""
        (count,) = self._database.execute(
            "SELECT count(*) FROM attempts WHERE realization = ? AND outcome IN (?, ?)",
            (realization, Outcome.WORKER_LOST, Outcome.BENCH_ERROR),
        ).fetchone()
        return int(count)

    def _end_attempt(self, realization: str, outcome: str, reason: str) -> None:
        self._database.execute(
            "UPDATE attempts SET ended_utc = ?, outcome = ?, reason = ? WHERE realization = ? AND ended_utc IS NULL",
            (_now(), outcome, reason, realization),
        )

    @contextmanager
    def _change(self) -> Iterator[None]:
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")


@contextmanager
def open_journal(path: Path) -> Iterator[Journal]:
    """Yield the journal, made if need be. Raises SetupError when the file is no journal."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with closing(sqlite3.connect(path, isolation_level=None, timeout=30.0)) as database:
        try:
            database.execute("PRAGMA journal_mode = WAL")
            # A power cut may lose the last transactions, never the file's sense; result.json brings them back.
            database.execute("PRAGMA synchronous = NORMAL")
            database.execute("PRAGMA foreign_keys = ON")
            database.executescript(_TABLES)
        except sqlite3.DatabaseError as error:
            remedy = "move it away: results that lie in runs/ are taken up again"
            raise SetupError(Fault(str(path), f"is no journal of a campaign: {error}", remedy)) from error
        yield Journal(database)


def _now() -> str:
    return dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")


def _row(number: int, planned: Planned) -> tuple[str | int, ...]:
    plan = planned.plan
    levels = json.dumps(dict(plan.levels))
    ids = (plan.id, number, plan.design_point, plan.replicate, plan.agent)
    return (*ids, levels, planned.intent_sha256, planned.simspec_sha256)


def _entry(row: tuple[object, ...]) -> Entry:
    realization, point, replicate, agent, levels, intent, simspec, state, attempts, outcome, reason, wall, result = row
    return Entry(
        id=str(realization),
        design_point=str(point),
        replicate=int(str(replicate)),
        agent=str(agent),
        levels=json.loads(str(levels)),
        intent_sha256=str(intent),
        simspec_sha256=str(simspec),
        state=State(str(state)),
        attempts=int(str(attempts)),
        outcome=None if outcome is None else Outcome(str(outcome)),
        reason=str(reason),
        wall_s=None if wall is None else float(str(wall)),
        result_sha256=None if result is None else str(result),
    )
