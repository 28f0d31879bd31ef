"""The command tree, and the one place where errors become exit codes."""

from __future__ import annotations

import errno
import os
import signal
import sqlite3
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Annotated

import typer

from bench.errors import RebarError, SetupError

from . import (
    _agent,
    _calibrate,
    _camera,
    _compare,
    _decomposition,
    _docs,
    _draw,
    _examples,
    _explain,
    _fly,
    _graph,
    _look,
    _machine,
    _next,
    _prose,
    _reference,
    _runs,
    _scores,
    _sessions,
    _status,
    _tension,
    _verification,
    _view,
)
from . import _campaigns as _campaigns
from ._fault_paths import path_fault
from ._option_groups import grouped
from ._outside_commands import OutsideCommands

app = typer.Typer(
    name="rebar",
    cls=OutsideCommands,
    help="How hard a situation can this drone agent be trusted in, and how sure are we?",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Help texts name fields such as actors[people], which rich would take for markup.
    rich_markup_mode=None,
)
# Errors of the operating system that are about a disk. Those about a path are the user's (`path_fault`), and any other one
# is a fault of the bench.
_DISK_ERRORS = frozenset({errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ENOSPC})
# SQLite cannot open the file, or may not write it.
_PATH_CODES = frozenset({sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM, sqlite3.SQLITE_READONLY})
# Somebody else has locked the file. A file system without locks was refused before.
_LOCK_CODES = frozenset({sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_PROTOCOL})

# Memory, processes, open files, buffers: a shortage of the host that passes.
_SHORTAGES = frozenset({errno.ENOMEM, errno.EAGAIN, errno.EMFILE, errno.ENFILE, errno.ENOBUFS})


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"rebar {version('rebar-bench')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version")
    ] = False,
) -> None:
    """Options of the command itself."""


# In the order of `rebar --help`.
for command in (
    *(_campaigns.demo, grouped(_campaigns.run), _campaigns.retry, _campaigns.merge, _campaigns.realize),
    *(_campaigns.report, _verification.verify, _verification.sign),
    *(_status.status, _status.pause, _status.resume),
    *(_sessions.simulate, _scores.score, _runs.runs, _runs.check, _compare.compare, _calibrate.calibrate),
    *(_view.view, _explain.explain, _draw.draw, _graph.graph, _look.schema, _look.difficulty),
):
    app.command()(command)
for command in (
    *(_prose.prose, _tension.tension, grouped(_fly.fly), _next.propose),
    *(
        _docs.docs,
        _examples.examples,
        _reference.measures,
        _reference.tables,
        _machine.doctor,
    ),
):
    app.command("next" if command is _next.propose else None)(command)
_GROUPS: tuple[tuple[str, str, tuple[Callable[..., None], ...]], ...] = (
    ("decomposition", "Check decompositions.", (_decomposition.check,)),
    (
        "camera",
        "Draw what the rendered camera can show, and what it showed.",
        (_camera.sheet, _camera.frames),
    ),
)
for name, summary, members in _GROUPS:
    group = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
    for member in members:
        group.command()(member)
    # Without a second command the group would vanish, and its command with it.
    group.callback(help=summary)(lambda: None)
    app.add_typer(group, name=name)
app.add_typer(_agent.agent)


@cache
def _commands() -> Callable[..., object]:
    """The tree as the command-line library calls it; reading every signature takes longer than most commands do."""
    return typer.main.get_command(app)


def _check_utf8(name: str) -> None:
    """Raises SetupError for a name that no document can hold: found only when one is written, it would cost the flights."""
    try:
        name.encode()
    except UnicodeEncodeError:
        raise SetupError(name, "is not UTF-8", "rename it") from None


def _told(text: object, code: int) -> int:
    """The exit code, once the user is told why."""
    print(f"rebar: {text}", file=sys.stderr)
    return code


def _journal_failed(error: sqlite3.DatabaseError) -> int:
    if not isinstance(error, sqlite3.OperationalError):
        text = f"the journal was damaged while it was in use: {error}. Check the disk, then run again."
        return _told(text, 1)
    # The first byte is the kind of error.
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    remedy = (
        "Another program holds it: close that, then run again."
        if code in _LOCK_CODES
        else "Free some space or correct the file's permissions, then run again."
    )
    return _told(f"cannot write the journal: {error}. {remedy}", 2 if code in _PATH_CODES else 1)


def _host_failed(error: OSError) -> int:
    """Raises what is no fault of the host either."""
    if error.errno in _SHORTAGES:
        text = f"the host has no more of something that this needs: {error.strerror}. "
        remedy = "End other programs or raise the limits (ulimit -a), then run again: no result is lost."
        return _told(text + remedy, 1)
    if (wrong_path := path_fault(error)) is not None:
        return _told(wrong_path, 2)
    if error.errno not in _DISK_ERRORS:
        raise error
    where = error.filename or "writing"
    return _told(f"{where}: {error.strerror}. Free some space or check the disk, then run again.", 1)


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code."""
    try:
        for name in (os.getcwd(), *arguments):
            _check_utf8(name)
        _commands()(args=list(arguments))
    # The command-line library reports usage errors, --help and Exit this way.
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except SetupError as error:
        # One line for each fault, so that all of them can be fixed before the next try.
        for fault in error.faults:
            _told(fault, 2)
        return 2
    except RebarError as error:
        return _told(error, 1)
    # SQLite reports a full or read-only disk by an exception of its own, which is no OSError.
    except sqlite3.DatabaseError as error:
        return _journal_failed(error)
    except BrokenPipeError:
        # The reader of the output, such as `head`, has seen enough. Python would complain again at its exit when it
        # flushes what nobody reads.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except OSError as error:
        return _host_failed(error)
    except RuntimeError as error:
        # How pathlib puts ELOOP before Python 3.13.
        if not str(error).startswith("Symlink loop"):
            raise
        return _told(f"{error} (remove the link, or name another path)", 2)
    except KeyboardInterrupt:
        # 128 + SIGINT, as shells report an interrupted command.
        return _told("interrupted", 130)
    return 0
