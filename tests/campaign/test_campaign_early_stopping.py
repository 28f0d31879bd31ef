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
from campaign_fakes import Script, entries, fly, small_campaign
from early_stopping_fakes import fly_drawn, made_up_decomposition, passes, stopping_campaign
from in_process_executor import open_in_process

from bench.campaign import (
    FLOWN_AFTER_STOP,
    BenchBroken,
    CampaignFolder,
    Manifest,
    RealizationStarted,
    finish_campaign,
    open_journal,
    open_local_pool,
    read_result,
    read_runs,
    rescore_campaign,
    verify_folder,
)
from bench.cli._app import run as run_command
from bench.contracts import Outcome
from bench.errors import SetupError
from bench.reporting.text._outcomes import AFTER_STOP
from bench.scoring import score_table
from bench.statistics import StoppingRule


def no_finish(paths: CampaignFolder) -> None:
    """Leaves the scores to the test."""


def stops(folder: Path) -> dict[tuple[str, str], int]:
    with open_journal(folder / "journal.sqlite") as journal:
        return journal.stops()


def scored(folder: Path) -> pl.DataFrame:
    """The score table as it would be written."""
    campaign = read_runs(folder)
    return score_table(campaign.decomposition, campaign.runs, campaign.study)


def expected_stop(point: str, replicates: int, threshold: float = 0.5) -> int | None:
    """The rule applied to the draws themselves. The second replicate is never considered."""
    order = [replicate for replicate in range(1, replicates + 1) if replicate != 2]
    after = StoppingRule(threshold).decided_after(
        [passes(f"{point}-r{replicate}-fake") for replicate in order]
    )
    return None if after is None else order[after - 1]


def up_to(point: str, last: int) -> set[str]:
    """The realizations of a point up to a replicate."""
    return {f"{point}-r{replicate}-fake" for replicate in range(1, last + 1)}


def counting(folder: Path) -> set[str]:
    """Realizations that count."""
    return set(scored(folder)["realization"])


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same campaign flown to its report one session after the other in this process, and by two workers."""
    folders = tmp_path_factory.mktemp("one"), tmp_path_factory.mktemp("two")
    campaign = stopping_campaign(
        made_up_decomposition(tmp_path_factory.mktemp("asked")), replicates=14, points=2
    )
    assert fly_drawn(folders[0], campaign).complete
    assert fly_drawn(folders[1], campaign, 2, open_executor=open_local_pool).complete
    return folders


def test_a_decided_point_stops_early(flown: tuple[Path, Path]) -> None:
    """Each point stops where the rule decides, in the order of replicates.

    The rest is noted as not flown, with the reason.
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
    result = read_result(CampaignFolder(folder).run("p002-r14-fake"), "p002-r14-fake")
    assert result is not None
    assert result.reason == last.reason
    assert verify_folder(folder) == []


def test_what_is_not_flown_is_no_run_and_no_fault(flown: tuple[Path, Path]) -> None:
    """Only replicates up to the stop have rows; the manifest counts the others under a name of their own."""
    folder, _ = flown
    table = pl.read_parquet(folder / "scores.parquet")
    count = sum(stops(folder).values())
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


def test_what_was_under_way_is_kept_and_left_out(tmp_path: Path) -> None:
    """With one point and three workers sessions overlap: those after the stop stay on disk, counted by name,
    without a score.
    """
    campaign = stopping_campaign(made_up_decomposition(tmp_path / "asked"), replicates=14, points=1)
    events: list[Any] = []
    fly_drawn(tmp_path / "one", campaign, finish=no_finish)
    # A seed draws the order: between real workers it would be the host's speed that decides which sessions
    # overlap.
    fly_drawn(
        tmp_path / "three", campaign, 3, observers=[events.append], open_executor=open_in_process(seed=1)
    )

    assert scored(tmp_path / "three").equals(scored(tmp_path / "one"))
    (stop,) = stops(tmp_path / "three").values()
    begun = {event.realization for event in events if isinstance(event, RealizationStarted)}
    past = {
        name
        for name, entry in entries(tmp_path / "three").items()
        if entry.replicate > stop and name in begun
    }
    assert past
    assert all((tmp_path / "three" / "runs" / name / "recording.mcap").is_file() for name in past)
    outcomes = Manifest.model_validate_json((tmp_path / "three" / "manifest.json").read_text()).outcomes
    assert outcomes[FLOWN_AFTER_STOP] == len(past)
    assert AFTER_STOP in (tmp_path / "three" / "report.html").read_text()


