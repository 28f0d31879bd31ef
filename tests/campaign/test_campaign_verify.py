"""`rebar verify`: one byte of a campaign folder is changed, or a file is deleted, added or exchanged, and the file is
named; runs are flown again, and what differs is named.
"""

from __future__ import annotations

import json
import os
import platform
import random
import shutil
import sqlite3
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import typer
from campaign_fakes import known
from command_line import fly_short, json_of
from in_process_executor import open_in_process

from bench.campaign import (
    ReflownRun,
    ReflownSample,
    ReflownStatus,
    digest_of,
    finish_campaign,
    is_campaign,
    read_runs,
    refly,
    verify_folder,
)
from bench.campaign._versions import _processor_flags, arithmetic, versions
from bench.campaign.results._refly import _other_versions
from bench.cli._app import run
from bench.cli._verification import _exit_for
from bench.contracts import (
    CAMERA_OPENED,
    SESSION_EVENTS,
    START,
    TRUTH_ODOMETRY,
    EventDocument,
    Record,
    SessionResult,
)
from bench.errors import SetupError
from bench.recording import open_recording, read_metadata, read_records, read_simspec
from bench.simspec import SimSpec, load_simspec
from bench.streams import Odometry, Point, Pose, PoseWithCovariance, String, decode, encode

ROOT = Path(__file__).parents[2]
MORE = """
decomposition: own.yaml
floor: {agents: [{manifest: null-idle}], oracle: null, share: 1.0}
"""
KINDS = {
    *("campaign.yaml", "decomposition.yaml", "evidence.jsonl", "journal.sqlite", "manifest.json"),
    *("scores.parquet", "floor.parquet", "report.html", "w1.log", "simspecs"),
    *("scores.csv", "runs.csv", "card.md", "junit.xml"),
    *("recording.mcap", "result.json", "simspec.json", "agent.log"),
}
FLIPS = 3
"""For each kind of file, beside its first and last byte. Chosen: the whole test stays under three seconds."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes of two simulated seconds, each flown by a reference agent and by a null agent."""
    home = tmp_path_factory.mktemp("flipped")
    shutil.copy(ROOT / "decompositions" / "data" / "search_and_report.yaml", home / "own.yaml")
    fly_short(home, MORE, 2.0)
    # What a worker prints; those of this campaign are silent.
    log = home / "out" / "logs" / "w1.log"
    log.write_text(log.read_text() + "a line of a worker\n")
    (home / "out" / "runs" / "p001-r1-null-idle" / "agent.log").write_text("a line of an agent\n")
    (home / "out" / "runs" / "p002-r1-null-idle" / "agent.log").write_text("another line\n")
    (home / "out" / "manifest.json").unlink()
    finish_campaign(home / "out")
    return home / "out"


