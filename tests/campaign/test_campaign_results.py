"""Many runs: what stays in memory of each, that no function of their way grows with the square, and what is known of
agents and scenes.
"""

from __future__ import annotations

import gc
import tracemalloc
from collections import Counter, deque
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from campaign_fakes import MIXED_ENDS, small_campaign
from early_stopping_fakes import made_up_decomposition, stopping_campaign
from growth import lines_of, steep
from in_process_executor import open_in_process
from made_run import simspec

from bench.campaign import (
    CampaignAgent,
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
from bench.campaign.results._campaign_results import CampaignResults
from bench.campaign.results._finish import _SceneDifficulty
from bench.campaign.storage._evidence_log import EvidenceLog
from bench.campaign.storage._journal import PlannedRealization
from bench.campaign.storage._results import write_result
from bench.contracts import (
    Evidence,
    Fact,
    Observation,
    Outcome,
    OverheadFidelity,
    ReportStatement,
    ReportStatements,
    SessionResult,
)
from bench.realization import RealizationPlan
from bench.scoring import difficulty_of
from bench.simspec import SimSpec
from bench.visible_text import visible
from decompositions import load_decomposition

FEW, MANY = 100, 200


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


def write_campaign(
    folder: Path, plans: Iterable[RealizationPlan], result_of: Callable[[RealizationPlan], SessionResult]
) -> CampaignFolder:
    """A campaign's folder with a result for each of its plans."""
    paths, plans = CampaignFolder(folder), [*plans]
    with open_journal(paths.journal) as journal:
        journal.add(PlannedRealization(plan, "0" * 64, "1" * 64) for plan in plans)
        for plan in plans:
            result = result_of(plan)
            journal.finish(result, write_result(paths.fresh_run(plan.id), result))
    return paths


def plans_of(count: int) -> list[RealizationPlan]:
    return realizations(small_campaign(points=2, replicates=count // 2))


def test_plans_share_what_their_design_point_has() -> None:
    """A SimSpec of its own for each plan would be ten times as much."""
    assert bytes_each(plans_of, at_peak=False) < 600


def test_results_are_read_one_at_a_time(tmp_path: Path) -> None:
    """Of each, the journal's entry and the outcome stay; with its observations, a result is ten times as much. The
    chain of evidence keeps its line.
    """
    observations = tuple(
        Observation(
            observable=f"OBS-{number:03d}",
            considered=True,
            x=number / 20,
            evidence=(Evidence(time_s=float(number), text=f"seen for the time {number}"),),
        )
        for number in range(20)
    )

    def result_of(plan: RealizationPlan) -> SessionResult:
        return SessionResult(realization=plan.id, outcome=Outcome.COMPLETED, observations=observations)

    folders = {
        count: write_campaign(tmp_path / str(count), plans_of(count), result_of) for count in (FEW, MANY)
    }

    def scored(count: int) -> CampaignResults:
        results = CampaignResults.read(folders[count])
        deque(results.ends(), maxlen=0)
        return results

    assert scored(MANY).outcomes == {"completed": MANY}
    assert bytes_each(scored, at_peak=True) < 2000
    assert bytes_each(lambda count: EvidenceLog(folders[count].evidence), at_peak=False) < 900


MEASURED = (Observation(observable="OBS-201", considered=True, x=0.0),)


@pytest.mark.parametrize(
    ("fact", "observations", "silent"),
    [
        (None, MEASURED, ("mute",)),
        # A surrogate has no reports of its own, and a run that was not measured says nothing.
        (OverheadFidelity(not_computed=()), MEASURED, ()),
        (None, (), ()),
    ],
)
def test_an_agent_is_silent_if_none_of_its_flights_has_a_report(
    fact: Fact | None, observations: tuple[Observation, ...], silent: tuple[str, ...], tmp_path: Path
) -> None:
    """Beside another, which reports in the last of its two runs alone."""
    agents = (CampaignAgent(manifest="mute"), CampaignAgent(manifest="late"))
    plans = realizations(small_campaign(points=2, replicates=1).model_copy(update={"agents": agents}))
    reporting = [plan.id for plan in plans if plan.agent == "late"][-1]
    report = ReportStatements(reports=(ReportStatement(confidence=0.9, error_m=1.0, sigma_m=None),))

    def result_of(plan: RealizationPlan) -> SessionResult:
        result = SessionResult(realization=plan.id, outcome=Outcome.COMPLETED, observations=observations)
        if plan.id == reporting:
            return result.model_copy(update={"observations": MEASURED}).with_facts(report)
        return result.with_facts(*([fact] if fact else []))

    results = CampaignResults.read(write_campaign(tmp_path, plans, result_of))
    deque(results.ends(), maxlen=0)
    assert results.silent == silent


CHANGES: tuple[dict[str, Any], ...] = (
    {},
    {"environment": {"fog_level": 4.0}},
    {"environment": {"fog_level": 5.0}},
    {"environment": {"wind": {"speed_mps": 4.0}}},
    {"mission": {"time_limit_s": 250.0}},
    {"perception": {"source": "agent"}},
)


def test_every_scene_has_the_difficulty_of_its_own_simspec(tmp_path: Path) -> None:
    """Scenes with equal factors share a difficulty; whatever changes it is a scene of its own."""
    decomposition = load_decomposition("search-and-report")
    folder: Any = SimpleNamespace(simspec=lambda name: tmp_path / name)
    scenes = _SceneDifficulty(folder, decomposition)
    seen = []
    for number, change in enumerate((*CHANGES, *CHANGES)):
        document = simspec().model_dump(mode="json")
        spec = SimSpec.model_validate(
            {**document, **{part: document[part] | value for part, value in change.items()}}
        )
        (tmp_path / str(number)).write_text(spec.model_dump_json())
        entry: Any = SimpleNamespace(id=str(number), design_point=f"p{number}", replicate=1)
        seen.append(scenes.of(entry))
        assert seen[-1] == difficulty_of(decomposition, spec)
    assert len({id(difficulty) for difficulty in seen}) == len(CHANGES)
    assert len({str(difficulty) for difficulty in seen}) >= 3


REPLICATES, SIZE = 6, 12


def with_a_stopping_rule(folder: Path, size: int) -> None:
    decomposition = made_up_decomposition(folder.parent)
    run_campaign_sync(
        stopping_campaign(decomposition, REPLICATES, size // REPLICATES),
        folder,
        RunOptions(load_measurable_decomposition(decomposition), workers=2),
        Collaborators(open_executor=open_in_process(), jobs=Jobs(MIXED_ENDS)),
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


def test_the_work_of_a_campaign_grows_with_its_realizations(tmp_path: Path) -> None:
    """Flying them, and reading what was flown; the journal alone too, with what no campaign asks of it."""
    # Imports and caches of the process belong to no campaign.
    counts: list[list[Counter[str]]] = []
    for size in (REPLICATES, SIZE, 4 * SIZE):
        out, journal = tmp_path / str(size) / "out", tmp_path / str(size) / "journal"
        journal.mkdir(parents=True)
        work = (
            partial(with_a_stopping_rule, out, size),
            partial(read_runs, out),
            partial(journalled, journal, size),
        )
        counts.append([lines_of(step) for step in work])
    for small, large in zip(*counts[1:], strict=True):
        assert steep(small, large, SIZE) == {}
