"""The progress of a campaign: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column

from bench.campaign import (
    CampaignEvent,
    CampaignPaused,
    CampaignPlanned,
    CampaignStopping,
    MissingRunsRetried,
    Observer,
    OnDone,
    RealizationFinished,
    RealizationRetried,
    ResultLost,
    SessionProgressed,
)
from bench.contracts import Outcome
from bench.visible_text import visible_output

from ._tables import CONTINUATION_INDENT, plain_console, wrapped

# Some three lines of a terminal; the report and the journal have the whole reason.
MAX_REASON_CHARACTERS = 200
# More would push the lines of failed sessions off a terminal of 24 lines.
MAX_SESSION_BARS = 8


@contextmanager
def open_counter(title: str) -> Generator[OnDone]:
    """Yield what shows how many items of a long computation are done: a bar on a terminal, nothing elsewhere."""
    console = plain_console(sys.stderr)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    with Progress(*_columns(), console=console) as progress, visible_output():
        bar = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(bar, total=total, completed=done)


def _columns() -> tuple[ProgressColumn, ...]:
    return (
        # The names of campaigns are long; on a narrow terminal the counts beside them must stay.
        TextColumn(
            "{task.description}", markup=False, table_column=Column(overflow="ellipsis", no_wrap=True)
        ),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )


@contextmanager
def open_progress(title: str, *, quiet: bool = False) -> Generator[Observer]:
    """Yield an observer of campaign events that shows the progress. `quiet` shows nothing."""
    if quiet:
        yield lambda event: None
        return
    # On stderr: stdout belongs to the scores, also when it is piped.
    console = plain_console(sys.stderr)
    if not console.is_terminal:
        yield _plain
        return
    # Again, around what rich puts in place of the streams: it obeys the colours in what is printed meanwhile.
    with Progress(*_columns(), console=console) as progress, visible_output():
        bar = progress.add_task(title, total=None)
        sessions = _SessionBars(progress)

        def show_line(line: str) -> None:
            text = wrapped(line, console.width, CONTINUATION_INDENT)
            # Soft-wrapped, because rich would break a path that is wider than the terminal.
            progress.console.print(text, soft_wrap=True)

        def show(event: CampaignEvent) -> None:
            sessions.show(event)
            match event:
                case CampaignPlanned(total, done):
                    progress.update(bar, total=total, completed=done)
                case MissingRunsRetried():
                    progress.update(bar, completed=event.done)
                    show_line(_line(event))
                case RealizationFinished():
                    progress.update(bar, completed=event.done)
                    # The bar shows the rest: only sessions that did not go as planned deserve a line.
                    if event.outcome not in (Outcome.COMPLETED, Outcome.SETTLED):
                        show_line(f"{event.realization}: {event.outcome}: {_brief(event.reason)}")
                case RealizationRetried() | ResultLost() | CampaignPaused() | CampaignStopping():
                    show_line(_line(event))
                case _:
                    pass

        yield show


class _SessionBars:
    """A bar for each session that has said how far it is, in simulated seconds of its time limit."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._bars: dict[str, TaskID] = {}

    def show(self, event: CampaignEvent) -> None:
        match event:
            case SessionProgressed(realization, update):
                if realization not in self._bars and len(self._bars) >= MAX_SESSION_BARS:
                    return
                if realization not in self._bars:
                    self._bars[realization] = self._progress.add_task(realization, total=update.time_limit_s)
                self._progress.update(
                    self._bars[realization],
                    completed=update.simulated_s,
                    description=f"  {realization}: {update.phase or 'flying'}, {update.speed:.0f}x",
                )
            case RealizationFinished(realization) | RealizationRetried(realization):
                if (bar := self._bars.pop(realization, None)) is not None:
                    self._progress.remove_task(bar)
            case _:
                pass


def _brief(reason: str) -> str:
    # A reason may be a whole traceback, which would push the other lines off the screen.
    return " ".join(reason.split())[:MAX_REASON_CHARACTERS]


def _plain(event: CampaignEvent) -> None:
    line = _line(event)
    if line:
        print(
            wrapped(line, plain_console(sys.stderr).width, CONTINUATION_INDENT),
            file=sys.stderr,
            flush=True,
        )


def _line(event: CampaignEvent) -> str:
    match event:
        case CampaignPlanned(total, done):
            return f"{total} realizations, {done} of them with a result"
        case RealizationFinished():
            return f"[{event.done}/{event.total}] {event.realization}: {event.outcome} ({event.wall_s:.1f} s)"
        case RealizationRetried():
            reason = _brief(event.reason)
            return f"{event.realization}: {event.outcome}, retrying in {event.pause_s:.0f} s: {reason}"
        case ResultLost(realization):
            return f"{realization}: its result or its recording is gone; it is flown again"
        case MissingRunsRetried(realizations):
            return f"flying {len(realizations)} missing runs again, as `rebar retry` asked"
        case CampaignPaused(goes_on):
            return (
                "going on" if goes_on else "paused: `rebar resume` with the campaign's folder lets it go on"
            )
        case CampaignStopping(reason):
            return f"stopping: {reason}"
        case _:
            return ""