@pytest.fixture
def copy(flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the campaign to be edited, whose runs can be flown again as they were or with an edit."""
    monkeypatch.setenv("REBAR_TEST_FLOWN", str(flown))
    return Path(shutil.copytree(flown, tmp_path / "out"))


def files_by_kind(folder: Path) -> dict[str, list[Path]]:
    kinds = defaultdict(list)
    for file in sorted(folder.rglob("*")):
        if file.is_file() and file.name != ".lock":
            kinds["simspecs" if file.parent.name == "simspecs" else file.name].append(file)
    return kinds


def contents(folder: Path) -> Mapping[Path, str]:
    return {file: digest_of(file) for file in folder.rglob("*") if file.is_file()}


@contextmanager
def restored(*files: Path) -> Iterator[None]:
    """Restore files as they were."""
    before = {file: file.read_bytes() for file in files if file.is_file()}
    try:
        yield
    finally:
        for file in files:
            if file in before:
                file.write_bytes(before[file])
            else:
                file.unlink()


def named(folder: Path) -> set[str]:
    """The files that the faults are about, by their paths in the folder."""
    names = (fault.where.removeprefix(f"{folder}/") for fault in verify_folder(folder))
    # A line of the chain is named as file:line.
    return {name.partition(":")[0] for name in names}


def test_every_file_is_of_a_known_kind_and_reading_leaves_the_folder_as_it_was_made(flown: Path) -> None:
    """Nothing that is not looked at below, and at least two files of each kind that a run has. Commands that read, and
    the report written again, change no byte of the journal, so the manifest's digest holds.
    """
    kinds = files_by_kind(flown)
    assert set(kinds) == KINDS
    assert all(len(kinds[name]) >= 2 for name in ("recording.mcap", "result.json", "agent.log", "simspecs"))
    before = digest_of(flown / "journal.sqlite")
    assert is_campaign(flown)
    read_runs(flown)
    finish_campaign(flown)
    assert digest_of(flown / "journal.sqlite") == before
    assert verify_folder(flown) == []


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_flipped_byte_and_a_file_that_is_gone_or_exchanged_are_found_and_named(
    flown: Path, kind: str
) -> None:
    """Flipped at random positions and at both ends, in up to two files of each kind, each then deleted; and two of a
    kind have changed places. Looking changes nothing.
    """
    draw = random.Random(kind)
    files = files_by_kind(flown)[kind][:2]
    contents_before = [file.read_bytes() for file in files]
    for file, content in zip(files, contents_before, strict=True):
        assert content
        name = str(file.relative_to(flown))
        positions = {0, len(content) - 1, *(draw.randrange(len(content)) for _ in range(FLIPS))}
        with restored(file):
            for position in sorted(positions):
                flipped = bytearray(content)
                flipped[position] ^= draw.randint(1, 255)
                file.write_bytes(flipped)
                before = contents(flown)
                assert name in named(flown), (file, position, flipped[position])
                assert contents(flown) == before
            file.unlink()
            assert name in named(flown)
    if len(files) > 1:
        with restored(*files):
            for file, content in zip(files, reversed(contents_before), strict=True):
                file.write_bytes(content)
            assert named(flown) >= {str(file.relative_to(flown)) for file in files}
    assert verify_folder(flown) == []


@pytest.mark.parametrize(
    "name",
    [
        *("notes.txt", "runs/notes.txt", "runs/p009-r1-reference-naive/result.json", "logs/w9.log"),
        # Names that are not listed where the bench writes them, and are where it does not.
        *("runs/manifest.json", "aside/journal.sqlite", "simspecs/.lock", "logs/evidence.jsonl"),
        "journal.sqlite-wal",
    ],
)
def test_an_added_file_is_found(flown: Path, name: str) -> None:
    """Wherever it lies, and whatever it is called."""
    file = flown / name
    is_new = not file.parent.is_dir()
    file.parent.mkdir(exist_ok=True)
    try:
        with restored(file):
            file.write_text("added")
            assert name in named(flown)
    finally:
        if is_new:
            file.parent.rmdir()
    assert verify_folder(flown) == []


@pytest.mark.parametrize(
    ("statement", "value"),
    [
        ("INSERT OR REPLACE INTO facts VALUES ('accepted', ?)", '["p001-r1-reference-naive"]'),
        ("UPDATE realizations SET levels = ? WHERE number = 1", '{"concealment": 1.0}'),
        ("INSERT INTO stops VALUES ('p001', ?, 0)", "reference-naive"),
    ],
)
def test_an_edited_journal_is_refused_with_or_without_a_manifest(
    copy: Path, statement: str, value: str
) -> None:
    """What no chain holds: accepted runs, levels and stops. Report and scores refuse, and name the file."""
    with closing(sqlite3.connect(copy / "journal.sqlite", isolation_level=None)) as journal:
        journal.execute(statement, (value,))
    for _ in range(2):
        assert "journal.sqlite" in named(copy)
        for command in (finish_campaign, read_runs):
            with pytest.raises(SetupError, match=r"journal\.sqlite: was edited after the bench wrote it"):
                command(copy)
        (copy / "manifest.json").unlink(missing_ok=True)


NAIVE, IDLE = "reference-naive", "null-idle"


def test_a_drawn_sample_is_flown_again_and_identical(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two of four runs, in a worker; the same seed draws the same two, and the folder stays as it is."""
    before = contents(flown)
    capsys.readouterr()
    sample = json_of(
        ["verify", str(flown), "--refly", "2", "--seed", "5", "--workers", "1", "--json"], capsys
    )["refly"]
    assert (sample["seed"], sample["comparable"], sample["not_comparable"]) == (5, 4, {})
    assert [run["status"] for run in sample["runs"]] == ["identical"] * 2
    assert drawn(flown, 2, 5) == [run["realization"] for run in sample["runs"]]
    assert len({*drawn(flown, 1, 5), *drawn(flown, 1, 6), *drawn(flown, 1, 7)}) > 1
    assert contents(flown) == before


def drawn(folder: Path, count: int, seed: int) -> list[str]:
    """The runs that a seed draws, without flying them."""
    sample = refly(folder, count, seed, job=f"{__name__}:no_flight", open_executor=open_in_process())
    assert {run.status for run in sample.runs} == {ReflownStatus.NOT_FLOWN}
    return [run.realization for run in sample.runs]


def no_flight(*of_job: object) -> SessionResult:
    raise SetupError("nothing is flown")


def edit_json(path: Path, edit: Callable[[Any], None]) -> None:
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))


