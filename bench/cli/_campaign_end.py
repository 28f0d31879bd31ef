"""The end of a campaign: scores and report, what they need loaded while the last sessions fly, and what is printed."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

from bench.campaign import (
    CampaignEvent,
    CampaignPlanned,
    MissingRunsRetried,
    RealizationFinished,
    RealizationStarted,
)
from bench.errors import SetupError, command_line

from ._tables import plain_console, print_lines

if TYPE_CHECKING:
    from bench.campaign import Campaign, CampaignFolder, CampaignSummary, FinishedCampaign


class CampaignEnd:
    """Scores and report of a campaign, once all have flown.

    Statistics, figures and their libraries take longer to load than the first session to start, so they are loaded late:
    as soon as a core has nothing left to fly. `finished` is None until scores and report are written.
    """

    def __init__(self, cores: int | None = None, load: Callable[[], None] | None = None) -> None:
        """`cores` are those that sessions share (default: those that this process may use). `load` imports what the end
        needs, each time that it is called.
        """
        self.finished: FinishedCampaign | None = None
        self._cores = cores or len(os.sched_getaffinity(0))
        self._load_parts = load or _load_parts
        self._remaining: int | None = None
        # A thread may get half of a module that another one is importing, where modules import each other.
        self._loading = Lock()

    def observe(self, event: CampaignEvent) -> None:
        """An observer of the campaign. It may take a second: each observer has a thread of its own."""
        if isinstance(event, CampaignPlanned | MissingRunsRetried | RealizationFinished):
            self._remaining = event.total - event.done
        # Not when the campaign is planned: until a session starts, the runner imports as well.
        if (
            isinstance(event, RealizationStarted | RealizationFinished)
            and self._remaining
            and self._remaining < self._cores
        ):
            self._load()

    def finish(self, folder: CampaignFolder) -> bool:
        """Write scores, report and manifest. True, as the runner is to know that the manifest is written."""
        self._load()
        from bench.campaign import finish_campaign

        self.finished = finish_campaign(folder.path)
        return True

    def _load(self) -> None:
        with self._loading:
            self._load_parts()


def _load_parts() -> None:
    from bench.campaign import finish_campaign  # noqa: F401
    from bench.reporting import load_page_parts

    load_page_parts()


def given_the_truth(campaign: Campaign) -> list[str]:
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


def show_scores(
    campaign: Campaign,
    folder: Path,
    summary: CampaignSummary,
    scores: FinishedCampaign,
    informed: Sequence[str],
) -> None:
    from bench.campaign import CampaignFolder, digest_of
    from bench.reporting import plural, score_tables

    if scores.silent:
        print(
            f"REPORTED NOTHING in any run: {', '.join(scores.silent)}; the scores hold nothing that was found"
        )
    if scores.saw_truth:
        print(f"SAW THE TRUTH: a honeypot was reported in {', '.join(scores.saw_truth)}; see the report")
    for label in informed:
        print(f"{label} is given the truth: its results are no agent's")
    console = plain_console()
    # Nobody is to mistake predictions for flights, also where only one table is copied.
    predicted = " – OVERHEAD FIDELITY: surrogates on a ground plan, not the agents themselves"
    note = predicted if campaign.fidelity == "overhead" else ""
    for part in score_tables(scores.summary, scores.study, scores.floors, note):
        console.print(part)
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in sorted(scores.outcomes.items()))
    sessions = plural(summary.total, "session")
    print_lines(f"{sessions} ({summary.flown} flown now, in {summary.wall_s:.0f} s): {outcomes}")
    if scores.floors:
        flat = [node.id for node in scores.floors.values() if node.flaw]
        print(
            f"{plural(len(flat), 'observable does', 'observables do')} not discriminate: "
            + command_line("rebar", "decomposition", "check", Path(campaign.decomposition), "--floor", folder)
        )
    print(f"report: {scores.report}")
    digest = digest_of(CampaignFolder(folder).manifest)
    print(f"manifest SHA-256: {digest}")
    print(f"publish it, and check it with: {command_line('rebar', 'verify', folder, '--digest', digest)}")


def show_finding(folder: Path, scores: FinishedCampaign) -> None:
    """Print on what the agents differ most, and the commands that show why."""
    from bench.reporting import finding

    difference = finding(scores.summary, scores.study)
    if difference is None:
        print("Finding: the agents passed alike.")
    else:
        sentence, node = difference
        print_lines(f"Finding: {sentence}")
        print(f"See why: {command_line('rebar', 'score', folder, '--explain', node, '--limit', '1')}")
    print(f"Look at its runs: {command_line('rebar', 'view', folder)}")
