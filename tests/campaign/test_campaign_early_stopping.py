"""Design points that stop early: what counts follows from the results in the order of replicates, and from
nothing else.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import early_stopping_fakes
import polars as pl
import pytest
from campaign_fakes import entries, known, to_scores
from early_stopping_fakes import fly_drawn, made_up_decomposition, passes, stopping_campaign
from hypothesis import given, settings
from hypothesis import strategies as st
from in_process_executor import open_in_process

from bench.campaign import (
    FLOWN_AFTER_STOP,
    CampaignAgent,
    CampaignFolder,
    JournalEntry,
    Manifest,
    RealizationStarted,
    RealizationState,
    Stopping,
    finish_campaign,
    load_measurable_decomposition,
    open_journal,
    read_result,
    read_runs,
    verify_folder,
)
from bench.campaign.early_stopping._decisions import PointKey, StoppingDecisions
from bench.contracts import Observation, Outcome, SessionResult
from bench.errors import SetupError
from bench.reporting.text._outcomes import AFTER_STOP
from bench.scoring import score_table
from bench.statistics import StoppingRule
from decompositions import Decomposition


def stops(folder: Path) -> dict[tuple[str, str], int]:
    with open_journal(folder / "journal.sqlite") as journal:
        return journal.stops()


def scored(folder: Path) -> pl.DataFrame:
    """The score table as it would be written."""
    campaign = read_runs(folder)
    return score_table(campaign.decomposition, campaign.runs, campaign.study)


def counting(folder: Path) -> dict[str, int]:
    """How many replicates count at each design point."""
    names = scored(folder).group_by("design_point").agg(pl.col("realization").n_unique())
    return dict(names.rows())


def expected_stop(point: str, replicates: int, threshold: float = 0.5, agent: str = "fake") -> int | None:
    """The rule applied to the draws themselves. The second replicate is never considered."""
    order = [replicate for replicate in range(1, replicates + 1) if replicate != 2]
    after = StoppingRule(threshold).decided_after(
        [passes(f"{point}-r{replicate}-{agent}") for replicate in order]
    )
    return None if after is None else order[after - 1]


@pytest.fixture(scope="module")
def decomposition(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_up_decomposition(tmp_path_factory.mktemp("asked"))


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, decomposition: Path) -> tuple[Path, Path]:
    """The same campaign flown to its report one session after the other, and two at a time."""
    folders = tmp_path_factory.mktemp("one"), tmp_path_factory.mktemp("two")
    campaign = stopping_campaign(decomposition, replicates=14, points=2)
    assert fly_drawn(folders[0], campaign, finish=to_scores).complete
    assert fly_drawn(folders[1], campaign, 2, finish=to_scores, open_executor=open_in_process(2)).complete
    return folders


def test_a_decided_point_stops_early(flown: tuple[Path, Path]) -> None:
    """Each point stops where the rule decides, in the order of replicates. The rest is noted as not flown, with the
    reason, and is neither a run nor a fault: only replicates up to the stop have rows.
    """
    folder, _ = flown
    expected = {
        (point, "fake"): stop for point in ("p001", "p002") if (stop := expected_stop(point, 14)) is not None
    }
    assert len(expected) == 2
    assert stops(folder) == expected
    by_id = entries(folder)
    for name, entry in by_id.items():
        stop = expected[entry.design_point, entry.agent]
        assert entry.outcome is (Outcome.COMPLETED if entry.replicate <= stop else Outcome.SETTLED), name
        assert (entry.attempts == 0) is (entry.replicate > stop)
    last = by_id["p002-r14-fake"]
    stopped_after = f"not flown: stopped early after {expected['p002', 'fake']} of 14 replicates"
    assert last.reason == f"{stopped_after} (KA-01 is passed in less than 50 % of such runs)"
    result = known(read_result(CampaignFolder(folder).run("p002-r14-fake"), "p002-r14-fake"))
    assert result.reason == last.reason
    assert verify_folder(folder) == []

    table = pl.read_parquet(folder / "scores.parquet")
    count = sum(expected.values())
    assert table["realization"].n_unique() == count
    assert table["until_settled"].all()
    outcomes = Manifest.model_validate_json((folder / "manifest.json").read_text()).outcomes
    assert outcomes == {"completed": count, "settled": 28 - count}
    every = finish_campaign(folder).summary.filter(configuration="all", node="KA-01").row(0, named=True)
    assert (every["runs"], every["excluded"], every["considered"]) == (count, 0, count - 2)
    page = (folder / "report.html").read_text()
    assert "not flown: stopped early after" in page
    assert "Not finished" not in page


def test_workers_change_nothing_that_counts(flown: tuple[Path, Path]) -> None:
    """One worker or two: the same scores.parquet, byte for byte, whatever was under way when a point stopped."""
    first, second = flown
    assert (first / "scores.parquet").read_bytes() == (second / "scores.parquet").read_bytes()
    assert stops(first) == stops(second)


@pytest.mark.parametrize(("seed", "workers"), [(1, 1), (3, 5)])
def test_two_agents_at_two_points_stop_by_their_own_results(
    tmp_path: Path, decomposition: Path, seed: int, workers: int
) -> None:
    """Any number of workers and any order of ends: each agent stops at each point where its own results say. What was
    under way then is kept, counted by name, and left out of the scores.
    """
    agents = (CampaignAgent(manifest="fake"), CampaignAgent(manifest="other"))
    campaign = stopping_campaign(decomposition, 12, 2).model_copy(update={"agents": agents})
    summary = fly_drawn(tmp_path, campaign, workers, finish=to_scores, open_executor=open_in_process(seed))

    expected = {
        (point, agent): stop
        for point in ("p001", "p002")
        for agent in ("fake", "other")
        if (stop := expected_stop(point, 12, agent=agent)) is not None
    }
    assert len(expected) >= 3
    assert stops(tmp_path) == expected
    assert summary.complete
    late = []
    for name, entry in entries(tmp_path).items():
        stop = expected.get((entry.design_point, entry.agent), 12)
        if entry.replicate <= stop:
            assert entry.outcome is Outcome.COMPLETED, name
        elif entry.outcome is not Outcome.SETTLED:
            assert entry.attempts == 1, "under way already when the point stopped"
            late.append(name)
    assert bool(late) is (workers > 1)
    assert not {*late} & {*pl.read_parquet(tmp_path / "scores.parquet")["realization"]}
    assert all((tmp_path / "runs" / name / "recording.mcap").is_file() for name in late)
    outcomes = Manifest.model_validate_json((tmp_path / "manifest.json").read_text()).outcomes
    assert outcomes.get(FLOWN_AFTER_STOP, 0) == len(late)
    assert (AFTER_STOP in (tmp_path / "report.html").read_text()) is bool(late)


def test_more_replicates_go_on_from_there(tmp_path: Path, decomposition: Path) -> None:
    """Replicates added later leave a stopped point as it is, and are flown where it is undecided.

    Nothing is flown twice.
    """
    fly_drawn(tmp_path, stopping_campaign(decomposition, 6, points=2))
    assert stops(tmp_path) == {}
    fly_drawn(tmp_path, stopping_campaign(decomposition, 12, points=2))
    again = fly_drawn(tmp_path, stopping_campaign(decomposition, 15, points=2))

    first, second = expected_stop("p001", 15), expected_stop("p002", 15)
    assert first is not None
    assert second is not None
    assert second <= 12 < first  # decided in the second round, and in the third
    assert again.flown == first - 12
    assert stops(tmp_path) == {("p001", "fake"): first, ("p002", "fake"): second}
    assert counting(tmp_path) == {"p001": first, "p002": second}
    assert all(entry.attempts <= 1 for entry in entries(tmp_path).values())


def test_another_threshold_and_none(tmp_path: Path, decomposition: Path) -> None:
    """Another threshold on the same folder flies what it needs. Without a rule, everything is flown."""
    for threshold in (0.5, 0.4, 0.9, 0.3):
        fly_drawn(tmp_path, stopping_campaign(decomposition, 14, 1, threshold=threshold))
        assert counting(tmp_path) == {"p001": expected_stop("p001", 14, threshold) or 14}, threshold

    free = stopping_campaign(decomposition, 14, 1).model_copy(update={"stopping": None})
    assert fly_drawn(tmp_path, free).outcomes == {Outcome.COMPLETED: 14}
    assert not scored(tmp_path)["until_settled"].any()


def test_new_replicates_wait_for_a_lost_result(tmp_path: Path, decomposition: Path) -> None:
    """A result before the stop is lost, and replicates are added: the second worker waits until the first one is back."""
    fly_drawn(tmp_path, stopping_campaign(decomposition, 14, 1))
    before = scored(tmp_path)
    (CampaignFolder(tmp_path).run("p001-r3-fake") / "result.json").unlink()
    events: list[Any] = []

    assert fly_drawn(tmp_path, stopping_campaign(decomposition, 16, 1), 2, observers=[events.append]).complete
    started = [event.realization for event in events if isinstance(event, RealizationStarted)]
    assert started == ["p001-r3-fake"]
    assert entries(tmp_path)["p001-r16-fake"].outcome is Outcome.SETTLED
    assert scored(tmp_path).equals(before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_interrupted_and_resumed(
    flown: tuple[Path, Path], decomposition: Path, tmp_path: Path, number: signal.Signals
) -> None:
    """Ctrl-C and kill -9 in the middle lose nothing: the scores are those of an uninterrupted campaign."""
    beside = str(Path(early_stopping_fakes.__file__).parent)
    code = "import sys; sys.path[:0] = [sys.argv[1]]; import early_stopping_fakes; early_stopping_fakes.main(*sys.argv[2:])"
    command = [sys.executable, "-c", code, beside, str(tmp_path), str(decomposition)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(11):
            assert process.stdout.readline()
        process.send_signal(number)
    campaign = stopping_campaign(decomposition, 14, 2)
    assert fly_drawn(tmp_path, campaign, 2).complete
    assert scored(tmp_path).equals(scored(flown[0]))


def test_a_node_that_is_not_there(tmp_path: Path, decomposition: Path) -> None:
    """The node is checked before anything is placed."""
    with pytest.raises(SetupError, match=r"stopping.node: there is no node 'KA-99'"):
        fly_drawn(tmp_path / "out", stopping_campaign(decomposition, node="KA-99"))
    assert not (tmp_path / "out" / "simspecs").exists()


POINTS, AGENTS, REPLICATES = ("p001", "p002"), ("a", "b"), 12
KEYS = [(point, agent) for point in POINTS for agent in AGENTS]
THRESHOLD = 0.5

Trials = dict[PointKey, list[bool | None]]
"""Whether each replicate passed, in order. None for one that is no trial."""


@pytest.fixture(scope="module")
def loaded(decomposition: Path) -> Decomposition:
    return load_measurable_decomposition(decomposition)


def realization(key: PointKey, replicate: int) -> str:
    return f"{key[0]}-r{replicate}-{key[1]}"


def entry(key: PointKey, replicate: int) -> JournalEntry:
    return JournalEntry(
        id=realization(key, replicate),
        design_point=key[0],
        replicate=replicate,
        agent=key[1],
        levels={},
        intent_sha256="",
        simspec_sha256="",
        state=RealizationState.PLANNED,
        attempts=0,
        outcome=None,
        reason="",
        wall_s=None,
        result_sha256=None,
    )


def result(key: PointKey, replicate: int, passed: bool | None) -> SessionResult:
    observations = tuple(
        Observation(
            observable=name, considered=passed is not None, x=None if passed is None else float(passed)
        )
        for name in ("OBS-001", "OBS-002")
    )
    return SessionResult(
        realization=realization(key, replicate), outcome=Outcome.COMPLETED, observations=observations
    )


def reference_stop(trials: list[bool | None]) -> int | None:
    """The first replicate at which the rule decides on the trials up to there."""
    for replicate in range(1, len(trials) + 1):
        known = [passed for passed in trials[:replicate] if passed is not None]
        if known and StoppingRule(THRESHOLD).decided_after(known) is not None:
            return replicate
    return None


trials = st.fixed_dictionaries(
    {
        # Mostly passing, mostly failing, or mixed: independent coins would hardly ever be decided in a dozen
        # replicates.
        key: st.sampled_from(
            [(True,) * 9 + (False, None), (False,) * 9 + (True, None), (True, False, None)]
        ).flatmap(
            lambda choices: st.lists(st.sampled_from(choices), min_size=REPLICATES, max_size=REPLICATES)
        )
        for key in KEYS
    }
)
every_result = [(key, replicate) for key in KEYS for replicate in range(1, REPLICATES + 1)]


@settings(max_examples=40, deadline=None)
@given(
    trials=trials,
    order=st.permutations(every_result),
    lost=st.lists(st.sampled_from(every_result), max_size=3),
)
def test_stops_follow_from_the_results_alone(
    loaded: Decomposition,
    trials: Trials,
    order: list[tuple[PointKey, int]],
    lost: list[tuple[PointKey, int]],
) -> None:
    """In any order of results, and with results lost and made again, each agent stops at each point where the
    reference does.
    """
    stopping = Stopping(node="KA-01", threshold=THRESHOLD)
    decisions = StoppingDecisions(
        stopping, loaded, [entry(key, replicate) for key, replicate in every_result]
    )
    expected = {key: reference_stop(passed) for key, passed in trials.items()}

    for key, replicate in order:
        decisions.record(result(key, replicate, trials[key][replicate - 1]))
        stop = decisions.early_stop(key)
        assert stop is None or stop.replicate == expected[key], "a gap in the replicates decides nothing"
    for key, replicate in lost:
        decisions.forget(realization(key, replicate))
        assert decisions.early_stop(key) is None or replicate > (expected[key] or 0)
    for key, replicate in lost:
        decisions.record(result(key, replicate, trials[key][replicate - 1]))

    stops = {key: decisions.early_stop(key) for key in KEYS}
    assert {key: stop and stop.replicate for key, stop in stops.items()} == expected