def edit_recording(
    folder: Path, edit: Callable[[list[Record]], list[Record]], versions: Mapping[str, str]
) -> None:
    """A run's recording with other records or versions, and a result that is made from it."""
    recording = folder / "recording.mcap"
    records, simspec, head = list(read_records(recording)), read_simspec(recording), read_metadata(recording)
    with open_recording(
        recording, simspec=simspec, versions={**head["rebar.versions"], **versions}
    ) as recorder:
        for record in edit(records):
            recorder(record)
    edit_json(folder / "result.json", lambda result: result.update(recording_sha256=recorder.sha256))


def test_what_differs_is_named_and_what_cannot_be_compared_is_no_forgery(copy: Path) -> None:
    """A record edited, a measured value edited, other versions, an agent that is not here; then another pace."""
    folder = copy
    place = 100
    planted: list[Record] = []

    def flip(records: list[Record]) -> list[Record]:
        planted.append(records[place])
        data = bytes([*records[place].data[:-1], records[place].data[-1] ^ 1])
        return [*records[:place], replace(records[place], data=data), *records[place + 1 :]]

    edit_recording(folder / "runs" / f"p001-r1-{NAIVE}", flip, {})
    (observable,) = json.loads((folder / "runs" / f"p001-r1-{IDLE}" / "result.json").read_text())[
        "observations"
    ][:1]
    edit_json(
        folder / "runs" / f"p001-r1-{IDLE}" / "result.json",
        lambda result: result["observations"][0].update(x=0.125, considered=True),
    )
    edit_recording(folder / "runs" / f"p002-r1-{NAIVE}", lambda records: records, {"numpy": "0.1"})
    edit_json(
        folder / "simspecs" / f"p002-r1-{IDLE}.json",
        lambda simspec: simspec["agent"].update(manifest="gone.yaml"),
    )

    sample = refly(folder, 9, 1, workers=2, open_executor=open_in_process())
    runs = {run.realization: run for run in sample.runs}
    assert sample.comparable == len(runs) == 4
    record, value, versions, gone = (
        runs[f"{point}-r1-{agent}"] for point in ("p001", "p002") for agent in (NAIVE, IDLE)
    )
    assert record.status is ReflownStatus.DIFFERENT
    assert record.explanation.startswith(
        f"{planted[0].topic} at {planted[0].time.s:.3f} s: the messages differ"
    )
    assert (value.status, value.explanation) == (
        ReflownStatus.DIFFERENT,
        f"the recordings are equal, the results differ in {observable['observable']}",
    )
    assert versions.status is ReflownStatus.OTHER_VERSIONS
    assert "cannot be compared bit for bit: it was flown with numpy 0.1 (here " in versions.explanation
    assert versions.explanation.endswith("all records are equal")
    assert gone.status is ReflownStatus.NOT_FLOWN
    assert "setup_invalid" in gone.explanation
    assert "gone.yaml" in gone.explanation

    first, second, *remaining = sorted(runs)
    changes: dict[str, Callable[[dict[str, Any]], None]] = dict.fromkeys(
        remaining, lambda simspec: simspec["pace"].update(mode="realtime")
    )
    service = {"name": "llm", "host": "api.example.org", "port": 443}
    changes[first] = lambda simspec: simspec["agent"].update(services=[service])
    changes[second] = lambda simspec: simspec["vehicle"].update(
        outside_links=[{"name": "tower", "heard": True}]
    )
    for realization, change in changes.items():
        edit_json(folder / "simspecs" / f"{realization}.json", change)
    sample = refly(folder, 9, 1, open_executor=open_in_process())
    assert (sample.runs, sample.comparable) == ((), 0)
    assert {reason: sorted(names) for reason, names in sample.not_comparable.items()} == {
        "flown in real time": remaining,
        "with a link from outside that the vehicle obeys": [second],
        "with services from outside": [first],
    }


