"""Recordings that workers of a cluster put at a URL, and what verification and scoring do with them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from in_process_executor import open_in_process
from test_campaign_retention import some_scenes

from bench.campaign import (
    Collaborators,
    Jobs,
    OpenExecutor,
    RunOptions,
    check_store,
    digest_of,
    load_measurable_decomposition,
    open_dask,
    read_result,
    rescore,
    rescore_campaign,
    run_campaign_sync,
    runs_elsewhere,
    store_faults,
    verify_folder,
    write_result,
)
from bench.campaign.execution._dask import ClusterTask
from bench.campaign.execution._dask_worker import _stored
from bench.campaign.execution._executor import FLIGHTS
from bench.campaign.execution._flight import fly_here
from bench.campaign.storage._dropped import (
    DroppedRecording,
    dropped_recording,
    note_pending,
    settle_note,
)
from bench.campaign.storage._elsewhere import store_recording
from bench.cli._app import run as rebar
from bench.contracts import Outcome, SessionResult
from bench.errors import SetupError
from bench.simspec import load_simspec

fsspec = pytest.importorskip("fsspec", reason="the extra `dask` is not installed")
DECOMPOSITION = load_measurable_decomposition("search-and-report")
ONE_WORKER = RunOptions(DECOMPOSITION, workers=1)
# No agent starts.
JOBS = Jobs(str(FLIGHTS.forfeit))


@pytest.fixture
def memory() -> Iterator[str]:
    """A store in memory, empty before and after."""
    system = fsspec.filesystem("memory")
    system.store.clear()
    yield "memory://store/recordings"
    system.store.clear()


def moved_away(run: Path, url: str, result: SessionResult) -> str:
    """Put a run's recording at a URL, as a worker and the runner do."""
    assert result.recording_sha256 is not None
    recording = run / "recording.mcap"
    size = recording.stat().st_size
    where = store_recording(recording, url, run.name, result.recording_sha256)
    recording.unlink()
    note = DroppedRecording(
        recording_sha256=result.recording_sha256, bytes=size, policy="kept at", versions={}, kept_at=where
    )
    note_pending(run, note)
    assert dropped_recording(run) is None
    settle_note(run)
    return where


