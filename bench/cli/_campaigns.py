"""Commands over a campaign's folder: demo, run, realize, report, verify."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from ._named import named

if TYPE_CHECKING:
    from bench.campaign import Campaign, CampaignEstimate


def register(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (demo, run, realize, report, verify):
        app.command()(command)


def demo(
    out: Annotated[Path, typer.Option(help="Folder of the campaign")] = Path("out/demo"),
    workers: Annotated[int | None, typer.Option(min=1, help="Sessions at once; as many as there are cores by default")] = None,
) -> None:
    """Fly the demo campaign: twelve scenes, each by both reference agents, to its report. Example: rebar demo"""
    _run(_demo_campaign(), out, workers, as_json=False)


def run(
    campaign: Annotated[Path, typer.Argument(help="A campaign (YAML or JSON)")],
    out: Annotated[Path | None, typer.Option(help="Folder of the campaign; out/NAME by default")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Sessions at once; as many as there are cores by default")] = None,
    executor: Annotated[str, typer.Option(help="local (dask is not there yet)")] = "local",
    again: Annotated[
        list[str] | None, typer.Option(metavar="OUTCOME", help="Fly once more what ended so, bench_error for one; repeatable")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what would be flown and, by surrogates, what to expect of it; fly nothing")
    ] = False,
    session_s: Annotated[
        float | None, typer.Option("--session-s", min=0.001, help="Host seconds of a core for one session, for --dry-run's cost")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the scores for a machine to read")] = False,
) -> None:
    """Fly a campaign, or go on with one that was interrupted. Example: rebar run campaigns/paper.yaml --out out/paper"""
    from bench.errors import Fault, SetupError

    if executor != "local":
        raise SetupError(Fault("--executor", f"{executor!r} is not there yet", "use local; docs/scope.md says what is there"))
    if dry_run:
        with named(campaign):
            _say_plan(campaign, workers, session_s, as_json=as_json)
        return
    with named(campaign):
        _run(campaign, out, workers, as_json=as_json, again=tuple(again or ()))


def realize(
    campaign: Annotated[Path, typer.Argument(help="A campaign (YAML or JSON)")],
    out: Annotated[Path, typer.Option(help="Folder for simspecs/")] = Path("out/realized"),
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; as many as there are cores by default")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For a machine to read, with how good the design is")] = False,
) -> None:
    """Design and placement only: write every realized SimSpec. Example: rebar realize campaigns/demo.yaml --out out/scenes"""
    from bench.campaign import CampaignFolder, campaign_quality, load_campaign, realizations, write_scenes

    asked = load_campaign(campaign)
    with named(campaign):
        plans = realizations(asked)
        infeasible = write_scenes(plans, CampaignFolder(out), workers or len(os.sched_getaffinity(0)))
    written = [plan.id for plan in plans if plan.id not in infeasible]
    if as_json:
        quality = campaign_quality(asked).model_dump(mode="json")
        print(json.dumps({"folder": str(out), "written": written, "infeasible": infeasible, "design": quality}, indent=1))
    else:
        print(f"{len(written)} realized SimSpecs in {out / 'simspecs'}")
        for name, reason in infeasible.items():
            print(f"{campaign}: {name}: {reason}")
    if infeasible:
        raise typer.Exit(1)


def report(folder: Annotated[Path, typer.Argument(help="Folder of a campaign")]) -> None:
    """Score what lies in a campaign's folder and write its report. Example: rebar report out/demo"""
    from bench.campaign import finish_campaign

    finished = finish_campaign(folder)
    missing = finished.outcomes.get("not finished", 0)
    if missing:
        print(f"{missing} realizations have no result, or none that fits its recording: `rebar run` flies them again")
    print(finished.report)


def verify(
    folder: Annotated[Path, typer.Argument(help="Folder of a campaign")],
    as_json: Annotated[bool, typer.Option("--json", help="For a machine to read")] = False,
) -> None:
    """Check every file of a campaign against the digests of its manifest. Example: rebar verify out/demo"""
    from bench.campaign import verify_folder

    faults = [str(fault) for fault in verify_folder(folder)]
    if as_json:
        print(json.dumps({"folder": str(folder), "faults": faults}))
    else:
        print("\n".join(faults) or f"{folder}: everything is as the manifest says")
    if faults:
        raise typer.Exit(1)