def edited_flight(folder: Path, realization: str, edit: Callable[[Record], Record | None]) -> SessionResult:
    """The run as it was, but for what `edit` makes of each record; None leaves it out."""
    flown = Path(os.environ["REBAR_TEST_FLOWN"]) / "runs" / realization
    recording = flown / "recording.mcap"
    with open_recording(
        folder / "recording.mcap", simspec=read_simspec(recording), versions=versions()
    ) as recorder:
        for record in read_records(recording):
            if edited := edit(record):
                recorder(edited)
    result = SessionResult.model_validate_json((flown / "result.json").read_bytes())
    return result.model_copy(update={"recording_sha256": recorder.sha256})


def same_flight(simspec: SimSpec, decomposition: object, folder: Path, realization: str) -> SessionResult:
    return edited_flight(folder, realization, lambda record: record)


def moved_flight(simspec: SimSpec, decomposition: object, folder: Path, realization: str) -> SessionResult:
    """The run as it was, but half a metre beside it for a while, and a metre at one moment."""

    def moved(record: Record) -> Record:
        if record.topic != TRUTH_ODOMETRY or not 0.5 <= record.time.s <= 1.5:
            return record
        message = known(decode(Odometry, record.data))
        east_m = 1.0 if abs(record.time.s - 1.0) < 0.03 else 0.5
        place = message.pose.pose.position
        pose = Pose(Point(place.x + east_m, place.y, place.z), message.pose.pose.orientation)
        edited = Odometry(message.header, message.child_frame_id, PoseWithCovariance(pose), message.twist)
        return replace(record, data=encode(edited))

    return edited_flight(folder, realization, moved)


def retold_flight(simspec: SimSpec, decomposition: object, folder: Path, realization: str) -> SessionResult:
    """The run as it was, but for records at one moment, as where one message of the autopilot came at another."""
    return edited_flight(
        folder,
        realization,
        lambda record: None if record.topic != TRUTH_ODOMETRY and 0.4 < record.time.s < 1.6 else record,
    )


def flown_again(folder: Path, job: str) -> dict[str, ReflownRun]:
    sample = refly(folder, 9, 1, job=f"{__name__}:{job}", open_executor=open_in_process())
    return {run.realization: run for run in sample.runs}


def test_how_far_two_flights_came_apart_is_told_and_no_difference_where_px4_flew(copy: Path) -> None:
    px4, ardupilot, imitated = f"p001-r1-{NAIVE}", f"p002-r1-{NAIVE}", f"p001-r1-{IDLE}"
    for name, kind in ((px4, "px4"), (ardupilot, "ardupilot")):
        autopilot = {"kind": kind, "firmware": "/opt/firmware"}
        edit_json(
            copy / "simspecs" / f"{name}.json",
            lambda simspec, autopilot=autopilot: simspec["vehicle"].update(autopilot=autopilot),  # type: ignore[misc]
        )
    runs = flown_again(copy, "moved_flight")
    assert [run.apart_m for run in runs.values()] == pytest.approx([1.0] * 4)
    distance_text = "the vehicles were at most 1 m apart, at 1.0 s"
    assert all(distance_text in run.explanation for run in runs.values())
    for name in (px4, ardupilot):
        assert runs[name].status is ReflownStatus.APART
        assert runs[name].explanation.startswith("a real autopilot flew, which need not repeat itself")
        assert runs[name].explanation.endswith("the results are equal")
    assert runs[imitated].status is ReflownStatus.DIFFERENT
    # The same flight with another record: no more than that differs.
    runs = flown_again(copy, "retold_flight")
    statuses = [runs[name].status for name in (px4, ardupilot, imitated)]
    assert statuses == [ReflownStatus.EQUAL, ReflownStatus.EQUAL, ReflownStatus.DIFFERENT]
    assert runs[px4].apart_m == 0.0