def test_more_replicates_go_on_from_there(tmp_path: Path) -> None:
    """Replicates added later leave a stopped point as it is, and are flown where it is undecided.

    Nothing is flown twice.
    """
    decomposition = made_up_decomposition(tmp_path / "asked")
    fly_drawn(tmp_path / "out", stopping_campaign(decomposition, 6, points=2), finish=no_finish)
    assert stops(tmp_path / "out") == {}
    fly_drawn(tmp_path / "out", stopping_campaign(decomposition, 12, points=2), finish=no_finish)
    again = fly_drawn(tmp_path / "out", stopping_campaign(decomposition, 15, points=2), finish=no_finish)

    first, second = expected_stop("p001", 15), expected_stop("p002", 15)
    assert first is not None
    assert second is not None
    assert second <= 12 < first  # decided in the second round, and in the third
    assert again.flown == first - 12
    assert stops(tmp_path / "out") == {("p001", "fake"): first, ("p002", "fake"): second}
    assert counting(tmp_path / "out") == up_to("p001", first) | up_to("p002", second)
    assert all(entry.attempts <= 1 for entry in entries(tmp_path / "out").values())


def test_another_threshold_and_none(tmp_path: Path) -> None:
    """Another threshold on the same folder flies what it needs. Without a rule, everything is flown."""
    decomposition = made_up_decomposition(tmp_path / "asked")
    fly_drawn(tmp_path / "out", stopping_campaign(decomposition, 14, 1), finish=no_finish)
    for threshold in (0.4, 0.9, 0.3):
        fly_drawn(
            tmp_path / "out", stopping_campaign(decomposition, 14, 1, threshold=threshold), finish=no_finish
        )
        assert counting(tmp_path / "out") == up_to("p001", expected_stop("p001", 14, threshold) or 14), (
            threshold
        )

    free = stopping_campaign(decomposition, 14, 1).model_copy(update={"stopping": None})
    summary = fly_drawn(tmp_path / "out", free, finish=no_finish)
    assert summary.outcomes == {Outcome.COMPLETED: 14}
    assert not scored(tmp_path / "out")["until_settled"].any()


