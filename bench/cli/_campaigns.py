"""Commands that fly campaigns and report them: demo, run, retry, merge, realize, report."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.errors import SetupError

from ._dry_run import faults_before_takeoff, print_plan
from ._event_lines import open_event_lines
from ._examples import shipped
from ._fault_paths import file_in_faults, require_new
from ._laboratory import open_laboratory, tell_end, warn
from ._missing_runs import exit_if_incomplete, print_missing, print_missing_in, print_rewritten
from ._run_request import CampaignChanges, IsolationOption, RunRequest, Workers

if TYPE_CHECKING:
    from bench.campaign import Campaign, CampaignSummary, FinishedCampaign
    from decompositions import Decomposition


# Commands import what they need themselves: otherwise `rebar --help` would wait for the simulator.
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the campaign")] = Path("out/demo"),
    workers: Workers = None,
    isolation: IsolationOption = None,
) -> None:
    """Run the demo campaign: twelve scenes, each flown by both reference agents, and a report.

    Ends with code 3 while runs are missing. The same command again flies them.

    Example: rebar demo
    """
    from ._campaign_end import show_finding

    request = RunRequest(out, workers, changes=CampaignChanges(isolation=isolation))
    scores = _run(shipped("campaigns/demo.yaml"), request)
    show_finding(out, scores)


def run(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (YAML or JSON)")], request: RunRequest
) -> None:
    """Run a campaign, or resume one that was interrupted or lost runs.

    Ends with code 3 while runs are missing that the agents did not cause. The same command again flies them.

    Example: rebar run campaigns/paper.yaml --out out/paper
    """
    with file_in_faults(campaign):
        if request.dry_run:
            print_plan(campaign, request)
        else:
            _run(campaign, request)


def retry(
    folder: Annotated[Path, typer.Argument(help="Folder of a campaign")], workers: Workers = None
) -> None:
    """Fly the missing runs of a campaign again, at once: in the process that runs it, and otherwise in this one.

    Example: rebar retry out/demo
    """
    from bench.campaign import CampaignFolder, request_retry

    process = request_retry(folder)
    if process is not None:
        print(f"{folder}: process {process} is asked to fly its missing runs again")
        return
    _run(CampaignFolder(folder).campaign, RunRequest(folder, workers))


def merge(
    shards: Annotated[list[Path], typer.Argument(help="Folders of all shards of a campaign, in any order")],
    out: Annotated[Path, typer.Option(help="Folder that is written; it must be new")],
) -> None:
    """Join the shards of a campaign to the folder that one run would have left, with its scores and report.

    Example: rebar merge out/paper-1-of-2 out/paper-2-of-2 --out out/paper
    """
    from bench.campaign import load_campaign, merge_shards

    from ._campaign_end import CampaignEnd, show_scores

    end = CampaignEnd()
    summary = merge_shards(shards, out, end.finish)
    scores = end.finished
    assert scores is not None  # shards that are incomplete are refused
    print_missing(scores.completeness, out)
    show_scores(load_campaign(out / "campaign.yaml"), out, summary, scores, ())
    exit_if_incomplete([scores.completeness])


def realize(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (YAML or JSON)")],
    out: Annotated[Path, typer.Option(help="Folder in which simspecs/ is written")] = Path("out/realized"),
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes. Default: the number of cores")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON, with the quality of the design")
    ] = False,
) -> None:
    """Write every realized SimSpec of a campaign without flying it.

    Example: rebar realize campaigns/demo.yaml --out out/scenes
    """
    from bench.campaign import (
        CampaignFolder,
        campaign_quality,
        check_file_system,
        load_campaign,
        realizations,
        write_scenes,
    )

    document = load_campaign(campaign)
    with file_in_faults(campaign):
        plans = realizations(document)
        out.mkdir(parents=True, exist_ok=True)
        check_file_system(out, with_locks=False)
        infeasible = write_scenes(
            plans, CampaignFolder(out), workers or len(os.sched_getaffinity(0))
        ).infeasible
    written = [plan.id for plan in plans if plan.id not in infeasible]
    if as_json:
        quality = campaign_quality(document).model_dump(mode="json")
        print(
            json.dumps(
                {"folder": str(out), "written": written, "infeasible": infeasible, "design": quality},
                indent=1,
            )
        )
    else:
        print(f"{len(written)} realized SimSpecs in {out / 'simspecs'}")
        for name, reason in infeasible.items():
            print(f"{campaign}: {name}: {reason}")
    # Scenes without room are listed above; the exit code tells a script that not all were written.
    if infeasible:
        raise typer.Exit(1)


def report(
    folder: Annotated[Path, typer.Argument(help="Folder of a campaign")],
    out: Annotated[
        Path | None,
        typer.Option(
            help="File for the report, from the scores in the folder, which is only read. It must not exist yet"
        ),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(
            help="New folder for the figures of pass rates, scores and confidences as SVG, in place of the report"
        ),
    ] = None,
    assurance: Annotated[
        Path | None,
        typer.Option(
            help="New folder for the assurance case of each agent as JSON and SVG, in place of the report; DIR is only read"
        ),
    ] = None,
) -> None:
    """Score the results in a campaign's folder and write its report. Ends with code 3 if runs are missing.

    Example: rebar report out/demo

    Example: rebar report /archive/demo --out demo.html

    Example: rebar report out/demo --assurance out/case
    """
    from bench.campaign import finish_campaign

    if sum(target is not None for target in (out, figures, assurance)) > 1:
        raise SetupError(
            "rebar report", "--out, --figures and --assurance are different documents", "give one of them"
        )
    if out is not None:
        from bench.reporting import write_report

        _write_elsewhere(folder, out, lambda: print(write_report(folder, out)))
        return
    if assurance is not None:
        _write_elsewhere(folder, assurance, lambda: _write_files(assurance, _case_files(folder)))
        return
    if figures is not None:
        from bench.reporting import figure_files, load_report_data

        _write_elsewhere(
            folder, figures, lambda: _write_files(figures, figure_files(load_report_data(folder)))
        )
        return
    finished = finish_campaign(folder)
    print_missing(finished.completeness, folder)
    print_rewritten(finished.rewritten)
    print(finished.report)
    exit_if_incomplete([finished.completeness])


def _write_files(out: Path, files: Iterator[tuple[str, str]]) -> None:
    """Write texts by their names into a new folder, which is made once all of them are there."""
    texts = list(files)
    out.mkdir(parents=True)
    for name, text in texts:
        (out / name).write_text(text, encoding="utf-8")
        print(out / name)


def _case_files(folder: Path) -> Iterator[tuple[str, str]]:
    from bench.documents import dump_json
    from bench.reporting import assurance_case, assurance_svg, load_report_data

    data = load_report_data(folder)
    for place, agent in enumerate(data.agents, start=1):
        case = assurance_case(data, agent)
        # By number: a label may hold what no file's name can.
        yield f"agent-{place}.json", dump_json(case)
        yield f"agent-{place}.svg", assurance_svg(case)


def _write_elsewhere(folder: Path, out: Path, write: Callable[[], None]) -> None:
    """Write what only reads a folder. Raises SetupError where `out` exists, or the folder's files were changed."""
    from bench.campaign import verify_folder

    require_new(out)
    missing = print_missing_in([folder])
    # Nothing is scored again here, so the tables must be those that the bench wrote; a runner is still writing them.
    running = any(report is not None and report.running for report in missing)
    if not running and (faults := verify_folder(folder)):
        raise SetupError(faults)
    write()
    exit_if_incomplete(missing)


