"""A campaign in parts and the folder in which they are joined, recordings that a campaign does not keep, and where the
runs of a large one lie.
"""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

import polars as pl
import pytest
from campaign_fakes import MIXED_ENDS, SECOND_TRY, demo, known, small_campaign, to_scores
from in_process_executor import open_in_process
from test_campaign_verify import edit_json

from bench.campaign import (
    Campaign,
    CampaignFolder,
    CampaignSummary,
    Collaborators,
    Jobs,
    Keep,
    ReflownStatus,
    Stopping,
    campaign_state,
    digest_of,
    merge_shards,
    open_journal,
    question_sha256,
    read_runs,
    realizations,
    refly,
    rescore_campaign,
    run_campaign_sync,
    verify_folder,
)
from bench.campaign.storage import _folder as folder_module
from bench.campaign.storage._dropped import DROPPED, DroppedRecording
from bench.campaign.storage._folder import FLAT_RUNS, campaign_of, realization_in
from bench.campaign.storage._manifest import read_manifest
from bench.cli._app import run
from bench.errors import SetupError


def part(campaign: Campaign, shard: str) -> Campaign:
    return campaign.model_copy(update={"shard": shard})


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`whole`, `1` and `2`: the campaign in one run, and in two shards, each run to its end."""
    root = tmp_path_factory.mktemp("shards")
    campaign = demo(3)
    for name, flown in (("whole", campaign), ("1", part(campaign, "1/2")), ("2", part(campaign, "2/2"))):
        # The scores of the shards are of no use here, and their reports take seconds.
        collaborators = Collaborators(
            finish=to_scores if name == "whole" else None, open_executor=open_in_process()
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
    summary = merge_shards([folders / "2", folders / "1"], out, to_scores)
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
    assert run_campaign_sync(demo(3), out).flown == 0


def test_attempts_and_recordings_come_along(tmp_path: Path) -> None:
    """Of sessions that were flown, each at its second attempt."""
    campaign = demo(3, fidelity="full")
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
    for campaign in (demo(3), small_campaign(points=5, replicates=3)):
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
    campaign = demo(3)
    assert question_sha256(part(campaign, "2/7")) == question_sha256(campaign)
    again = run_campaign_sync(campaign, folders / "1")
    assert (again.total, again.flown) == (4, 0)
    assert campaign_state(folders / "2").total == 2
    with pytest.raises(SetupError, match="holds realizations that are not in this campaign"):
        run_campaign_sync(part(campaign, "2/2"), folders / "1")


def test_what_does_not_make_a_whole_is_refused_by_name(folders: Path, tmp_path: Path) -> None:
    """One missing, one twice, no shard, of another campaign, changed, incomplete, or a folder in the way."""
    one, two, out = folders / "1", folders / "2", tmp_path / "out"
    changed, other = tmp_path / "changed", tmp_path / "other"
    shutil.copytree(two, changed)
    next(changed.glob("runs/*/result.json")).write_text("{}")
    collaborators = Collaborators(open_executor=open_in_process())
    run_campaign_sync(part(demo(name="other"), "2/2"), other, collaborators=collaborators)
    for shards, into, words in (
        ([one], out, "shards are missing: 2/2"),
        ([one, one, two], out, "shard 1/2 is there 2 times"),
        ([folders / "whole", two], out, "is no shard"),
        ([one, two], folders, "exists already"),
        ([one, changed], out, "result"),
        ([one, other], out, "is of another campaign"),
    ):
        with pytest.raises(SetupError, match=words):
            merge_shards(shards, into, to_scores)
    assert not out.exists()


@pytest.mark.parametrize("shard", ["0/2", "3/2", "2", "a/b", "1/2/3", "01/2"])
def test_a_shard_that_cannot_be_is_refused(shard: str, capsys: pytest.CaptureFixture[str]) -> None:
    """On the command line, with an example."""
    demo = Path(__file__).parents[2] / "campaigns" / "demo.yaml"
    assert run(["run", str(demo), "--shard", shard]) == 2
    assert "write 2/8 for the second of eight" in capsys.readouterr().err


def some_scenes(keep: Keep | None, count: int = 3) -> Campaign:
    return demo(count, fidelity="full", keep=keep)


def flown(folder: Path, campaign: Campaign) -> CampaignSummary:
    collaborators = Collaborators(jobs=Jobs(MIXED_ENDS), open_executor=open_in_process())
    return run_campaign_sync(campaign, folder, collaborators=collaborators)


def kept_runs(folder: Path) -> set[str]:
    return {path.parent.name for path in folder.glob("runs/*/recording.mcap")}


def dropped_notes(folder: Path) -> dict[str, DroppedRecording]:
    notes = folder.glob(f"runs/*/{DROPPED}")
    return {path.parent.name: DroppedRecording.model_validate_json(path.read_bytes()) for path in notes}


@pytest.mark.parametrize(
    ("recordings", "agents"), [("none", ()), ("failures", ("naive",)), ("all", ("naive", "aware"))]
)
def test_what_is_dropped_counts_as_before(tmp_path: Path, recordings: str, agents: tuple[str, ...]) -> None:
    """Results, their digests and the folder's check are those of a campaign that keeps everything."""
    everything = tmp_path / "everything"
    flown(everything, some_scenes(None))
    keep = Keep.model_validate({"recordings": recordings})
    folder = tmp_path / "folder"
    summary = flown(folder, some_scenes(keep))
    assert (summary.complete, summary.flown) == (True, 6)
    names = {path.name for path in everything.glob("runs/*")}
    assert kept_runs(folder) == {name for name in names if any(agent in name for agent in agents)}
    assert dropped_notes(folder).keys() == names - kept_runs(folder)
    for name, note in dropped_notes(folder).items():
        run, whole = folder / "runs" / name, everything / "runs" / name
        recording = whole / "recording.mcap"
        assert (note.recording_sha256, note.bytes) == (digest_of(recording), recording.stat().st_size)
        assert digest_of(run / "result.json") == digest_of(whole / "result.json")
    assert verify_folder(folder) == []
    manifest = known(read_manifest(folder / "manifest.json"))
    listed = {name.split("/")[1] for name in manifest.files if name.endswith(DROPPED)}
    assert listed == dropped_notes(folder).keys()
    assert flown(folder, some_scenes(keep)).flown == 0
    assert question_sha256(some_scenes(keep)) == question_sha256(some_scenes(None))


