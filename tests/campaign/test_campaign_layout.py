"""Where the runs of a large campaign lie, and that folders from before open as they did."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from test_campaign_overhead import overhead

from bench.campaign import (
    CampaignFolder,
    Collaborators,
    finish_campaign,
    merge_shards,
    read_runs,
    run_campaign_sync,
    verify_folder,
)
from bench.campaign.storage import _folder as folder_module
from bench.campaign.storage._folder import FLAT_RUNS, campaign_of, realization_in

NAMES = [f"p{point:05d}-r{replicate}-reference-naive" for point in range(1000) for replicate in range(20)]


def test_twenty_thousand_runs_lie_in_folders_of_at_most_a_thousand(tmp_path: Path) -> None:
    """SimSpecs too; and each is where its name says, without anything being looked up."""
    folder = CampaignFolder(tmp_path)
    folder.lay_out(len(NAMES))
    for paths in ([folder.run(name) for name in NAMES], [folder.simspec(name) for name in NAMES]):
        assert len(set(paths)) == len(NAMES)
        shares = Counter(path.parent for path in paths)
        assert len(shares) == 100
        assert max(shares.values()) <= 1000
    for name in NAMES[:3]:
        run = folder.fresh_run(name)
        (folder.path / "journal.sqlite").touch()
        assert campaign_of(run) == folder
        assert realization_in((run / "autopilot" / "log").relative_to(tmp_path).parts) == name
        assert realization_in(folder.simspec(name).relative_to(tmp_path).parts) == name


def test_small_campaigns_are_flat_and_grow_without_moving_anything(tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path)
    folder.lay_out(FLAT_RUNS)
    first, second = (folder.fresh_run(name) for name in NAMES[:2])
    assert [first.parent, second.parent] == [tmp_path / "runs"] * 2
    folder.lay_out(FLAT_RUNS + 1)
    assert [folder.run(name) for name in NAMES[:2]] == [first, second]
    later = folder.fresh_run(NAMES[2])
    assert later.parent.parent == tmp_path / "runs"
    assert realization_in(first.relative_to(tmp_path).parts) == NAMES[0]


def test_a_large_campaign_is_a_campaign_like_any_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Flown, resumed, verified, scored and joined from shards: the same results, in other places."""
    campaign = overhead()

    def finish(paths: CampaignFolder) -> None:
        finish_campaign(paths.path)

    def fly(name: str, shard: str | None = None) -> Path:
        part = campaign.model_copy(update={"shard": shard})
        run_campaign_sync(part, tmp_path / name, collaborators=Collaborators(finish=finish))
        return tmp_path / name

    flat = fly("flat")
    half = fly("first", "1/2")
    monkeypatch.setattr(folder_module, "FLAT_RUNS", 1)
    split, other = fly("split"), fly("second", "2/2")
    assert run_campaign_sync(campaign, split).flown == 0
    # What was flown before is taken up, and its runs stay where they are.
    assert run_campaign_sync(campaign, flat).flown == 0
    joined = tmp_path / "joined"
    merge_shards([half, other], joined, finish)
    results = {path.parent.name: path.read_bytes() for path in flat.glob("runs/*/result.json")}
    for folder in (split, joined):
        assert verify_folder(folder) == []
        assert {
            p.parent.name: p.read_bytes() for p in folder.glob("runs/[0-9][0-9]/*/result.json")
        } == results
        assert (folder / "scores.parquet").read_bytes() == (flat / "scores.parquet").read_bytes()
        assert len(read_runs(folder).runs) == len(results) == 4
    # A result that was edited there is found by its name.
    edited = next(split.glob("runs/[0-9][0-9]/*/result.json"))
    edited.write_text("{}")
    assert any(
        str(edited) in str(fault) or edited.parent.name in str(fault) for fault in verify_folder(split)
    )