def _demo_campaign() -> Path:
    """The demo's file: inside an installed distribution, beside the packages in a checkout."""
    packaged = Path(__file__).with_name("demo.yaml")
    return packaged if packaged.is_file() else Path(__file__).parents[2] / "campaigns" / "demo.yaml"


def _run(path: Path, out: Path | None, workers: int | None, *, as_json: bool, again: tuple[str, ...] = ()) -> None:
    from bench.campaign import (
        FinishedCampaign,
        finish_campaign,
        load_campaign,
        load_measurable_decomposition,
        parse_rerun_outcomes,
        run_campaign,
    )

    from ._progress import open_progress
    from ._scores import campaign_report

    campaign = load_campaign(path)
    asked = load_measurable_decomposition(campaign.decomposition)
    folder = out or Path("out") / campaign.name
    finished: list[FinishedCampaign] = []
    with open_progress(campaign.name, quiet=as_json) as progress:
        summary = run_campaign(
            campaign,
            folder,
            asked,
            workers=workers,
            on_event=progress,
            rerun=parse_rerun_outcomes(again),
            finish=lambda place: finished.append(finish_campaign(place.path)),
        )
    if not finished:
        print(
            f"{summary.done} of {summary.total} realizations have a result ({summary.stopped}); run the same command again to go on"
        )
        raise typer.Exit(130)
    (scores,) = finished
    if as_json:
        print(campaign_report(folder).model_dump_json(indent=1))
        return
    from bench.reporting import score_table

    console = Console(width=None if Console().is_terminal else 140)
    table = score_table(scores.summary, scores.study)
    if campaign.fidelity == "overhead":
        table.title = f"{table.title} – OVERHEAD FIDELITY: surrogates on a ground plan, not the agents themselves"
    console.print(table)
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in sorted(scores.outcomes.items()))
    print(f"{summary.total} sessions ({summary.flown} flown now, in {summary.wall_s:.0f} s): {outcomes}")
    print(f"report: {scores.report}")


def _say_plan(path: Path, workers: int | None, session_s: float | None, *, as_json: bool) -> None:
    from bench.campaign import campaign_quality, load_campaign, load_measurable_decomposition, realizations

    campaign = load_campaign(path)
    load_measurable_decomposition(campaign.decomposition)  # its faults, before anything is said
    plans = realizations(campaign)
    points = {plan.design_point for plan in plans}
    limit_s = campaign.situation.mission.time_limit_s
    quality = campaign_quality(campaign)
    if as_json:
        told = {"campaign": campaign.name, "realizations": len(plans), "most_simulated_s": len(plans) * limit_s}
        estimate, why_not = _expected(campaign, workers, session_s)
        expected = {"estimate": estimate.model_dump(mode="json")} if estimate else {"estimate": None, "no_estimate": why_not}
        print(json.dumps({**told, "design": quality.model_dump(mode="json"), **expected}, indent=1))
        return
    print(f"{campaign.name}: {len(plans)} realizations of {len(points)} design points, {len(campaign.agents)} agent(s)")
    print(f"at most {len(plans) * limit_s / 3600:.1f} simulated hours ({limit_s:g} s each)")
    for line in quality.lines():
        print(line)
    estimate, why_not = _expected(campaign, workers, session_s)
    for line in estimate.lines() if estimate else [f"no estimate: {why}" for why in why_not]:
        print(line)


def _expected(campaign: Campaign, workers: int | None, session_s: float | None) -> tuple[CampaignEstimate | None, list[str]]:
    """What surrogates expect of a campaign, or why they cannot say."""
    from bench.campaign import estimate_campaign
    from bench.errors import SetupError

    count = workers or campaign.budgets.workers or len(os.sched_getaffinity(0))
    try:
        return estimate_campaign(campaign, count, session_s), []
    except SetupError as error:
        return None, [str(fault) for fault in error.faults]
