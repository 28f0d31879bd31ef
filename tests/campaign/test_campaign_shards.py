"""A campaign in parts, each in a folder of its own, and the folder in which they are joined."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest
from campaign_fakes import SECOND_TRY, small_campaign
from in_process_executor import open_in_process
from test_campaign_overhead import overhead

from bench.campaign import (
    Campaign,
    CampaignFolder,
    Collaborators,
    Jobs,
    Stopping,
    campaign_state,
    digest_of,
    finish_campaign,
    merge_shards,
    open_journal,
    question_sha256,
    realizations,
    run_campaign_sync,
    verify_folder,
)
from bench.cli._app import run
from bench.errors import SetupError

Fly = Callable[[Path, Campaign], None]


def three_scenes() -> Campaign:
    campaign = overhead()
    method = campaign.design.method.model_copy(update={"take": 3})
    return campaign.model_copy(update={"design": campaign.design.model_copy(update={"method": method})})


def finish(paths: CampaignFolder) -> None:
    finish_campaign(paths.path)


def part(campaign: Campaign, shard: str) -> Campaign:
    return campaign.model_copy(update={"shard": shard})


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`whole`, `1` and `2`: the campaign in one run, and in two shards, each run to its end."""
    root = tmp_path_factory.mktemp("shards")
    campaign = three_scenes()
    for name, flown in (("whole", campaign), ("1", part(campaign, "1/2")), ("2", part(campaign, "2/2"))):
        # The scores of the shards are of no use here, and their reports take seconds.
        collaborators = Collaborators(
            finish=finish if name == "whole" else None, open_executor=open_in_process()
        )
        run_campaign_sync(flown, root / name, collaborators=collaborators)
    return root


def results(folder: Path) -> dict[str, str]:
    return {path.parent.name: digest_of(path) for path in folder.glob("runs/*/*.*")}


def test_joined_shards_have_the_results_and_scores_of_one_run(folders: Path, tmp_path: Path) -> None:
    """To the byte; the folder verifies, keeps the shards' chains, and the shards are as they were."""
    whole = folders / "whole"
    before = {name: digest_of(folders / name / "manifest.json") for name in "12"}
    out = tmp_path / "out"
    summary = merge_shards([folders / "2", folders / "1"], out, finish)
    assert (summary.complete, summary.flown) == (True, 0)
    assert results(out) == results(whole)
    assert len(results(out)) == 6
    assert digest_of(out / "scores.parquet") == digest_of(whole / "scores.parquet")
    assert pl.read_parquet(out / "scores.parquet").height > 0
    assert verify_folder(out) == []
    assert before == {name: digest_of(folders / name / "manifest.json") for name in "12"}
    for name in "12":
        assert verify_folder(folders / name) == []
        assert digest_of(out / "shards" / name / "manifest.json") == before[name]
    # The same command on the joined folder has nothing to fly.
    campaign = three_scenes()
    assert run_campaign_sync(campaign, out).flown == 0


def test_attempts_and_recordings_come_along(tmp_path: Path) -> None:
    """Of sessions that were flown, each at its second attempt."""
    campaign = three_scenes().model_copy(update={"fidelity": "full"})
    campaign = campaign.model_copy(update={"budgets": campaign.budgets.model_copy(update={"retry_s": 0.0})})
    collaborators = Collaborators(jobs=Jobs(SECOND_TRY), open_executor=open_in_process())
    for number in "12":
        run_campaign_sync(part(campaign, f"{number}/2"), tmp_path / number, collaborators=collaborators)
    out = tmp_path / "out"
    assert merge_shards([tmp_path / "1", tmp_path / "2"], out, lambda paths: None).complete
    with open_journal(out / "journal.sqlite") as journal:
        assert [entry.attempts for entry in journal.entries()] == [2] * 6
    recordings = [*out.glob("runs/*/recording.mcap")]
    assert {path.read_text() for path in recordings} == {f"all of {path.parent.name}" for path in recordings}
    assert len(recordings) == 6
    assert verify_folder(out) == []


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_every_scene_is_in_one_shard_with_all_its_agents(count: int) -> None:
    """Also those of the floor; with early stopping all replicates of a design point stay together."""
    for campaign in (three_scenes(), small_campaign(points=5, replicates=3)):
        whole = realizations(campaign)
        scenes = {(plan.design_point, plan.replicate) for plan in whole}
        numbers = range(1, min(count, len(scenes)) + 1)
        parts = [realizations(part(campaign, f"{number}/{count}")) for number in numbers]
        assert sorted(plan.id for plans in parts for plan in plans) == sorted(plan.id for plan in whole)
        drawn = [{(plan.design_point, plan.replicate) for plan in plans} for plans in parts]
        assert sum(map(len, drawn)) == len(scenes)
        stopping = campaign.model_copy(update={"stopping": Stopping(node="KA-18", threshold=0.5)})
        points = [
            {plan.design_point for plan in realizations(part(stopping, f"{number}/3"))}
            for number in (1, 2, 3)
        ]
        assert sum(map(len, points)) == len({plan.design_point for plan in whole})


def test_a_shard_asks_the_same_question_and_stays_what_it_is(folders: Path) -> None:
    """Resumed without --shard it flies no more than its part; another shard does not fit into its folder."""
    campaign = three_scenes()
    assert question_sha256(part(campaign, "2/7")) == question_sha256(campaign)
    again = run_campaign_sync(campaign, folders / "1")
    assert (again.total, again.flown) == (4, 0)
    assert campaign_state(folders / "2").total == 2
    with pytest.raises(SetupError, match="holds realizations that are not in this campaign"):
        run_campaign_sync(part(campaign, "2/2"), folders / "1")


def test_what_does_not_make_a_whole_is_refused_by_name(folders: Path, tmp_path: Path) -> None:
    """One missing, one twice, no shard, of another campaign, changed, incomplete, or a folder in the way."""
    one, two, out = folders / "1", folders / "2", tmp_path / "out"
    with pytest.raises(SetupError, match="shards are missing: 2/2"):
        merge_shards([one], out, finish)
    with pytest.raises(SetupError, match="shard 1/2 is there 2 times"):
        merge_shards([one, one, two], out, finish)
    with pytest.raises(SetupError, match="is no shard"):
        merge_shards([folders / "whole", two], out, finish)
    with pytest.raises(SetupError, match="exists already"):
        merge_shards([one, two], folders, finish)
    changed = tmp_path / "changed"
    shutil.copytree(two, changed)
    next(changed.glob("runs/*/result.json")).write_text("{}")
    with pytest.raises(SetupError, match="result"):
        merge_shards([one, changed], out, finish)
    other = overhead().model_copy(update={"name": "other"})
    collaborators = Collaborators(open_executor=open_in_process())
    run_campaign_sync(part(other, "2/2"), tmp_path / "other", collaborators=collaborators)
    with pytest.raises(SetupError, match="is of another campaign"):
        merge_shards([one, tmp_path / "other"], out, finish)
    assert not out.exists()


@pytest.mark.parametrize("shard", ["0/2", "3/2", "2", "a/b", "1/2/3", "01/2"])
def test_a_shard_that_cannot_be_is_refused(shard: str, capsys: pytest.CaptureFixture[str]) -> None:
    """On the command line, with an example."""
    demo = Path(__file__).parents[2] / "campaigns" / "demo.yaml"
    assert run(["run", str(demo), "--shard", shard]) == 2
    assert "write 2/8 for the second of eight" in capsys.readouterr().err
