"""`rebar simulate`: flies one session, from a SimSpec to its observations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(simulate)


def simulate(
    simspec: Annotated[Path, typer.Argument(help="SimSpec file, base or realized (YAML or JSON)")],
    out: Annotated[Path, typer.Option(help="Folder for recording.mcap and result.json")] = Path("out"),
    decomposition: Annotated[str, typer.Option(help="Name or file of a decomposition")] = "search-and-report",
    pace: Annotated[
        Literal["lockstep", "realtime"] | None, typer.Option(help="Pace, in place of the SimSpec's")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json")] = False,
) -> None:
    """Fly one session. Example: rebar simulate examples/search.yaml --out out/first"""
    from bench.campaign import fly_realization, load_measurable_decomposition, write_result
    from bench.contracts import Outcome
    from bench.documents import dump_json
    from bench.simspec import load_simspec

    situation = load_simspec(simspec)
    if pace is not None:
        situation = situation.model_copy(update={"pace": situation.pace.model_copy(update={"mode": pace})})
    result = fly_realization(situation, load_measurable_decomposition(decomposition), out, out.name)
    # The flight does not write its result: in a campaign the runner does.
    write_result(out, result)
    if as_json:
        print(dump_json(result), end="")
    else:
        console = Console()
        if "truth" in result.details:
            console.print(
                f"the truth was {result.details['truth']}: its results are no agent's",
                markup=False,
                highlight=False,
            )
        ended = f"{result.outcome} after {result.simulated_s:.1f} simulated s ({result.wall_s:.1f} s): {result.reason}"
        if strangers := result.counters.get("tick_strangers", 0):
            console.print(
                f"connections of strangers to the tick socket, refused: {strangers}", highlight=False
            )
        # Nothing was flown, so the reason is about the file.
        if not result.simulated_s:
            ended = f"{simspec}: {ended}"
        # Reasons and evidence contain fields such as actors[people], which must not be taken for markup.
        console.print(ended, markup=False, highlight=False, soft_wrap=True)
        table = Table()
        for column in ("observable", "considered", "x", "evidence"):
            table.add_column(column, justify="right" if column == "x" else "left")
        for observation in result.observations:
            evidence = "; ".join(
                f"{moment.time_s:.1f} s {moment.text}" for moment in observation.evidence[:2]
            )
            value = "" if observation.x is None else f"{observation.x:.3f}"
            table.add_row(
                observation.observable, "yes" if observation.considered else "no", value, Text(evidence)
            )
        if result.observations:
            console.print(table)
        if (out / "recording.mcap").is_file():
            console.print(f"recording: {out / 'recording.mcap'}", highlight=False, soft_wrap=True)
    if not result.outcome.counts:
        # A SimSpec that cannot be flown is a wrong input, as any other fault in a file.
        raise typer.Exit(2 if result.outcome is Outcome.SETUP_INVALID else 1)
