"""Four times the realizations are four times the work: no function of a campaign's way grows with the square."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from campaign_fakes import MIXED_ENDS, fly, small_campaign
from early_stopping_fakes import made_up_decomposition, stopping_campaign
from growth import lines_of, steep
from in_process_executor import open_in_process

from bench.campaign import (
    CampaignFolder,
    Collaborators,
    Jobs,
    RunOptions,
    load_measurable_decomposition,
    open_journal,
    read_runs,
    realizations,
    run_campaign_sync,
)
from bench.campaign.storage._journal import PlannedRealization
from bench.contracts import Outcome, SessionResult
from bench.visible_text import visible

REPLICATES, SIZE = 6, 12


def flown(folder: Path, size: int) -> None:
    fly(folder, small_campaign(size // REPLICATES, REPLICATES), workers=2)


def no_finish(paths: CampaignFolder) -> None:
    """Leaves what was flown without scores and report."""


def with_a_stopping_rule(folder: Path, size: int) -> None:
    decomposition = made_up_decomposition(folder.parent)
    run_campaign_sync(
        stopping_campaign(decomposition, REPLICATES, size // REPLICATES),
        folder,
        RunOptions(load_measurable_decomposition(decomposition), workers=2),
        Collaborators(finish=no_finish, open_executor=open_in_process(), jobs=Jobs(MIXED_ENDS)),
    )


def journalled(folder: Path, size: int) -> None:
    plans = realizations(small_campaign(size // REPLICATES, REPLICATES))
    with open_journal(folder / "journal.sqlite") as journal:
        journal.add(PlannedRealization(plan, "0" * 64, "1" * 64) for plan in plans)
        for plan in plans:
            journal.start(plan.id, "w1")
            journal.finish(SessionResult(realization=plan.id, outcome=Outcome.COMPLETED), "a" * 64)
        journal.entries()


def shown(times: int) -> None:
    for _ in range(times):
        visible("a")


def test_work_that_grows_with_the_square_is_named() -> None:
    for power, names in ((1, set()), (2, {"bench/visible_text.py:visible"})):
        small, large = (lines_of(partial(shown, size**power)) for size in (SIZE, 4 * SIZE))
        assert small
        assert steep(small, large, SIZE).keys() == names


@pytest.mark.parametrize("work", [flown, with_a_stopping_rule, journalled])
def test_the_work_of_a_campaign_grows_with_its_realizations(
    tmp_path: Path, work: Callable[[Path, int], None]
) -> None:
    # Imports and caches of the process belong to no campaign.
    counts = []
    for size in (REPLICATES, SIZE, 4 * SIZE):
        (tmp_path / str(size)).mkdir()
        counts.append(lines_of(partial(work, tmp_path / str(size) / "out", size)))
    assert steep(counts[1], counts[2], SIZE) == {}


def test_reading_runs_grows_with_them(tmp_path: Path) -> None:
    counts = []
    for size in (REPLICATES, SIZE, 4 * SIZE):
        (tmp_path / str(size)).mkdir()
        with_a_stopping_rule(tmp_path / str(size) / "out", size)
        counts.append(lines_of(partial(read_runs, tmp_path / str(size) / "out")))
    assert steep(counts[1], counts[2], SIZE) == {}
