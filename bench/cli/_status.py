"""Commands for a campaign that runs in another terminal: status, pause, resume."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.errors import command_line

Folder = Annotated[Path, typer.Argument(help="Folder of a campaign")]


def status(
    folder: Folder,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON (rebar schema campaign-state)")] = False,
) -> None:
    """Show where a campaign stands, also while it runs. Changes nothing.

    Example: rebar status out/demo
    """
    from bench.campaign import campaign_state

    state = campaign_state(folder)
    if as_json:
        print(state.model_dump_json(indent=1, ensure_ascii=True))
        return
    doing = f"run by process {state.process}" if state.process else "not running"
    end = "complete" if state.complete else "not complete"
    print(f"{state.campaign}: {state.done} of {state.total} realizations have a result; {end}; {doing}")
    if state.paused:
        print(f"paused: no session starts until `{command_line('rebar', 'resume', folder)}`")
    for name, counts in (("outcomes", state.outcomes), ("missing", state.missing)):
        if counts:
            print(f"{name}: {', '.join(f'{count} {outcome}' for outcome, count in counts.items())}")
    if state.running:
        print(f"in the air: {', '.join(state.running)}")
    if state.retried:
        print(f"flown more than once: {state.retried}")
    if state.left_s is not None and not state.paused:
        print(f"left: about {_span(state.left_s)}, if sessions go on as they did")


def pause(folder: Folder) -> None:
    """Let no further session of a campaign start; those that fly go on. Also before it is run again.

    Example: rebar pause out/demo
    """
    from bench.campaign import pause_campaign

    print(f"{folder}: paused" if pause_campaign(folder) else f"{folder}: was paused already")


def resume(folder: Folder) -> None:
    """Let the sessions of a paused campaign start again. It must still be running; else run it again too.

    Example: rebar resume out/demo
    """
    from bench.campaign import resume_campaign

    print(f"{folder}: goes on" if resume_campaign(folder) else f"{folder}: was not paused")


def _span(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 120 else f"{minutes / 60:.1f} h"
