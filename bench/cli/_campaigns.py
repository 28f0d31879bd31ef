"""Commands that fly campaigns and report them: demo, run, retry, merge, realize, report."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.errors import Fault, SetupError, command_line

from ._event_lines import open_event_lines
from ._examples import shipped
from ._executors import executor_named
from ._fault_paths import file_in_faults
from ._laboratory import LaboratoryOptions, gate_of, open_laboratory, tell_end
from ._missing_runs import (
    INCOMPLETE_EXIT_CODE,
    exit_if_incomplete,
    print_missing,
    print_missing_in,
    print_rewritten,
)
from ._tables import plain_console, print_lines

if TYPE_CHECKING:
    from bench.campaign import (
        Campaign,
        CampaignEstimate,
        CampaignSummary,
        FinishedCampaign,
        OpenExecutor,
    )
    from bench.simspec import Isolation


Pace = Literal["lockstep", "realtime", "warp"]
IsolationOption = Annotated[
    Literal["auto", "bwrap", "landlock", "none"] | None,
    typer.Option(help="How every agent must be confined, in place of what its manifest says (rebar doctor)"),
]


# Commands import what they need themselves: otherwise `rebar --help` would wait for the simulator.
def register(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (demo, run, retry, merge, realize, report):
        app.command()(command)


def demo(
    out: Annotated[Path, typer.Option(help="Folder of the campaign")] = Path("out/demo"),
    workers: Annotated[
        int | None, typer.Option(min=1, help="Sessions at once. Default: the number of cores")
    ] = None,
    isolation: IsolationOption = None,
) -> None:
    """Run the demo campaign: twelve scenes, each flown by both reference agents, and a report.

    Ends with code 3 while runs are missing. The same command again flies them.

    Example: rebar demo
    """
    _run(shipped("campaigns/demo.yaml"), out, workers, as_json=False, isolation=isolation)


def run(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (YAML or JSON)")],
    out: Annotated[Path | None, typer.Option(help="Folder of the campaign. Default: out/NAME")] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Sessions at once. Default: the number of cores")
    ] = None,
    executor: Annotated[
        str,
        typer.Option(
            metavar="local|dask[=ADDRESS]",
            help="Where sessions fly: in processes of this machine, or on a Dask cluster",
        ),
    ] = "local",
    recordings: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Where workers of a Dask cluster put the recordings, for example s3://bucket/folder. Default: they come back",
        ),
    ] = None,
    again: Annotated[
        list[str] | None,
        typer.Option(
            metavar="OUTCOME",
            help="Take back --accept: fly realizations with this outcome again. Repeatable",
        ),
    ] = None,
    accept: Annotated[
        list[str] | None,
        typer.Option(
            metavar="OUTCOME",
            help="Go without the runs that have this outcome now, for example bench_error. Repeatable",
        ),
    ] = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Fly nothing. Print what would be flown, and what surrogates expect of it"
        ),
    ] = False,
    floor: Annotated[
        bool,
        typer.Option(
            "--floor",
            help="Fly null agents and an oracle on a share of the scenes as well, to see what needs no merit",
        ),
    ] = False,
    pace: Annotated[
        Pace | None,
        typer.Option(
            help="Pace of all runs, in place of the situation's. A folder keeps the pace it was flown at"
        ),
    ] = None,
    isolation: IsolationOption = None,
    shard: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Fly the I-th of N parts of the campaign, in a folder of its own; `rebar merge` joins them",
        ),
    ] = None,
    session_s: Annotated[
        float | None,
        typer.Option(
            "--session-s",
            min=0.001,
            help="Host seconds of a core for one session, to estimate the cost with --dry-run",
        ),
    ] = None,
    events: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Append every event to this file as a line of JSON"),
    ] = None,
    mqtt: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            envvar="REBAR_MQTT",
            help="Broker to tell events, status and scores: mqtt[s]://[USER@]HOST[:PORT][/PREFIX]",
        ),
    ] = None,
    mqtt_ca: Annotated[
        Path | None,
        typer.Option("--mqtt-ca", metavar="FILE", help="Certificates that vouch for the broker (PEM)"),
    ] = None,
    stand_ready: Annotated[
        str | None,
        typer.Option("--stand-ready", metavar="TOPIC", help="Before each session, wait for a message here"),
    ] = None,
    stand_announce: Annotated[
        str | None,
        typer.Option("--stand-announce", metavar="TOPIC", help="Send a message here before each session"),
    ] = None,
    stand_release: Annotated[
        str | None,
        typer.Option("--stand-release", metavar="TOPIC", help="Send a message here after each session"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the scores as JSON")] = False,
) -> None:
    """Run a campaign, or resume one that was interrupted or lost runs.

    Ends with code 3 while runs are missing that the agents did not cause. The same command again flies them.

    Example: rebar run campaigns/paper.yaml --out out/paper
    """
    open_executor = executor_named(executor, workers, recordings)
    if dry_run:
        with file_in_faults(campaign):
            _print_plan(
                campaign,
                workers,
                session_s,
                as_json=as_json,
                floor=floor,
                pace=pace,
                isolation=isolation,
                shard=shard,
            )
        return
    with file_in_faults(campaign):
        _run(
            campaign,
            out,
            workers,
            as_json=as_json,
            again=tuple(again or ()),
            accept=tuple(accept or ()),
            floor=floor,
            pace=pace,
            isolation=isolation,
            shard=shard,
            open_executor=open_executor,
            stores_recordings=recordings is not None,
            events=events,
            laboratory=LaboratoryOptions(mqtt, mqtt_ca, stand_ready, stand_announce, stand_release),
        )


def retry(
    folder: Annotated[Path, typer.Argument(help="Folder of a campaign")],
    workers: Annotated[
        int | None, typer.Option(min=1, help="Sessions at once. Default: the number of cores")
    ] = None,
    executor: Annotated[
        str,
        typer.Option(
            metavar="local|dask[=ADDRESS]", help="As for rebar run; where the campaign is not running"
        ),
    ] = "local",
) -> None:
    """Fly the missing runs of a campaign again, at once: in the process that runs it, and otherwise in this one.

    Example: rebar retry out/demo
    """
    from bench.campaign import CampaignFolder, request_retry

    open_executor = executor_named(executor, workers)
    process = request_retry(folder)
    if process is not None:
        print(f"{folder}: process {process} is asked to fly its missing runs again")
        return
    _run(CampaignFolder(folder).campaign, folder, workers, as_json=False, open_executor=open_executor)


def merge(
    shards: Annotated[list[Path], typer.Argument(help="Folders of all shards of a campaign, in any order")],
    out: Annotated[Path, typer.Option(help="Folder that is written; it must be new")],
) -> None:
    """Join the shards of a campaign to the folder that one run would have left, with its scores and report.

    Example: rebar merge out/paper-1-of-2 out/paper-2-of-2 --out out/paper
    """
    from bench.campaign import load_campaign, merge_shards

    from ._campaign_end import CampaignEnd

    end = CampaignEnd()
    summary = merge_shards(shards, out, end.finish)
    scores = end.finished
    assert scores is not None  # shards that are incomplete are refused
    print_missing(scores.completeness, out)
    _show_scores(load_campaign(out / "campaign.yaml"), out, summary, scores, ())
    if not scores.completeness.complete:
        raise typer.Exit(INCOMPLETE_EXIT_CODE)


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
) -> None:
    """Score the results in a campaign's folder and write its report. Ends with code 3 if runs are missing.

    Example: rebar report out/demo

    Example: rebar report /archive/demo --out demo.html
    """
    from bench.campaign import finish_campaign

    if out is not None:
        _report_elsewhere(folder, out)
        return
    finished = finish_campaign(folder)
    print_missing(finished.completeness, folder)
    print_rewritten(finished.rewritten)
    print(finished.report)
    if not finished.completeness.complete:
        raise typer.Exit(INCOMPLETE_EXIT_CODE)


def _report_elsewhere(folder: Path, out: Path) -> None:
    from bench.campaign import verify_folder
    from bench.reporting import write_report

    if os.path.lexists(out):
        raise SetupError(Fault(str(out), "already exists and is not overwritten", "name another file"))
    missing = print_missing_in([folder])
    # Nothing is scored again here, so the tables must be those that the bench wrote; a runner is still writing them.
    running = any(report is not None and report.running for report in missing)
    if not running and (faults := verify_folder(folder)):
        raise SetupError(faults)
    print(write_report(folder, out))
    exit_if_incomplete(missing)


def _run(
    path: Path,
    out: Path | None,
    workers: int | None,
    *,
    as_json: bool,
    again: tuple[str, ...] = (),
    accept: tuple[str, ...] = (),
    floor: bool = False,
    pace: Pace | None = None,
    isolation: Isolation | None = None,
    shard: str | None = None,
    open_executor: OpenExecutor | None = None,
    stores_recordings: bool = False,
    events: Path | None = None,
    laboratory: LaboratoryOptions | None = None,
) -> None:
    from bench.campaign import (
        load_campaign,
        load_measurable_decomposition,
        parse_accepted_outcomes,
        parse_rerun_outcomes,
        run_campaign_sync,
        with_floor,
    )

    from ._campaign_end import CampaignEnd
    from ._progress import open_progress
    from ._scores import campaign_report

    campaign = _adjusted(load_campaign(path), pace, isolation, shard)
    if stores_recordings and campaign.keep is not None:
        what = "and keep in the campaign file both say what becomes of recordings"
        raise SetupError(Fault("--recordings", what, "give one of them"))
    if floor:
        campaign = with_floor(campaign)
    try:
        decomposition = load_measurable_decomposition(campaign.decomposition)
    except SetupError as error:
        # All at once: whoever corrects the decomposition shall not then learn of a missing agent.
        raise SetupError([*error.faults, *_takeoff_faults(campaign)]) from None
    informed = () if as_json else _given_the_truth(campaign)
    folder = out or Path("out") / (campaign.name + (f"-{shard.replace('/', '-of-')}" if shard else ""))
    end = CampaignEnd()
    with (
        open_laboratory(laboratory or LaboratoryOptions(), campaign.name) as bus,
        open_progress(campaign.name, quiet=as_json) as progress,
        open_event_lines(events, campaign.name) if events else nullcontext() as event_lines,
    ):
        try:
            summary = run_campaign_sync(
                campaign,
                folder,
                decomposition,
                workers=workers,
                observers=[
                    progress,
                    end.observe,
                    *([bus.notify] if bus else []),
                    *([event_lines] if event_lines else []),
                ],
                rerun=parse_rerun_outcomes(again),
                accept=parse_accepted_outcomes(accept),
                finish=end.finish,
                open_executor=open_executor or executor_named("local", None),
                gate=gate_of(bus),
            )
        finally:
            tell_end(
                bus,
                end.finished.completeness if end.finished else None,
                campaign_report(folder).model_dump_json(exclude_none=True) if bus and end.finished else None,
            )
    if summary.events_dropped:
        print(f"WARNING: {summary.events_dropped} events were not shown or sent in time", file=sys.stderr)
    scores = end.finished
    if scores is None:
        print(
            f"INCOMPLETE: {summary.done} of {summary.total} realizations have a result ({summary.stopped}). "
            "Run the same command again to resume."
        )
        # As for an interrupted command: the campaign stopped early, by a signal or by its budget.
        raise typer.Exit(130)
    print_missing(scores.completeness, folder, as_json=as_json)
    print_rewritten(scores.rewritten)
    if as_json:
        print(campaign_report(folder).model_dump_json(indent=1, ensure_ascii=True))
    else:
        _show_scores(campaign, folder, summary, scores, informed)
    if not scores.completeness.complete:
        raise typer.Exit(INCOMPLETE_EXIT_CODE)


def _show_scores(
    campaign: Campaign,
    folder: Path,
    summary: CampaignSummary,
    scores: FinishedCampaign,
    informed: Sequence[str],
) -> None:
    from bench.campaign import CampaignFolder, digest_of
    from bench.reporting import score_tables

    if scores.saw_truth:
        print(f"SAW THE TRUTH: a honeypot was reported in {', '.join(scores.saw_truth)}; see the report")
    for label in informed:
        print(f"{label} is given the truth: its results are no agent's")
    console = plain_console()
    for table in score_tables(scores.summary, scores.study, scores.floors):
        # Nobody is to mistake predictions for flights, also where only one table is copied.
        if campaign.fidelity == "overhead":
            table.title = (
                f"{table.title} – OVERHEAD FIDELITY: surrogates on a ground plan, not the agents themselves"
            )
        console.print(table)
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in sorted(scores.outcomes.items()))
    print_lines(
        console,
        [f"{summary.total} sessions ({summary.flown} flown now, in {summary.wall_s:.0f} s): {outcomes}"],
    )
    if scores.floors:
        flat = [node.id for node in scores.floors.values() if node.flaw]
        print(
            f"{len(flat)} observables do not discriminate: "
            + command_line("rebar", "decomposition", "check", Path(campaign.decomposition), "--floor", folder)
        )
    print(f"report: {scores.report}")
    digest = digest_of(CampaignFolder(folder).manifest)
    print(f"manifest SHA-256: {digest}")
    print(f"publish it, and check it with: {command_line('rebar', 'verify', folder, '--digest', digest)}")


def _adjusted(
    campaign: Campaign, pace: Pace | None, isolation: Isolation | None, shard: str | None
) -> Campaign:
    from bench.campaign import parse_shard

    if shard is not None:
        try:
            parse_shard(shard)
        except ValueError as error:
            raise SetupError(Fault("--shard", str(error), "number the shards from 1")) from None
    options = {"pace": pace, "isolation": isolation, "shard": shard}
    return campaign.model_copy(update={name: value for name, value in options.items() if value is not None})


def _takeoff_faults(campaign: Campaign) -> list[Fault]:
    """What would keep the campaign's sessions from flying, or its design from being realized."""
    from bench.campaign import realizations, takeoff_faults

    # Surrogates fly without the agents' programs, and say for themselves what they cannot fly.
    if campaign.fidelity == "overhead":
        return []
    try:
        return takeoff_faults(plan.simspec for plan in realizations(campaign))
    except SetupError as error:
        return list(error.faults)


