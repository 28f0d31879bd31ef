"""`rebar next`: from a finished campaign to the file of the one to fly after it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.errors import Fault, SetupError


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("next")(propose)


def propose(
    folder: Annotated[Path, typer.Argument(help="Folder of a finished campaign")],
    out: Annotated[Path | None, typer.Option(help="File to write, which must not exist yet; printed when not given")] = None,
) -> None:
    """Propose the campaign to fly next, with the reasons beside it, for you to review. Example: rebar next out/demo --out next.yaml"""
    from bench.campaign import propose_next

    if out is not None and out.exists():
        raise SetupError(Fault(str(out), "exists already, and is not overwritten", "name another file"))
    proposal = propose_next(folder, out.parent if out is not None else None)
    if out is None:
        print(proposal.text, end="")
        return
    _write_new(out, proposal.text)
    print("\n".join(proposal.changes) or "no factor, range or number of replicates changes; only the seed does")
    print(f"{out}: review it, then `rebar run {out}`")


def _write_new(out: Path, text: str) -> None:
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise SetupError(Fault(str(out), "exists already, and is not overwritten", "name another file")) from None