@pytest.mark.process
def test_recordings_of_a_cluster_go_to_a_url_and_the_folder_vouches_for_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Results and digests are those of a campaign that keeps everything; what changed or went at the URL is named; and
    all of it can be measured again.
    """
    url = f"file://{tmp_path}/store"
    campaign = some_scenes(None, count=1)
    folder, local = tmp_path / "folder", tmp_path / "local"
    executors: tuple[OpenExecutor, OpenExecutor] = (open_in_process(), partial(open_dask, recordings=url))
    for path, executor in zip((local, folder), executors, strict=True):
        summary = run_campaign_sync(
            campaign, path, ONE_WORKER, Collaborators(jobs=JOBS, open_executor=executor)
        )
        assert summary.outcomes == {Outcome.AGENT_BROKE_BENCH: 2}

    stored = runs_elsewhere(folder)
    assert len(stored) == 2
    assert list(folder.glob("runs/**/recording.mcap")) == []
    for name, run in stored.items():
        note = dropped_recording(run)
        recording = local / "runs" / name / "recording.mcap"
        assert note is not None
        assert note.kept_at is not None
        assert note.kept_at.startswith(url)
        assert Path(note.kept_at.removeprefix("file://")).read_bytes() == recording.read_bytes()
    assert (verify_folder(folder), store_faults(stored)) == ([], [])
    summary = run_campaign_sync(campaign, folder, ONE_WORKER, Collaborators(jobs=JOBS))
    assert summary.flown == 0

    scores = rescore_campaign(folder, workers=1)
    assert scores.outcomes == {Outcome.AGENT_BROKE_BENCH: 2}
    for name, run in stored.items():
        measured, flown = read_result(run, name), read_result(local / "runs" / name, name)
        assert measured is not None
        assert flown is not None
        assert measured.observations == flown.observations
    assert verify_folder(folder) == []
    assert list(folder.glob("runs/**/recording.mcap")) == []
    assert rebar(["verify", str(folder)]) == 0
    assert "2 recordings are kept at a URL (not read" in capsys.readouterr().out

    changed, gone = sorted(Path(tmp_path, "store").rglob("*.mcap"))
    changed.write_bytes(changed.read_bytes()[:-1] + b"x")
    gone.unlink()
    assert verify_folder(folder) == []
    faults = {fault.what.split(":")[0] for fault in store_faults(stored)}
    assert len(faults) == 2
    assert any("has changed since its session" in fault for fault in faults)
    with pytest.raises(SetupError, match=r"has changed since its session|FileNotFoundError"):
        rescore_campaign(folder, workers=1)
    assert rebar(["verify", str(folder), "--recordings"]) == 1
    assert "FileNotFoundError" in capsys.readouterr().out


def test_a_run_is_measured_from_where_its_recording_lies(tmp_path: Path, memory: str) -> None:
    """Also a second one of the same realization with other bytes: neither takes the other's place."""
    manifest = tmp_path / "crash.yaml"
    manifest.write_text(
        "name: crash\npace: [lockstep]\ncommand: ['{python}', -m, bench.testing.agent, --behaviour, crash]\n"
    )
    spec = load_simspec(Path("examples/search.yaml"))
    spec = spec.model_copy(update={"agent": spec.agent.model_copy(update={"manifest": str(manifest)})})
    places = []
    for number in (1, 2):
        run = tmp_path / str(number) / "run"
        result = fly_here(
            spec.model_copy(update={"seeds": spec.seeds.model_copy(update={"root": number})}),
            DECOMPOSITION,
            run,
            "run",
        )
        write_result(run, result)
        places.append(moved_away(run, memory, result))
        assert rescore(run, DECOMPOSITION) == result
        assert rebar(["score", str(run), "--json"]) == 0
        assert rebar(["draw", str(run), "--out", str(run / "map.svg")]) == 0
        assert not (run / "recording.mcap").exists()
    assert len(set(places)) == 2
    fsspec.filesystem("memory").pipe_file(places[0].removeprefix("memory:/"), b"another")
    with pytest.raises(SetupError, match="has changed since its session"):
        rescore(tmp_path / "1" / "run", DECOMPOSITION)


def test_a_recording_that_a_store_does_not_take_comes_back(tmp_path: Path, memory: str) -> None:
    """It stays among the files of the run, and the reason is told; one that is taken does not."""
    (tmp_path / "file").touch()
    for url, fault in ((f"file://{tmp_path}/file/below", "NotADirectoryError"), (memory, "")):
        task = ClusterTask(
            realization="run",
            simspec="",
            decomposition=DECOMPOSITION.document,
            job="",
            wall_s=1.0,
            own_network=False,
            versions={},
            runner="",
            recordings=url,
        )
        recording = tmp_path / "recording.mcap"
        recording.write_bytes(b"all of it")
        result = SessionResult(
            realization="run", outcome=Outcome.COMPLETED, recording_sha256=digest_of(recording)
        )
        stored = _stored(task, tmp_path, result)
        assert stored is not None
        assert stored.fault.startswith(fault)
        assert (stored.bytes, recording.is_file()) == ((0, True) if fault else (9, False))


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("/shared/recordings", "is no URL"),
        ("s3://[fe80/recordings", "is no URL"),
        ("memory://recordings", "ends with the worker's process"),
        ("ftp://me:secret@host/recordings", "holds an account"),
        ("nothing-like-it://recordings", "Protocol not known"),
    ],
)
def test_urls_that_keep_nothing_are_refused_before_anything_flies(url: str, reason: str) -> None:
    """Each with the option that gave it."""
    with pytest.raises(SetupError, match=reason) as refused:
        check_store("--recordings", url)
    assert "--recordings" in str(refused.value)


def test_recordings_of_local_sessions_stay_in_the_folder(capsys: pytest.CaptureFixture[str]) -> None:
    """The option is for a cluster alone."""
    assert rebar(["run", "campaigns/demo.yaml", "--recordings", "file:///tmp/store"]) == 2
    assert "sessions on a cluster" in capsys.readouterr().err