def test_a_larger_sample_holds_the_smaller_one(tmp_path: Path) -> None:
    """Drawn from the design's seed: the same in every run, and some of both kinds."""
    drawn = []
    for number, share in enumerate((0.3, 0.3, 0.7)):
        flown(tmp_path / str(number), some_scenes(Keep(recordings="none", sample=share), count=6))
        drawn.append(kept_runs(tmp_path / str(number)))
    assert drawn[0] == drawn[1] < drawn[2]
    assert 0 < len(drawn[0]) < len(drawn[2]) < 12


def test_a_recording_cannot_be_called_dropped_afterwards(tmp_path: Path) -> None:
    """A note that the chain does not know is found, and so is a recording that took another's place."""
    folder = tmp_path / "folder"
    flown(folder, some_scenes(Keep(recordings="failures")))
    [first, second, *_] = sorted(kept_runs(folder))
    [note, *_] = (folder / "runs" / name / DROPPED for name in dropped_notes(folder))
    run = folder / "runs" / first
    forged = DroppedRecording(
        recording_sha256=digest_of(run / "recording.mcap"), bytes=1, policy="failures", versions={}
    )
    (run / "recording.mcap").unlink()
    (run / DROPPED).write_text(forged.model_dump_json())
    faults = {
        Path(fault.where).parent.name: fault.what for fault in verify_folder(folder) if DROPPED in fault.where
    }
    assert first in faults
    with pytest.raises(SetupError, match="says that the recording was dropped"):
        flown(folder, some_scenes(Keep(recordings="failures")))
    (run / DROPPED).unlink()
    (note.parent / "recording.mcap").write_bytes(b"another")
    assert any("recording.mcap" in fault.where for fault in verify_folder(folder))
    assert second in kept_runs(folder)


