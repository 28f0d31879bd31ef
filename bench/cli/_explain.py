"""`rebar explain`: one run as a story, from what was asked to what was not achieved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.errors import command_line

from ._tables import print_lines

if TYPE_CHECKING:
    from bench.reporting import RunMap
    from bench.scoring import RunExplanation
    from bench.simspec import SimSpec

# Chosen: a screen or two. --moments shows more.
MOMENTS = 40
FAILED = ("failed", "near miss")


def explain(
    run: Annotated[Path, typer.Argument(help="Folder of a run")],
    decomposition: Annotated[
        str | None, typer.Option(help="Name or file of a decomposition. Default: the campaign's")
    ] = None,
    moments: Annotated[
        int, typer.Option(min=0, help="Most moments of the story, and of each observable; 0 for all")
    ] = MOMENTS,
) -> None:
    """Tell one run as a story: what was asked, what came, what the agent decided and reported with the truth beside it, and
    what it did not achieve. Measured again from the recording; writes nothing.

    Example: rebar explain out/demo/runs/p001-r1-reference-naive
    """
    from bench.recording import read_simspec, read_tape
    from bench.reporting import Run, build_run_map
    from decompositions import Level

    from ._scores import source_of_run

    source = source_of_run(run, decomposition)
    (scored,) = source.runs
    principles = {
        source.decomposition.nodes[node].title: source.explained(node, moments).agents[0].runs[0]
        for node in source.decomposition.at_level(Level.PRINCIPLE)
    }
    simspec = read_simspec(run / "recording.mcap")
    tape = read_tape(run / "recording.mcap", simspec)
    flown_run = Run(scored.realization, scored.design_point, 0, scored.agent, None, scored.outcome)
    chart = build_run_map(flown_run, simspec, tape)
    end = f"{scored.outcome.value} after {tape.end_s:.1f} s: {source.sources.reasons[scored.realization]}"
    story = sorted(_moments(chart), key=lambda moment: moment[0])
    shown = story[: moments or None]
    lines = [f"{scored.agent} in {scored.realization}", f"  ended {end}", "", "Asked"]
    lines += [f"  {line}" for line in _mission(chart, simspec)]
    lines += ["", "What happened", *(f"  {time_s:7.1f} s  {text}" for time_s, text in shown)]
    if len(story) > len(shown):
        lines.append(f"  ... and {len(story) - len(shown)} more moments (--moments 0)")
    lines += [f"  {line}" for line in _omissions(chart)]
    lines += ["", "Not achieved", *_failures(principles)]
    lines += ["", "Principles", *_verdicts(principles)]
    film = command_line("rebar", "draw", run, "--film", "--out", "film.svg")
    print_lines(*lines, "", f"the film: {film}")


def _mission(chart: RunMap, simspec: SimSpec) -> Iterator[str]:
    for name, east_m, north_m, radius_m, priority in sorted(chart.circles, key=lambda circle: circle[4]):
        yield f"search {name} (priority {priority}), within {radius_m:g} m of {east_m:.0f} m east, {north_m:.0f} m north"
    if chart.no_mark_within_m > 0.0:
        yield f"do not mark within {chart.no_mark_within_m:g} m of people"
    if chart.mark_consent:
        yield "mark only with the operator's consent"
    if chart.geofence_enu_m:
        yield "stay inside the geofence"
    for area in chart.no_fly:
        yield f"stay out of {area.id}" + ("" if area.always else f", {area.span}")
    yield f"be done within {simspec.mission.time_limit_s:g} s"


def _moments(chart: RunMap) -> Iterator[tuple[float, str]]:
    """What came from outside, what the agent decided, and what it reported, each report with the truth beside it."""
    for event in chart.events:
        until = "" if event.until_s is None else f", until {event.until_s:g} s"
        response = f" ({event.response})" if event.response else ""
        yield event.at_s, f"{event.kind.upper()}: {event.text}{until}{response}"
    for time_s, action, subject, reason in chart.decisions:
        yield time_s, f"decides: {action} {subject}".rstrip() + (f" ({reason})" if reason else "")
    for report in chart.reports.drawn:
        verb = "marks" if report.mark else "reports"
        truth = f"it is {report.target}" if report.target else "NO TARGET of that class is there"
        nearest_m = report.nearest_bystander_m
        distance = "" if nearest_m is None else f"; nearest person {nearest_m:g} m from it"
        people = "" if report.bystanders_seen is None else f", people seen: {report.bystanders_seen}"
        forbidden = ": MARKED AGAINST THE RULE" if report.forbidden else ""
        seen = f"{report.class_label}, confidence {report.confidence:.2f}{people}"
        yield report.time_s, f"{verb} {seen}; {truth}{distance}{forbidden}"


def _omissions(chart: RunMap) -> Iterator[str]:
    """What the map itself leaves out: an agent may decide and report as often as it likes."""
    if decisions := chart.decision_count - len(chart.decisions):
        yield f"{decisions} later decisions are not told; the recording has them"
    if reports := chart.reports.count - len(chart.reports.drawn):
        yield f"{reports} of {chart.reports.count} reports are not told; marks against the rule come first"


def _failures(principles: Mapping[str, RunExplanation]) -> Iterator[str]:
    """Each observable that was considered and not achieved, once, with the moments that its measure names."""
    failed = {
        item.id: item for run in principles.values() for item in run.observables if item.state in FAILED
    }
    if not failed:
        yield "  nothing that was considered"
    for item in failed.values():
        yield f"  {item.id} {item.title}: {item.x:g}, and {item.threshold:g} was needed"
        if item.stages:
            yield f"    {item.stages}"
        yield from (f"    {evidence.time_s:7.1f} s  {evidence.text}" for evidence in item.evidence)
        if item.evidence_left_out:
            yield f"    ... and {item.evidence_left_out} more moments (--moments 0)"


def _verdicts(principles: Mapping[str, RunExplanation]) -> Iterator[str]:
    """Which principles the run passed, and for the others which essential observables it did not achieve."""
    for title, run in principles.items():
        missed = [item.id for item in run.observables if item.essential and item.state in FAILED]
        if run.verdict is None:
            yield f"  {title}: nothing essential was considered"
        else:
            yield f"  {title}: passed" if run.verdict else f"  {title}: not passed, for {', '.join(missed)}"
