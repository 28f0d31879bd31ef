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
import shutil
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from urllib.parse import quote

from bench.contracts import Outcome, SessionResult
from bench.errors import SetupError
from bench.realization import RealizationPlan
from bench.temporary_folders import temporary_folder

from ._evidence_log import EvidenceLog
from ._file_system import may_be_shared
from ._files import digest_of
from ._folder import EVIDENCE, lock_holder

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
# Host seconds to wait for another process's transaction. Chosen: each takes milliseconds.
_BUSY_S = 30.0

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
            raise _damaged(self._path, str(error)) from error

    def _entries(self) -> list[JournalEntry]:
        rows = self._database.execute(
            "SELECT r.id, design_point, replicate, agent, levels, intent_sha256, simspec_sha256, state, "
            "(SELECT count(*) FROM attempts a WHERE a.realization = r.id), outcome, reason, wall_s, result_sha256 "
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
        """Note the lasting result of a realization.

        A second result for the same realization changes nothing.
        """
        with self._change():
            self._end_attempt(result.realization, result.outcome, result.reason)
            updated = self._database.execute(
                "UPDATE realizations SET state = 'done', outcome = ?, reason = ?, wall_s = ?, result_sha256 = ? "
                "WHERE id = ? AND state != 'done'",
                (result.outcome, result.reason, result.wall_s, result_sha256, result.realization),
            )
            if updated.rowcount and result.recording_sha256 is not None:
                row = (result.realization, result.recording_sha256)
                self._database.execute("INSERT OR REPLACE INTO recordings VALUES (?, ?)", row)
            if updated.rowcount:
                # Before the journal's commit: a result that the journal has is in the chain.
                self.evidence.add_result("flown", result, result_sha256)

    def drop(self, realization: str, policy: str) -> None:
        """Note in the chain that the recording behind a result is about to be deleted."""
        with self._change():
            self.evidence.drop(realization, policy)

    def measure(self, result: SessionResult, result_sha256: str) -> None:
        """Note what measuring a recording again made of a result, in place of the result so far."""
        with self._change():
            self._database.execute(
                "UPDATE realizations SET state = 'done', outcome = ?, reason = ?, wall_s = ?, result_sha256 = ? "
                "WHERE id = ?",
                (result.outcome, result.reason, result.wall_s, result_sha256, result.realization),
            )
            if result.recording_sha256 is not None:
                row = (result.realization, result.recording_sha256)
                self._database.execute("INSERT OR REPLACE INTO recordings VALUES (?, ?)", row)
            self.evidence.add_result("measured", result, result_sha256)

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
            raise _damaged(self._path, str(error)) from error

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


@contextmanager
def open_journal(path: Path) -> Iterator[Journal]:
    """Yield the journal, created if it does not exist.

    Raises SetupError if the file is not a campaign journal, or is damaged.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with closing(sqlite3.connect(path, isolation_level=None, timeout=_BUSY_S)) as database:
        database.text_factory = _text
        try:
            _set_journal_mode(database, path.parent)
            database.execute("PRAGMA foreign_keys = ON")
            database.executescript(_TABLES)
            # Noise in the middle of the file shows only where it is read, which may be after hours of flights.
            found = [str(row[0]) for row in database.execute("PRAGMA integrity_check(3)")]
        except sqlite3.OperationalError:
            # A full or read-only disk: no fault of the journal.
            raise
        except sqlite3.DatabaseError as error:
            raise _damaged(path, str(error)) from error
        if found != ["ok"]:
            raise _damaged(path, "; ".join(found))
        journal = Journal(database, path)
        try:
            yield journal
        finally:
            # After an error of the disk there is nothing to seal, and the error is what the caller must see.
            with suppress(sqlite3.DatabaseError):
                journal.seal_if_changed()


def _set_journal_mode(database: sqlite3.Connection, folder: Path) -> None:
    # The index of a write-ahead log is memory that all processes share, so it serves those of one machine alone; and some
    # file systems cannot share memory even there.
    if not may_be_shared(folder):
        with suppress(sqlite3.OperationalError):
            if database.execute("PRAGMA journal_mode = WAL").fetchone() == ("wal",):
                # A power cut may lose the last transactions but never damages the file; `result.json` brings them
                # back.
                database.execute("PRAGMA synchronous = NORMAL")
                return
    # With SQLite's default of synchronous = FULL, without which a power cut could damage the file in this mode.
    database.execute("PRAGMA journal_mode = DELETE")


@contextmanager
def open_journal_to_read(path: Path) -> Iterator[Journal]:
    """Yield the journal of a folder that is not to be changed by a byte, also on a disk that is read-only.

    Raises SetupError if the file is not a campaign journal, or is damaged.
    """
    try:
        with _opened_to_read(path) as database:
            database.text_factory = _text
            findings = [str(row[0]) for row in database.execute("PRAGMA integrity_check(3)")]
            if findings != ["ok"]:
                raise _damaged(path, "; ".join(findings))
            yield Journal(database, path)
    # The last two: a damaged name of a column, and a damaged fact, whatever the caller asked for.
    except (sqlite3.DatabaseError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise _damaged(path, str(error)) from error


@contextmanager
def _opened_to_read(path: Path) -> Iterator[sqlite3.Connection]:
    # What a transaction has beside the file: changes that are not in it yet, or what it takes to undo those in it.
    unsettled = [
        file
        for ending in ("-wal", "-journal")
        if (file := path.with_name(path.name + ending)).is_file() and file.stat().st_size
    ]
    with ExitStack() as stack:
        if lock_holder(path.parent) is not None:
            # SQLite's locks keep reader and runner apart.
            mode = "mode=ro"
        elif not unsettled:
            # Without locks, and without an index of changes beside the file.
            mode = "mode=ro&immutable=1"
        else:
            # A killed runner has left them, and SQLite would write here to take them up.
            copy = stack.enter_context(temporary_folder("journal"))
            for file in (path, *unsettled):
                shutil.copyfile(file, copy / file.name)
            path, mode = copy / path.name, "mode=rw&vfs=unix-none"
        uri = f"file:{quote(str(path.resolve()))}?{mode}"
        database = stack.enter_context(
            closing(sqlite3.connect(uri, uri=True, isolation_level=None, timeout=_BUSY_S))
        )
        if mode.endswith("unix-none"):
            # Nobody else opens the copy, so it needs no locks, which its disk may lack.
            database.execute("PRAGMA locking_mode = EXCLUSIVE")
        yield database


def settled_journal_sha256(path: Path) -> str | None:
    """Seal the journal, move all its changes into its own file, and return the SHA-256 of that file.

    None if another process reads the journal and so keeps changes beside it.
    """
    with open_journal(path) as journal:
        journal.seal()
        return digest_of(path) if journal.settle() else None


def _text(data: bytes) -> str:
    # A damaged text is found by its digest, not by an exception in the middle of a query.
    return data.decode(errors="surrogateescape")


def _damaged(path: Path, what: str) -> SetupError:
    remedy = (
        f"restore it from a copy, or move {path.name}* away and run again: it is made anew, with the results in runs/ "
        f"that {EVIDENCE} knows"
    )
    return SetupError.of(path, f"is not a campaign journal, or is damaged: {' '.join(what.split())}", remedy)


def _now() -> str:
    return dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")


def _row(number: int, realization: PlannedRealization) -> tuple[str | int, ...]:
    plan = realization.plan
    levels = json.dumps(dict(plan.levels))
    ids = (plan.id, number, plan.design_point, plan.replicate, plan.agent)
    return (*ids, levels, realization.intent_sha256, realization.simspec_sha256)


def _entry(row: tuple[object, ...], texts: dict[str, str], known_levels: dict[str, Levels]) -> JournalEntry:
    # The columns of the query in `entries`, in its order.
    (
        realization,
        point,
        replicate,
        agent,
        levels,
        intent,
        simspec,
        state,
        attempts,
        outcome,
        reason,
        wall,
        result,
    ) = row
    if str(levels) not in known_levels:
        known_levels[str(levels)] = json.loads(str(levels))
    return JournalEntry(
        id=str(realization),
        design_point=texts.setdefault(str(point), str(point)),
        replicate=int(str(replicate)),
        agent=texts.setdefault(str(agent), str(agent)),
        levels=known_levels[str(levels)],
        intent_sha256=str(intent),
        simspec_sha256=str(simspec),
        state=RealizationState(str(state)),
        attempts=int(str(attempts)),
        outcome=None if outcome is None else Outcome(str(outcome)),
        reason=str(reason),
        wall_s=None if wall is None else float(str(wall)),
        result_sha256=None if result is None else str(result),
    )
