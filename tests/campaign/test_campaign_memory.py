"""What a campaign keeps in memory of each realization: bytes from N to 2 N of them, so that nothing fixed counts."""

from __future__ import annotations

import gc
import tracemalloc
from collections import deque
from collections.abc import Callable
from pathlib import Path

from campaign_fakes import small_campaign

from bench.campaign import CampaignFolder, realizations
from bench.campaign.results._campaign_results import CampaignResults
from bench.campaign.storage._evidence_log import EvidenceLog
from bench.campaign.storage._journal import PlannedRealization
from bench.campaign.storage._journal_file import open_journal
from bench.campaign.storage._results import write_result
from bench.contracts import Evidence, Observation, Outcome, SessionResult

FEW, MANY = 100, 200
OBSERVATIONS = tuple(
    Observation(
        observable=f"OBS-{number:03d}",
        considered=True,
        x=number / 20,
        evidence=(Evidence(time_s=float(number), text=f"seen for the time {number}"),),
    )
    for number in range(20)
)


def bytes_each(work: Callable[[int], object], *, at_peak: bool) -> float:
    """Bytes for each realization beyond the first FEW, of what `work` returns for so many or of its peak."""

    def traced(count: int) -> int:
        tracemalloc.start()
        try:
            kept = work(count)
            gc.collect()
            size = tracemalloc.get_traced_memory()[at_peak]
            del kept
            return size
        finally:
            tracemalloc.stop()

    # What is imported or cached at the first call stays.
    work(FEW)
    few = traced(FEW)
    return (traced(MANY) - few) / (MANY - FEW)


def write_campaign(folder: CampaignFolder, count: int) -> None:
    """A folder with so many results of 20 observations each."""
    plans = realizations(small_campaign(points=2, replicates=count // 2))
    with open_journal(folder.journal) as journal:
        journal.add(PlannedRealization(plan, "0" * 64, "1" * 64) for plan in plans)
        for plan in plans:
            result = SessionResult(realization=plan.id, outcome=Outcome.COMPLETED, observations=OBSERVATIONS)
            journal.finish(result, write_result(folder.fresh_run(plan.id), result))


def test_plans_share_what_their_design_point_has() -> None:
    """A SimSpec of its own for each plan would be ten times as much."""

    def plans(count: int) -> object:
        return realizations(small_campaign(points=2, replicates=count // 2))

    assert bytes_each(plans, at_peak=False) < 600


def test_results_are_read_one_at_a_time(tmp_path: Path) -> None:
    """Of each, the journal's entry and the outcome stay; with its observations, a result is ten times as much. The
    chain of evidence keeps its line.
    """
    folders = {count: CampaignFolder(tmp_path / str(count)) for count in (FEW, MANY)}
    for count, folder in folders.items():
        write_campaign(folder, count)

    def scored(count: int) -> object:
        results = CampaignResults.read(folders[count])
        deque(results.ends(), maxlen=0)
        return results

    assert scored(MANY).outcomes == {"completed": MANY}  # type: ignore[attr-defined]
    assert bytes_each(scored, at_peak=True) < 2000
    assert bytes_each(lambda count: EvidenceLog(folders[count].evidence), at_peak=False) < 900
