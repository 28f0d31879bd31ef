"""The journal's file: opened to be written, opened to be read without a byte of change, and sealed."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from bench.temporary_folders import temporary_folder

from ._file_system import may_be_shared
from ._files import digest_of
from ._folder import lock_holder
from ._journal import Journal, damaged

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

# Host seconds to wait for another process's transaction. Chosen: each takes milliseconds.
_BUSY_S = 30.0


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
            raise damaged(path, str(error)) from error
        if found != ["ok"]:
            raise damaged(path, "; ".join(found))
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
                raise damaged(path, "; ".join(findings))
            yield Journal(database, path)
    # The last two: a damaged name of a column, and a damaged fact, whatever the caller asked for.
    except (sqlite3.DatabaseError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise damaged(path, str(error)) from error


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
