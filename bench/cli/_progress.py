"""The progress of a campaign: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column
from rich.text import Text

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
from bench.contracts import Outcome, ProgressUpdate
from bench.visible_text import visible_output

from ._tables import CONTINUATION_INDENT, plain_console, wrapped

# Some three lines of a terminal; the report and the journal have the whole reason.
MAX_REASON_CHARACTERS = 200
# More would push the lines of failed sessions off a terminal of 24 lines.
MAX_SESSION_LINES = 8
# What stands beside a name: indent, phase, time, limit and speed, or bar, count and times. Of 80 characters 36 are left.
OTHER_CHARACTERS = 44
# Chosen: a session tells its state every two seconds.
REFRESH_HZ = 2.0


@contextmanager
def open_counter(title: str) -> Generator[OnDone]:
    """Yield what shows how many items of a long computation are done: a bar on a terminal, nothing elsewhere."""
    console = plain_console(sys.stderr)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    with _progress(console) as progress, visible_output():
        bar = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(bar, total=total, completed=done)


def _progress(console: Console) -> _Progress:
    # On a narrow terminal names give way to the numbers beside them, which are of use only whole.
    name = Column(overflow="ellipsis", no_wrap=True, max_width=max(10, console.width - OTHER_CHARACTERS))
    return _Progress(
        TextColumn("{task.description}", markup=False, table_column=name),
        BarColumn(bar_width=12),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        refresh_per_second=REFRESH_HZ,
        # Sessions end seldom: the usual half a minute would seldom hold two.
        speed_estimate_period=600.0,
    )


class _Progress(Progress):
    """A bar, below it the outcomes so far, and a line for each session that has said how far it is."""

    def __init__(self, *columns: ProgressColumn, **options: Any) -> None:
        self._outcomes: Counter[Outcome] = Counter()
        self._sessions: dict[str, ProgressUpdate] = {}
        super().__init__(*columns, **options)

    def observe(self, event: CampaignEvent) -> None:
        match event:
            case SessionProgressed(realization, update):
                self._sessions[realization] = update
            case RealizationFinished(realization, outcome):
                self._sessions.pop(realization, None)
                self._outcomes[outcome] += 1
            case RealizationRetried(realization):
                self._sessions.pop(realization, None)
            case _:
                pass

    def get_renderables(self) -> Iterator[RenderableType]:
        yield from super().get_renderables()
        # A copy: events come on a thread of their own while another one draws.
        outcomes, sessions = self._outcomes.copy(), list(self._sessions.items())
        if not outcomes and not sessions:
            return
        ended = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
        lines = [f"flown now: {ended}" if ended else ""]
        width = self.console.width - OTHER_CHARACTERS
        for name, update in sessions[:MAX_SESSION_LINES]:
            phase = (update.phase or "flying").replace("_", " ")
            states = (
                f"{phase:<10} {update.simulated_s:4.0f} of {update.time_limit_s:.0f} s, {update.speed:.0f}x"
            )
            lines.append(f"{_short(name, width):<{width}} {states}")
        if more := len(sessions[MAX_SESSION_LINES:]):
            lines.append(f"and {more} more in flight")
        yield from (Text(f"  {line}", no_wrap=True, overflow="ellipsis") for line in lines if line)


def _short(name: str, width: int) -> str:
    return name if len(name) <= width else f"{name[: width - 1]}…"


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
    with _progress(console) as progress, visible_output():
        bar = progress.add_task(title, total=None)

        def show_line(line: str) -> None:
            text = wrapped(line, console.width, CONTINUATION_INDENT)
            # Soft-wrapped, because rich would break a path that is wider than the terminal.
            progress.console.print(text, soft_wrap=True)

        def show(event: CampaignEvent) -> None:
            progress.observe(event)
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
