"""`rebar next`: proposes the campaign to run after a finished one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.errors import command_line

from ._fault_paths import require_new
from ._missing_runs import exit_if_incomplete


def propose(
    folder: Annotated[Path, typer.Argument(help="Folder of a finished campaign")],
    out: Annotated[
        Path | None, typer.Option(help="File to write; it must not exist yet. Printed if not given")
    ] = None,
) -> None:
    """Propose the next campaign, with the reasons as comments, for you to review. Ends with code 3 if runs are missing.

    Example: rebar next out/demo --out next.yaml
    """
    from bench.campaign import campaign_completeness, propose_next

    if out is not None:
        require_new(out)
    proposal = propose_next(folder, out.parent if out is not None else None)
    completeness = campaign_completeness(folder)
    lines = completeness.lines(folder) if completeness else []
    # As comments: the proposal is a campaign file, and who reads it later shall know what it rests on.
    text = "".join(f"# {line}\n" for line in lines) + proposal.text
    if out is None:
        print(text, end="")
    else:
        # Again: the file may have appeared since the first check, while the proposal was computed.
        require_new(out)
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
        for line in lines:
            print(line)
        print("\n".join(proposal.changes) or "only the seed changes: factors, ranges and replicates stay")
        print(f"{out}: review it, then run `{command_line('rebar', 'run', out)}`")
    exit_if_incomplete([completeness])