def _given_the_truth(campaign: Campaign) -> list[str]:
    """The labels of a campaign's agents, those of its floor included, whose manifests ask for the truth."""
    from bench.agents import load_manifest

    if campaign.fidelity == "overhead":
        return []
    specs = (*campaign.agents, *(campaign.floor.specs if campaign.floor else ()))
    labels = []
    for agent in specs:
        # A manifest that is missing is told with everything else that is wrong before take-off.
        with suppress(SetupError):
            labels += [agent.label] if load_manifest(agent.manifest)[0].truth else []
    return labels


def _print_plan(
    path: Path,
    workers: int | None,
    session_s: float | None,
    *,
    as_json: bool,
    floor: bool,
    pace: Pace | None,
    isolation: Isolation | None,
    shard: str | None,
) -> None:
    from bench.campaign import (
        campaign_quality,
        load_campaign,
        load_measurable_decomposition,
        realizations,
        situation_tensions,
        with_floor,
    )

    campaign = _adjusted(load_campaign(path), pace, isolation, shard)
    if floor:
        campaign = with_floor(campaign)
    # Only for its faults: they come before anything is printed.
    load_measurable_decomposition(campaign.decomposition)
    if wrong := _takeoff_faults(campaign):
        raise SetupError(wrong)
    plans = realizations(campaign)
    points = {plan.design_point for plan in plans}
    # Each realization has its own limit: situations, and factors, may differ in it.
    limits_s = [plan.simspec.mission.time_limit_s for plan in plans]
    quality = campaign_quality(campaign)
    if as_json:
        counts = {
            "campaign": campaign.name,
            "realizations": len(plans),
            "most_simulated_s": sum(limits_s),
        }
        estimate, faults = _estimate(campaign, workers, session_s)
        expected = (
            {"estimate": estimate.model_dump(mode="json")}
            if estimate
            else {"estimate": None, "no_estimate": faults}
        )
        stated = {"tensions": situation_tensions(campaign)} if campaign.situations else {}
        design = {"design": quality.model_dump(mode="json")}
        print(json.dumps({**counts, **design, **stated, **expected}, indent=1))
        return
    print_lines(
        plain_console(),
        [
            f"{campaign.name}: {len(plans)} realizations of {len(points)} design points, "
            f"{len(campaign.agents)} agent(s)"
        ],
    )
    if campaign.floor is not None:
        beside = sum(plan.agent in campaign.floor_labels for plan in plans)
        print(f"{beside} of them by null agents and the oracle, for the floor")
    least, most = f"{min(limits_s):g}", f"{max(limits_s):g}"
    each = least if least == most else f"{least} to {most}"
    print(f"at most {sum(limits_s) / 3600:.1f} simulated hours ({each} s each)")
    console = plain_console()
    print_lines(console, quality.lines())
    built_for = {situation.name: situation.tension for situation in campaign.situations}
    for name, tensions in situation_tensions(campaign).items():
        reached = " to ".join(map(str, dict.fromkeys((min(tensions), max(tensions))))) if tensions else "none"
        built = f", built for {built_for[name]}" if built_for[name] else ""
        print_lines(console, [f"situation {name}: tension {reached}{built}"])
    estimate, faults = _estimate(campaign, workers, session_s)
    print_lines(console, estimate.lines() if estimate else [f"no estimate: {fault}" for fault in faults])


def _estimate(
    campaign: Campaign, workers: int | None, session_s: float | None
) -> tuple[CampaignEstimate | None, list[str]]:
    """What surrogates expect of a campaign, or the faults for which they cannot fly it."""
    from bench.campaign import estimate_campaign

    count = workers or campaign.budgets.workers or len(os.sched_getaffinity(0))
    try:
        return estimate_campaign(campaign, count, session_s), []
    except SetupError as error:
        return None, [str(fault) for fault in error.faults]