def test_the_exit_code_tells_a_difference_from_what_could_not_be_compared() -> None:
    """0 where all runs are identical, 1 for a difference, 3 where something, or everything, was not compared."""

    def code(*statuses: ReflownStatus) -> int:
        runs = tuple(ReflownRun(str(number), status) for number, status in enumerate(statuses))
        try:
            _exit_for(ReflownSample(1, len(runs), runs, {}))
        except typer.Exit as end:
            return end.exit_code
        return 0

    identical, different = ReflownStatus.IDENTICAL, ReflownStatus.DIFFERENT
    assert code(identical, identical) == code(identical, ReflownStatus.EQUAL) == 0
    assert code(identical, different) == code(different, ReflownStatus.NOT_FLOWN) == 1
    assert code(identical, ReflownStatus.OTHER_VERSIONS) == code(ReflownStatus.NOT_FLOWN, identical) == 3
    assert code() == 3


def test_options_of_refly_need_it(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A seed or workers alone would be taken for a repetition that never took place."""
    for option in ("--seed", "--workers"):
        assert run(["verify", str(flown), option, "1"]) == 2
        assert f"rebar: {option}: is for --refly alone (give --refly N too)" in capsys.readouterr().err


def test_another_build_of_opencv_or_another_renderer_is_other_software(tmp_path: Path) -> None:
    """Cameras are compared one by one, in the order in which they were opened; a recording without pictures says nothing."""
    simspec = load_simspec(ROOT / "examples" / "two_cameras.yaml")

    def recording(*builds: str) -> Path:
        path = tmp_path / f"{len([*tmp_path.iterdir()])}.mcap"
        with open_recording(path, simspec=simspec, versions=versions()) as recorder:
            events = [EventDocument(name=CAMERA_OPENED, text=text) for text in builds]
            for event in (EventDocument(name="started"), *events):
                data = encode(String(event.model_dump_json()))
                recorder(Record(START, SESSION_EVENTS, String.TYPE, data))
        return path

    old, new = "OpenCV 4.10.0, build a", "OpenCV 4.12.0, build b"
    one, two = recording(old, f"down: {old}"), recording(old, f"down: moderngl, Mesa 22; {new}")
    assert _other_versions(recording(old), recording(new)) == [f"{old} (here {new})"]
    assert _other_versions(one, one) == _other_versions(one, recording()) == []
    assert _other_versions(one, two) == [f"down: {old} (here down: moderngl, Mesa 22; {new})"]


def test_a_difference_between_processors_is_named_with_its_size(copy: Path) -> None:
    """Digests differ, and so do processor and mathematical library: no forgery, and told. Where the digests are equal, or
    the hosts, nothing is said of processors.
    """
    elsewhere, here = (f"{point}-r1-{NAIVE}" for point in ("p001", "p002"))
    result = copy / "runs" / elsewhere / "result.json"
    other = {"processor": "x86_64 sse4_2", "libm": "glibc 2.17, results 00000000"}
    edit_json(result, lambda document: document["facts"]["arithmetic"].update(other))

    assert {run.status for run in flown_again(copy, "same_flight").values()} == {ReflownStatus.IDENTICAL}
    runs = flown_again(copy, "moved_flight")
    assert runs[here].status is ReflownStatus.DIFFERENT
    assert runs[elsewhere].status is ReflownStatus.OTHER_VERSIONS
    assert runs[elsewhere].apart_m == pytest.approx(1.0)
    told = runs[elsewhere].explanation
    assert told.startswith(
        "cannot be compared bit for bit: it was flown with libm glibc 2.17, results 00000000 (here "
        f"{arithmetic()['libm']}), processor x86_64 sse4_2 (here {arithmetic()['processor']}); /truth/odometry at 0.5"
    )
    assert told.endswith("that both flew; the results are equal")
    assert "processor" not in runs[here].explanation

    edit_json(result, lambda document: document["facts"].pop("arithmetic"))
    assert flown_again(copy, "moved_flight")[elsewhere].status is ReflownStatus.DIFFERENT


def test_results_and_manifest_name_the_arithmetic_and_recordings_do_not(flown: Path, tmp_path: Path) -> None:
    """What the kernel lists of the first core, less what no library chooses by; the same in two processes."""
    manifest = json.loads((flown / "manifest.json").read_text())
    assert arithmetic().items() <= manifest["versions"].items()
    for run_folder in (flown / "runs").iterdir():
        assert json.loads((run_folder / "result.json").read_text())["facts"]["arithmetic"] == arithmetic()
        assert read_metadata(run_folder / "recording.mcap")["rebar.versions"] == versions()
    intel = "processor\t: 0\nflags\t\t: fpu sse4_2 avx2 fma\n\nprocessor\t: 1\nflags\t\t: fpu avx512f\n"
    arm = "processor\t: 0\nFeatures\t: fp asimd sve\n"
    for text, flags in (
        (intel, ["fpu", "sse4_2", "avx2", "fma"]),
        (arm, ["fp", "asimd", "sve"]),
        ("none\n", []),
    ):
        (tmp_path / "cpuinfo").write_text(text)
        assert [
            flag for flag in _processor_flags(tmp_path / "cpuinfo") if flag not in ("flags", "Features", ":")
        ] == flags
    assert _processor_flags(tmp_path / "missing") == []


@pytest.mark.skipif(
    platform.machine() != "x86_64" or not platform.libc_ver()[0], reason="glibc has such variants on x86-64"
)
def test_the_variant_of_the_mathematical_library_shows_in_its_results() -> None:
    """glibc without fused multiply-adds, as on an older processor, against the one of this processor."""
    code = "from bench.campaign._versions import arithmetic; print(arithmetic()['libm'])"
    plain, without_fma = (
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "GLIBC_TUNABLES": tunables},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for tunables in ("", "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4")
    )
    assert plain == arithmetic()["libm"]
    assert (plain != without_fma) == ("fma" in arithmetic()["processor"].split())


def test_files_that_nfs_leaves_are_no_difference(copy: Path) -> None:
    """A program on a network disk has deleted them and holds them open. They are in no manifest either; other hidden
    files are named.
    """
    folder = copy
    left = [folder / ".nfs000000000123456700000001", folder / "runs" / IDLE / ".nfs00000000deadbeef0000001f"]
    left[1].parent.mkdir()
    for file in left:
        file.write_text("deleted, and open")
    assert verify_folder(folder) == []
    finish_campaign(folder)
    assert ".nfs" not in (folder / "manifest.json").read_text()
    for name in (".nfs1", ".nfs000000000123456700000001.mcap", "nfs000000000123456700000001"):
        (folder / name).write_text("hidden")
        assert [fault.where for fault in verify_folder(folder)] == [name]
        (folder / name).unlink()


def test_what_is_no_campaign_folder_is_told_what_to_give(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recording in a campaign and one outside, the folder of a run, some file, and nothing at all."""
    run_folder = flown / "runs" / f"p001-r1-{NAIVE}"
    alone = tmp_path / "a run"
    shutil.copytree(run_folder, alone)
    (tmp_path / "notes.txt").write_text("notes")
    score = "`rebar score {}` checks one recording, against its result or by its own checksums)"
    cases = {
        run_folder / "recording.mcap": f"is a file (give its campaign: {flown}; {score.format(run_folder)}",
        run_folder: f"is the folder of one run (give its campaign: {flown}; {score.format(run_folder)}",
        alone: f"is the folder of one run (give the folder of a campaign; {score.format(repr(str(alone)))}",
        tmp_path / "notes.txt": "is a file (give the folder of a campaign)",
        tmp_path / "gone": "does not exist (give the folder that `rebar run` wrote)",
    }
    for path, words in cases.items():
        assert run(["verify", str(path)]) == 2
        assert capsys.readouterr().err == f"rebar: {path}: {words}\n"
    assert run(["score", str(run_folder / "recording.mcap")]) == 2
    assert f"is a file (name the folder that holds it: {run_folder})" in capsys.readouterr().err
    for path in (tmp_path / "notes.txt", tmp_path / "gone"):
        assert run(["report", str(path)]) == 2
        assert f"rebar: {path}: is not the folder of a campaign" in capsys.readouterr().err
    assert not (tmp_path / "gone").exists()