def test_a_lost_result_is_flown_alone(tmp_path: Path) -> None:
    """A result lost before the stop is flown again before it is decided whether others are needed."""
    campaign = stopping_campaign(made_up_decomposition(tmp_path / "asked"), 14, 1)
    fly_drawn(tmp_path / "out", campaign, finish=no_finish)
    before = scored(tmp_path / "out")
    (CampaignFolder(tmp_path / "out").run("p001-r3-fake") / "result.json").unlink()
    assert fly_drawn(tmp_path / "out", campaign, 2, finish=no_finish).flown == 1
    assert scored(tmp_path / "out").equals(before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_interrupted_and_resumed(flown: tuple[Path, Path], tmp_path: Path, number: signal.Signals) -> None:
    """Ctrl-C and kill -9 in the middle lose nothing: the scores are those of an uninterrupted campaign."""
    beside = str(Path(early_stopping_fakes.__file__).parent)
    decomposition = made_up_decomposition(tmp_path / "asked")
    code = "import sys; sys.path[:0] = [sys.argv[1]]; import early_stopping_fakes; early_stopping_fakes.main(sys.argv[2], sys.argv[3])"
    command = [sys.executable, "-c", code, beside, str(tmp_path / "out"), str(decomposition)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(11):
            assert process.stdout.readline()
        process.send_signal(number)
    campaign = stopping_campaign(decomposition, 14, 2)
    summary = fly_drawn(tmp_path / "out", campaign, 2, finish=no_finish, open_executor=open_local_pool)
    assert summary.complete
    assert scored(tmp_path / "out").equals(scored(flown[0]))


def test_a_node_that_is_not_there(tmp_path: Path) -> None:
    """The node is checked before anything is placed."""
    with pytest.raises(SetupError, match=r"stopping.node: there is no node 'KA-99'"):
        fly_drawn(
            tmp_path / "out", stopping_campaign(made_up_decomposition(tmp_path / "asked"), node="KA-99")
        )
    assert not (tmp_path / "out" / "simspecs").exists()


def test_rerun_on_request(tmp_path: Path) -> None:
    """Accepted bench errors are rerun on request, and nothing else. The old result is kept in aside/."""
    acts = {"p001-r1-fake": "raise"}
    fly(tmp_path, script=Script(acts))
    assert fly(tmp_path, accept=[Outcome.BENCH_ERROR]).flown == 0
    summary = fly(tmp_path, rerun=[Outcome.BENCH_ERROR])

    assert (summary.flown, summary.outcomes) == (1, {Outcome.COMPLETED: 6})
    assert entries(tmp_path)["p001-r1-fake"].attempts == 3
    assert "a made-up bench error" in (tmp_path / "aside" / "p001-r1-fake-2.json").read_text()
    assert verify_folder(tmp_path) == []
    with pytest.raises(SetupError, match="outcome agent_crashed cannot be rerun"):
        fly(tmp_path, rerun=[Outcome.AGENT_CRASHED])


def test_the_command_reruns_no_failure_of_an_agent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--again` takes outcomes that are not the agent's.

    Anything else is refused before a file is written.
    """
    demo = Path(__file__).parents[2] / "campaigns" / "demo.yaml"
    assert run_command(["run", str(demo), "--out", str(tmp_path / "out"), "--again", "vehicle_crashed"]) == 2
    assert "bench_error, bench_too_slow, setup_invalid, wall_budget, worker_lost" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_broken_bench_stops_the_campaign(tmp_path: Path) -> None:
    """If the first five sessions all end with bench errors, no more are started.

    Once it is fixed, everything is flown.
    """
    campaign = small_campaign(points=6)
    names = [f"p{point:03d}-r{replicate}-fake" for point in range(1, 7) for replicate in (1, 2)]
    with pytest.raises(BenchBroken, match="the first 5 sessions all failed because of the bench or the host"):
        fly(tmp_path, campaign, Script(dict.fromkeys(names, "raise")), workers=2)

    assert sum(entry.attempts for entry in entries(tmp_path).values()) <= 6
    assert {entry.outcome for entry in entries(tmp_path).values()} == {None}
    assert fly(tmp_path, campaign).outcomes == {Outcome.COMPLETED: 12}


def test_one_completed_session_is_enough_to_continue(tmp_path: Path) -> None:
    """Bench errors after a completed session are results of their own."""
    campaign = small_campaign(points=3)
    names = [f"p{point:03d}-r{replicate}-fake" for point in range(1, 4) for replicate in (1, 2)]
    summary = fly(tmp_path, campaign, Script(dict.fromkeys(names[1:], "raise")))
    assert summary.outcomes == {Outcome.BENCH_ERROR: 5, Outcome.COMPLETED: 1}


def test_an_edited_recording_is_noticed_without_its_result(tmp_path: Path) -> None:
    """The journal has the digest of the recording: with result.json deleted, an edited recording is refused."""
    campaign = stopping_campaign(made_up_decomposition(tmp_path / "asked"), 2, 1)
    fly_drawn(tmp_path / "out", campaign, finish=no_finish)
    run = CampaignFolder(tmp_path / "out").run("p001-r1-fake")
    (run / "result.json").unlink()
    (run / "recording.mcap").write_bytes(b"something else")
    with pytest.raises(SetupError, match=r"its digest differs from the one in evidence\.jsonl"):
        rescore_campaign(tmp_path / "out")