def _run(path: Path, request: RunRequest) -> FinishedCampaign:
    from bench.campaign import (
        Collaborators,
        RunOptions,
        no_gate,
        parse_accepted_outcomes,
        parse_rerun_outcomes,
        run_campaign_sync,
    )

    from ._campaign_end import CampaignEnd
    from ._progress import open_progress
    from ._scores import campaign_report

    campaign = request.changes.load(path)
    decomposition = _decomposition(campaign)
    folder = request.folder(campaign)
    end = CampaignEnd()
    with (
        open_laboratory(request.laboratory, campaign.name) as bus,
        open_progress(campaign.name, quiet=request.as_json) as progress,
        open_event_lines(request.events, campaign.name) if request.events else nullcontext() as event_lines,
    ):
        observers = [progress, end.observe, bus.notify if bus else None, event_lines]
        try:
            summary = run_campaign_sync(
                campaign,
                folder,
                RunOptions(
                    decomposition,
                    request.workers,
                    rerun=parse_rerun_outcomes(request.again or ()),
                    accept=parse_accepted_outcomes(request.accept or ()),
                ),
                Collaborators(
                    [observer for observer in observers if observer],
                    end.finish,
                    gate=bus.is_open if bus else no_gate,
                ),
            )
        finally:
            tell_end(
                bus,
                end.finished.completeness if end.finished else None,
                campaign_report(folder).model_dump_json(exclude_none=True) if bus and end.finished else None,
            )
    return _shown_end(campaign, request, summary, end.finished)


def _shown_end(
    campaign: Campaign, request: RunRequest, summary: CampaignSummary, scores: FinishedCampaign | None
) -> FinishedCampaign:
    """Print what a run came to. Raises typer.Exit unless the campaign is complete."""
    from ._campaign_end import given_the_truth, show_scores
    from ._scores import campaign_report

    folder = summary.folder
    if summary.events_dropped:
        warn(f"{summary.events_dropped} events were not shown or sent in time")
    if scores is None:
        print(
            f"INCOMPLETE: {summary.done} of {summary.total} realizations have a result ({summary.stopped}). "
            "Run the same command again to resume."
        )
        # As for an interrupted command: the campaign stopped early, by a signal or by its budget.
        raise typer.Exit(130)
    print_missing(scores.completeness, folder, as_json=request.as_json)
    print_rewritten(scores.rewritten)
    if request.as_json:
        print(campaign_report(folder).model_dump_json(indent=1, ensure_ascii=True))
    else:
        show_scores(campaign, folder, summary, scores, given_the_truth(campaign))
    exit_if_incomplete([scores.completeness])
    return scores


def _decomposition(campaign: Campaign) -> Decomposition:
    from bench.campaign import load_measurable_decomposition

    try:
        return load_measurable_decomposition(campaign.decomposition)
    except SetupError as error:
        # All at once: whoever corrects the decomposition shall not then learn of a missing agent.
        raise SetupError([*error.faults, *faults_before_takeoff(campaign)]) from None
