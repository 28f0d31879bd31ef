"""Recordings that a campaign does not keep, and what still vouches for their results."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from campaign_fakes import MIXED_ENDS
from in_process_executor import open_in_process
from test_campaign_overhead import overhead
from test_campaign_verify import edit_json

from bench.campaign import (
    Campaign,
    CampaignFolder,
    CampaignSummary,
    Collaborators,
    Jobs,
    Keep,
    ReflownStatus,
    digest_of,
    merge_shards,
    question_sha256,
    refly,
    rescore_campaign,
    run_campaign_sync,
    verify_folder,
)
from bench.campaign.storage._dropped import DROPPED, DroppedRecording
from bench.campaign.storage._manifest import read_manifest
from bench.errors import SetupError


def some_scenes(keep: Keep | None, count: int = 3) -> Campaign:
    campaign = overhead(fidelity="full", keep=keep)
    method = campaign.design.method.model_copy(update={"take": count})
    return campaign.model_copy(update={"design": campaign.design.model_copy(update={"method": method})})


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
        recording = everything / "runs" / name / "recording.mcap"
        assert (note.recording_sha256, note.bytes) == (digest_of(recording), recording.stat().st_size)
        assert digest_of(folder / "runs" / name / "result.json") == digest_of(
            everything / "runs" / name / "result.json"
        )
    assert verify_folder(folder) == []
    manifest = read_manifest(folder / "manifest.json")
    assert manifest is not None
    assert {name.split("/")[1] for name in manifest.files if name.endswith(DROPPED)} == dropped_notes(
        folder
    ).keys()
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
    """The digest is enough to compare with; another decomposition needs the recordings."""
    folder = tmp_path / "folder"
    flown(folder, some_scenes(Keep(recordings="none")))
    sample = refly(folder, 6, 1, 1, job=MIXED_ENDS, open_executor=open_in_process())
    assert [run.status for run in sample.runs] == [ReflownStatus.IDENTICAL] * 6
    with pytest.raises(SetupError, match="6 of its recordings were dropped"):
        rescore_campaign(folder)


def test_a_dropped_recording_of_other_software_is_no_forgery(tmp_path: Path) -> None:
    """Three results with the digest of a recording that nobody has: flown here, by another numpy, and by real PX4."""
    folder = tmp_path / "folder"
    flown(folder, some_scenes(Keep(recordings="none")))
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
