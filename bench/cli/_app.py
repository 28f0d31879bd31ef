"""The command tree and the one place where errors become exit codes."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import click
import typer

from bench.errors import RebarError, SetupError

from . import _campaigns, _fly, _look, _machine, _scores, _sessions

app = typer.Typer(
    name="rebar",
    help="How hard a situation can this drone agent be trusted in, and how sure are we?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for commands in (_campaigns, _sessions, _scores, _look, _fly, _machine):
    commands.register(app)


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code."""
    try:
        code = app(args=list(arguments), standalone_mode=False)
    except click.exceptions.Exit as wish:
        return wish.exit_code
    except click.ClickException as error:
        error.show()
        return 2
    except click.Abort:
        return 130
    except SetupError as error:
        for fault in error.faults:
            print(f"rebar: {fault}", file=sys.stderr)
        return 2
    except RebarError as error:
        print(f"rebar: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("rebar: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    return code if isinstance(code, int) else 0
