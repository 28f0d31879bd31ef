"""One byte of a campaign folder is changed, or a file is deleted, added or exchanged: `verify_folder` names the
file.
"""

from __future__ import annotations

import random
import shutil
import sqlite3
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from bench.campaign import digest_of, finish_campaign, is_campaign, read_runs, verify_folder
from bench.cli._app import run
from bench.errors import SetupError

ROOT = Path(__file__).parents[2]
CAMPAIGN = """
format: rebar.campaign/1
name: short
base_file: scene.yaml
decomposition: own.yaml
agents: [{manifest: reference-naive}]
floor: {agents: [{manifest: null-idle}], oracle: null, share: 1.0}
design:
  seed: 3
  method: {kind: full_factorial}
  factors:
    - {name: concealment, levels: [0.5, 1.0], sets: ['actors[radar].concealment']}
"""
KINDS = {
    *("campaign.yaml", "decomposition.yaml", "evidence.jsonl", "journal.sqlite", "manifest.json"),
    *("scores.parquet", "floor.parquet", "report.html", "w1.log", "simspecs"),
    *("recording.mcap", "result.json", "simspec.json", "agent.log"),
}
FLIPS = 6
"""For each kind of file, beside its first and last byte. Chosen: the whole test stays under three seconds."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes of two simulated seconds, each flown by a reference agent and by a null agent."""
    home = tmp_path_factory.mktemp("flipped")
    scene = (ROOT / "examples" / "search.yaml").read_text()
    assert "time_limit_s: 300.0" in scene
    (home / "scene.yaml").write_text(scene.replace("time_limit_s: 300.0", "time_limit_s: 2.0"))
    shutil.copy(ROOT / "decompositions" / "data" / "search_and_report.yaml", home / "own.yaml")
    (home / "short.yaml").write_text(CAMPAIGN)
    assert run(["run", str(home / "short.yaml"), "--out", str(home / "out"), "--workers", "1"]) == 0
    # What a worker prints; those of this campaign are silent.
    log = home / "out" / "logs" / "w1.log"
    log.write_text(log.read_text() + "a line of a worker\n")
    (home / "out" / "runs" / "p001-r1-null-idle" / "agent.log").write_text("a line of an agent\n")
    (home / "out" / "runs" / "p002-r1-null-idle" / "agent.log").write_text("another line\n")
    (home / "out" / "manifest.json").unlink()
    finish_campaign(home / "out")
    return home / "out"


def files_by_kind(folder: Path) -> dict[str, list[Path]]:
    kinds = defaultdict(list)
    for file in sorted(folder.rglob("*")):
        if file.is_file() and file.name != ".lock":
            kinds["simspecs" if file.parent.name == "simspecs" else file.name].append(file)
    return kinds


def contents(folder: Path) -> Mapping[Path, str]:
    return {file: digest_of(file) for file in folder.rglob("*") if file.is_file()}


@contextmanager
def kept(*files: Path) -> Iterator[None]:
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


def test_every_file_is_of_a_known_kind_and_the_folder_is_as_it_was_made(flown: Path) -> None:
    """Nothing that is not looked at below, and at least two files of each kind that a run has."""
    kinds = files_by_kind(flown)
    assert set(kinds) == KINDS
    assert all(len(kinds[name]) >= 2 for name in ("recording.mcap", "result.json", "agent.log", "simspecs"))
    assert verify_folder(flown) == []


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_flipped_byte_is_found_and_its_file_named(flown: Path, kind: str) -> None:
    """At random positions and at both ends, in up to two files of each kind. Looking changes nothing."""
    draw = random.Random(kind)
    files = files_by_kind(flown)[kind][:2]
    for file in files:
        content = file.read_bytes()
        assert content
        positions = {0, len(content) - 1, *(draw.randrange(len(content)) for _ in range(FLIPS))}
        for position in sorted(positions):
            flipped = bytearray(content)
            flipped[position] ^= draw.randint(1, 255)
            with kept(file):
                file.write_bytes(flipped)
                before = contents(flown)
                assert str(file.relative_to(flown)) in named(flown), (file, position, flipped[position])
                assert contents(flown) == before
    assert verify_folder(flown) == []


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_deleted_file_and_an_exchanged_one_are_found(flown: Path, kind: str) -> None:
    """Each file is gone; two of a kind have changed places."""
    files = files_by_kind(flown)[kind][:2]
    for file in files:
        with kept(file):
            file.unlink()
            assert str(file.relative_to(flown)) in named(flown)
    if len(files) > 1:
        first, second = files
        with kept(first, second):
            first_content = first.read_bytes()
            first.write_bytes(second.read_bytes())
            second.write_bytes(first_content)
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
        with kept(file):
            file.write_text("added")
            assert name in named(flown)
    finally:
        if is_new:
            file.parent.rmdir()
    assert verify_folder(flown) == []


def test_commands_that_read_leave_the_journal_as_it_is(flown: Path) -> None:
    """Reading and writing the report again change no byte of the journal, so the manifest's digest holds."""
    before = digest_of(flown / "journal.sqlite")
    assert is_campaign(flown)
    read_runs(flown)
    finish_campaign(flown)
    assert digest_of(flown / "journal.sqlite") == before
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
    flown: Path, tmp_path: Path, statement: str, value: str
) -> None:
    """What no chain holds: accepted runs, levels and stops. Report and scores refuse, and name the file."""
    folder = tmp_path / "out"
    shutil.copytree(flown, folder)
    with closing(sqlite3.connect(folder / "journal.sqlite", isolation_level=None)) as journal:
        journal.execute(statement, (value,))
    for _ in range(2):
        assert "journal.sqlite" in named(folder)
        for command in (finish_campaign, read_runs):
            with pytest.raises(SetupError, match=r"journal\.sqlite: was edited after the bench wrote it"):
                command(folder)
        (folder / "manifest.json").unlink(missing_ok=True)