def test_what_was_dropped_can_be_flown_again_and_not_measured_again(tmp_path: Path) -> None:
    """The digest is enough to compare with; another decomposition needs the recordings. Three results have the digest of
    a recording that nobody has: flown here, by another numpy, and by real PX4.
    """
    folder = tmp_path / "folder"
    flown(folder, some_scenes(Keep(recordings="none")))
    with pytest.raises(SetupError, match="6 of its recordings were dropped"):
        rescore_campaign(folder)
    same_software, other_numpy, px4, *unchanged = sorted(dropped_notes(folder))
    for name in (same_software, other_numpy, px4):
        for file in (folder / "runs" / name / DROPPED, folder / "runs" / name / "result.json"):
            edit_json(file, lambda document: document.update(recording_sha256="0" * 64))
    edit_json(
        folder / "runs" / other_numpy / DROPPED,
        lambda note: note.update(versions={**note["versions"], "numpy": "0.1"}),
    )
    edit_json(
        folder / "simspecs" / f"{px4}.json",
        lambda simspec: simspec["vehicle"].update(autopilot={"kind": "px4", "firmware": "/opt/px4"}),
    )
    sample = refly(folder, 6, 1, 1, job=MIXED_ENDS, open_executor=open_in_process())
    runs = {run.realization: run for run in sample.runs}
    assert {name: run.status for name, run in runs.items()} == {
        same_software: ReflownStatus.DIFFERENT,
        other_numpy: ReflownStatus.OTHER_VERSIONS,
        px4: ReflownStatus.APART,
        **dict.fromkeys(unchanged, ReflownStatus.IDENTICAL),
    }
    assert "it was flown with numpy 0.1 (here " in runs[other_numpy].explanation


def test_shards_with_dropped_recordings_are_joined(tmp_path: Path) -> None:
    """The joined chain knows of them too."""
    campaign = some_scenes(Keep(recordings="failures"))
    for number in "12":
        flown(tmp_path / number, campaign.model_copy(update={"shard": f"{number}/2"}))
    out = tmp_path / "out"
    assert merge_shards([tmp_path / "1", tmp_path / "2"], out, lambda paths: None).complete
    assert verify_folder(out) == []
    assert len(dropped_notes(out)) == len(kept_runs(out)) == 3
    assert CampaignFolder(out).journal.is_file()
    shutil.rmtree(tmp_path / "1")
    assert verify_folder(out) == []


NAMES = [f"p{point:05d}-r{replicate}-reference-naive" for point in range(250) for replicate in range(20)]


def test_five_thousand_runs_lie_in_folders_of_few(tmp_path: Path) -> None:
    """Fifty in the mean. SimSpecs too; and each is where its name says, without anything being looked up."""
    folder = CampaignFolder(tmp_path)
    folder.lay_out(len(NAMES))
    for paths in ([folder.run(name) for name in NAMES], [folder.simspec(name) for name in NAMES]):
        assert len(set(paths)) == len(NAMES)
        shares = Counter(path.parent for path in paths)
        assert len(shares) == 100
        assert max(shares.values()) <= 100
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
    campaign = demo()

    def fly(name: str, shard: str | None = None) -> Path:
        part = campaign.model_copy(update={"shard": shard})
        collaborators = Collaborators(finish=None if shard else to_scores, open_executor=open_in_process())
        run_campaign_sync(part, tmp_path / name, collaborators=collaborators)
        return tmp_path / name

    flat = fly("flat")
    half = fly("first", "1/2")
    monkeypatch.setattr(folder_module, "FLAT_RUNS", 1)
    split, other = fly("split"), fly("second", "2/2")
    assert run_campaign_sync(campaign, split).flown == 0
    # What was flown before is taken up, and its runs stay where they are.
    assert run_campaign_sync(campaign, flat).flown == 0
    joined = tmp_path / "joined"
    merge_shards([half, other], joined, to_scores)

    def results(folder: Path, pattern: str) -> dict[str, bytes]:
        return {path.parent.name: path.read_bytes() for path in folder.glob(f"{pattern}/result.json")}

    flat_results = results(flat, "runs/*")
    for folder in (split, joined):
        assert verify_folder(folder) == []
        assert results(folder, "runs/[0-9][0-9]/*") == flat_results
        assert (folder / "scores.parquet").read_bytes() == (flat / "scores.parquet").read_bytes()
        assert len(read_runs(folder).runs) == len(flat_results) == 4
    # A result that was edited there is found by its name.
    edited = next(split.glob("runs/[0-9][0-9]/*/result.json"))
    edited.write_text("{}")
    assert any(edited.parent.name in str(fault) for fault in verify_folder(split))
