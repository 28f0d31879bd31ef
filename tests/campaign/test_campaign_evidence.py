"""Evidence is checked and never rewritten: files, journal, chain and manifest vouch for each other."""

from __future__ import annotations

import hashlib
import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from campaign_fakes import fly, small_campaign
from early_stopping_fakes import made_up_decomposition

from bench.campaign import (
    Campaign,
    CampaignFolder,
    ResultLost,
    check_run,
    digest_of,
    finish_campaign,
    open_journal,
    verify_folder,
)
from bench.campaign.storage._evidence_log import EvidenceLog
from bench.contracts import Outcome
from bench.errors import SetupError

FIRST, SECOND = "p001-r1-fake", "p003-r2-fake"


def refusal(folder: Path, campaign: Campaign | None = None) -> list[str]:
    with pytest.raises(SetupError) as refused:
        fly(folder, campaign)
    return [str(fault) for fault in refused.value.faults]


def edit_journal(folder: Path, *statements: tuple[str, tuple[str, ...]]) -> None:
    """Edit the journal as somebody who knows it would, who also takes its digest of itself away."""
    with closing(sqlite3.connect(folder / "journal.sqlite", isolation_level=None)) as journal:
        for statement, values in statements:
            journal.execute(statement, values)
        journal.execute("DELETE FROM facts WHERE name = 'content_sha256'")


def edit_together(folder: Path, realization: str) -> None:
    """Recording, result and both tables of the journal, all in agreement with each other."""
    run = CampaignFolder(folder).run(realization)
    (run / "recording.mcap").write_bytes(b"a better flight")
    result = json.loads((run / "result.json").read_text())
    result["recording_sha256"] = digest_of(run / "recording.mcap")
    (run / "result.json").write_text(json.dumps(result))
    edit_journal(
        folder,
        (
            "UPDATE realizations SET result_sha256 = ? WHERE id = ?",
            (digest_of(run / "result.json"), realization),
        ),
        ("INSERT OR REPLACE INTO recordings VALUES (?, ?)", (realization, result["recording_sha256"])),
    )


def forge_chain(folder: Path, realization: str) -> None:
    """Rewrite the chain from the line of a realization on, as somebody would who may write everywhere."""
    run = CampaignFolder(folder).run(realization)
    path, previous, lines = folder / "evidence.jsonl", "0" * 64, []
    for line in path.read_text().splitlines():
        entry = json.loads(line)
        if entry["realization"] == realization:
            entry["result_sha256"] = digest_of(run / "result.json")
            entry["recording_sha256"] = digest_of(run / "recording.mcap")
        entry["previous"] = previous
        lines.append(json.dumps(entry, separators=(",", ":")))
        previous = hashlib.sha256(lines[-1].encode()).hexdigest()
    path.write_text("\n".join(lines) + "\n")


def test_recording_result_and_journal_edited_together_do_not_pass(tmp_path: Path) -> None:
    """Two runs are edited in every place but the chain: verify and run name each file, and change none."""
    fly(tmp_path)
    assert verify_folder(tmp_path) == []
    for realization in (FIRST, SECOND):
        edit_together(tmp_path, realization)
    before = {path: digest_of(path) for path in tmp_path.rglob("*.*") if "journal" not in path.name}

    faults = refusal(tmp_path)
    for realization in (FIRST, SECOND):
        assert sum(realization in fault for fault in faults) >= 3
        assert any(f"journal.sqlite: has other digests for {realization}" in fault for fault in faults)
    assert len(verify_folder(tmp_path)) >= 6
    assert {path: digest_of(path) for path in before} == before


def test_an_edited_recording_is_not_scored_by_deleting_its_result(tmp_path: Path) -> None:
    """By itself or with its campaign; also after a runner noticed the loss, and was killed before it flew again."""
    fly(tmp_path)
    for realization in (FIRST, SECOND):
        run = CampaignFolder(tmp_path).run(realization)
        check_run(run)
        (run / "result.json").unlink()
        check_run(run)
        (run / "recording.mcap").write_bytes(b"a better flight")
    with open_journal(tmp_path / "journal.sqlite") as journal:
        journal.forget(SECOND, "its result or its recording is gone")
    for realization, source in ((FIRST, "evidence.jsonl:1"), (SECOND, "journal.sqlite")):
        run = CampaignFolder(tmp_path).run(realization)
        with pytest.raises(SetupError, match=rf"recording\.mcap: has changed since .* the one in {source}"):
            check_run(run)
        # Somewhere else it is anybody's recording.
        elsewhere = tmp_path.parent / f"{tmp_path.name}-{realization}"
        shutil.copytree(run, elsewhere)
        check_run(elsewhere)
    assert any("recording.mcap: has changed" in fault for fault in refusal(tmp_path))


def test_a_campaign_that_is_not_complete_is_checked_too(tmp_path: Path) -> None:
    """Without a manifest the chain alone notices it. A manifest that is gone is noticed, too."""
    fly(tmp_path, campaign=small_campaign(total_wall_s=1e-9))
    assert not (tmp_path / "manifest.json").exists()
    fly(tmp_path)
    (tmp_path / "manifest.json").unlink()
    (gone,) = map(str, verify_folder(tmp_path))
    assert gone.startswith("manifest.json: is missing, though every realization has a result")
    edit_together(tmp_path, FIRST)
    assert len(refusal(tmp_path)) == 3
    assert len(verify_folder(tmp_path)) == 4


def test_a_forged_chain_disagrees_with_the_manifest_and_a_forged_manifest_with_its_digest(
    tmp_path: Path,
) -> None:
    """Whoever may write everywhere can make all files agree; only the published digest tells."""
    fly(tmp_path)
    published = digest_of(tmp_path / "manifest.json")
    edit_together(tmp_path, SECOND)
    forge_chain(tmp_path, SECOND)
    (fault,) = refusal(tmp_path)
    assert "evidence.jsonl: is not the chain of the manifest" in fault

    (tmp_path / "manifest.json").unlink()
    fly(tmp_path)  # writes a manifest of what is there
    assert verify_folder(tmp_path) == [], "as docs/campaign-folders.md says"
    (fault,) = map(str, verify_folder(tmp_path, published))
    assert fault.startswith("manifest.json: has the digest ")


def test_a_manifest_that_disagrees_is_refused_and_not_replaced(tmp_path: Path) -> None:
    """A file of a run that no chain holds, such as agent.log, and a damaged manifest."""
    fly(tmp_path)
    log = CampaignFolder(tmp_path).run(FIRST) / "agent.log"
    log.write_text("all went well")
    (tmp_path / "manifest.json").unlink()
    fly(tmp_path)
    log.write_text("all went very well")
    manifest = (tmp_path / "manifest.json").read_bytes()
    assert [
        "agent.log: has changed since manifest.json was written" in fault for fault in refusal(tmp_path)
    ] == [True]
    assert (tmp_path / "manifest.json").read_bytes() == manifest

    log.write_text("all went well")
    (tmp_path / "manifest.json").write_bytes(manifest[:100])
    assert ["manifest.json: was edited or is damaged" in fault for fault in refusal(tmp_path)] == [True]


@pytest.mark.parametrize("manifest", [True, False], ids=["complete", "interrupted"])
def test_campaign_and_decomposition_edited_in_the_folder_are_refused_with_what_differs(
    tmp_path: Path, manifest: bool
) -> None:
    """Both at once: run, score and verify name the file, the line and the remedy, and rewrite neither."""
    decomposition = made_up_decomposition(tmp_path)  # a file, of which the folder holds a copy
    campaign = small_campaign().model_copy(update={"decomposition": str(decomposition)})
    folder = tmp_path / "out"
    fly(folder, campaign)
    if not manifest:
        (folder / "manifest.json").unlink()
    written = {name: (folder / name).read_text() for name in ("campaign.yaml", "decomposition.yaml")}
    edited = {
        "campaign.yaml": written["campaign.yaml"].replace("replicates: 2", "replicates: 1"),
        "decomposition.yaml": "# reviewed\n" + written["decomposition.yaml"],
    }
    for name, text in edited.items():
        assert text != written[name]
        (folder / name).write_text(text)

    by_run = refusal(folder, campaign)
    with pytest.raises(SetupError) as by_score:
        finish_campaign(folder)
    assert by_run == [str(fault) for fault in by_score.value.faults]
    of_campaign, of_decomposition = by_run
    line = edited["campaign.yaml"].split("replicates: 1")[0].count("\n") + 1
    assert f"campaign.yaml: was edited after it was written: line {line} has 'replicates: 1'" in of_campaign
    assert "in place of 'replicates: 2'" in of_campaign
    assert "line 1 has '# reviewed' in place of nothing" in of_decomposition
    assert all("run your own campaign file again" in fault for fault in by_run)
    assert {name: (folder / name).read_text() for name in written} == edited
    named = {Path(fault.where).name for fault in verify_folder(folder)}
    assert named - {"manifest.json"} == set(edited)
    assert ("manifest.json" in named) is not manifest

    # The remedies: one from a copy, and one deleted.
    (folder / "campaign.yaml").write_text(written["campaign.yaml"])
    (folder / "decomposition.yaml").unlink()
    assert fly(folder, campaign).flown == 0
    assert {name: (folder / name).read_text() for name in written} == written
    assert verify_folder(folder) == []


def test_a_campaign_that_grows_by_its_own_file_is_no_edit(tmp_path: Path) -> None:
    """One more replicate, also where a runner was killed before or after the file was exchanged."""
    fly(tmp_path, campaign=small_campaign(1, replicates=1))
    before = (tmp_path / "campaign.yaml").read_text()
    fly(tmp_path, campaign=small_campaign(1, replicates=2))
    after = (tmp_path / "campaign.yaml").read_text()
    for text in (before, after):
        (tmp_path / "campaign.yaml").write_text(text)
        with open_journal(tmp_path / "journal.sqlite") as journal:
            journal.note("campaign.yaml", json.dumps([before, after]))
        assert fly(tmp_path, campaign=small_campaign(1, replicates=2)).flown == 0
        assert verify_folder(tmp_path) == []


def test_the_manifest_tells_an_edit_of_a_campaign_of_which_the_journal_has_no_copy(tmp_path: Path) -> None:
    """The journal was made anew. Untouched, the folder is taken up, and has one from then on."""
    fly(tmp_path)
    written = (tmp_path / "campaign.yaml").read_text()

    names = ("campaign.yaml", "decomposition.yaml")
    edit_journal(tmp_path, *(("DELETE FROM facts WHERE name = ?", (name,)) for name in names))
    (tmp_path / "campaign.yaml").write_text(written + "# reviewed\n")
    assert ["differs from the one in manifest.json" in fault for fault in refusal(tmp_path)] == [True]
    (tmp_path / "campaign.yaml").write_text(written)
    assert fly(tmp_path).flown == 0
    (tmp_path / "campaign.yaml").write_bytes(written.replace("\n", "\r\n").encode())
    assert ["its line ends are different" in fault for fault in refusal(tmp_path)] == [True]


@pytest.mark.parametrize("name", [".manifest.json.part", ".report.html.part", "simspecs/.p001.json.part"])
def test_half_of_a_file_from_a_killed_runner_is_no_evidence(tmp_path: Path, name: str) -> None:
    """A manifest that listed the half-written file would miss it once the next write has taken its place."""
    fly(tmp_path)
    (tmp_path / name).write_text("half")

    assert verify_folder(tmp_path) == []
    fly(tmp_path)
    assert name not in json.loads((tmp_path / "manifest.json").read_text())["files"]
    (tmp_path / f"{name}s").write_text("not ours")
    assert [str(fault) for fault in verify_folder(tmp_path)] == [f"{name}s: is not in the manifest"]


def test_every_change_of_the_chain_itself_is_noticed(tmp_path: Path) -> None:
    """A line taken out, two exchanged, one edited, one written differently, noise, and no file at all."""
    fly(tmp_path)
    path = tmp_path / "evidence.jsonl"
    content = path.read_bytes()
    lines = content.splitlines(keepends=True)
    assert len(lines) == 6
    changed = {
        2: [lines[0], *lines[2:]],
        3: [*lines[:2], lines[3], lines[2], *lines[4:]],
        5: [*lines[:3], lines[3].replace(b"completed", b"time_limit"), *lines[4:]],
        1: [lines[0].replace(b",", b", "), *lines[1:]],
        6: [*lines[:5], b"\xff noise\n"],
    }
    for number, kept in changed.items():
        path.write_bytes(b"".join(kept))
        (fault,) = refusal(tmp_path)
        assert fault.startswith(f"{path}:{number}: does not follow from the line before")
    path.unlink()
    assert ["is gone, so no result can be checked" in fault for fault in refusal(tmp_path)] == [True]
    path.write_bytes(content)
    assert fly(tmp_path).flown == 0


def test_a_line_that_a_power_cut_tore_is_dropped(tmp_path: Path) -> None:
    """What was not written whole was not noted either; the chain goes on with the next line."""
    fly(tmp_path)
    path = tmp_path / "evidence.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"number":7,"ki')
    assert verify_folder(tmp_path) == []
    CampaignFolder(tmp_path).run(FIRST).joinpath("result.json").unlink()
    fly(tmp_path)
    assert path.read_bytes().startswith(whole + b'{"number":7,"kind":"withdrawn"')
    assert EvidenceLog(path).faults == []


def test_what_is_gone_is_flown_again_with_a_word(tmp_path: Path) -> None:
    """Nothing can be compared: two results are named as lost, withdrawn in the chain, and flown anew."""
    fly(tmp_path)
    CampaignFolder(tmp_path).run(FIRST).joinpath("result.json").unlink()
    CampaignFolder(tmp_path).run(SECOND).joinpath("result.json").unlink()
    events: list[object] = []
    assert fly(tmp_path, observers=[events.append]).flown == 2
    lost = [event.realization for event in events if isinstance(event, ResultLost)]
    assert lost == [FIRST, SECOND]
    kinds = [(line.kind, line.realization) for line in EvidenceLog(tmp_path / "evidence.jsonl").entries(6)]
    assert kinds == [("withdrawn", FIRST), ("withdrawn", SECOND), ("flown", FIRST), ("flown", SECOND)]
    assert verify_folder(tmp_path) == []


def test_a_result_that_somebody_put_there_is_not_taken_up(tmp_path: Path) -> None:
    """The session never started, so no killed runner can have left it."""
    fly(tmp_path / "donor")
    fly(tmp_path / "out", campaign=small_campaign(total_wall_s=1e-9))
    donor, run = (CampaignFolder(tmp_path / name).run(FIRST) for name in ("donor", "out"))
    run.mkdir(parents=True)
    for name in ("recording.mcap", "result.json"):
        (run / name).write_bytes((donor / name).read_bytes())
    assert ["a session that never flew here" in fault for fault in refusal(tmp_path / "out")] == [True]


@pytest.mark.parametrize("where", ["header", "page", "text"])
def test_a_damaged_journal_is_a_sentence_with_file_and_remedy(tmp_path: Path, where: str) -> None:
    """Noise in the header, in a page and in a text: run and verify say which file and what to do. With the
    journal moved away, every result is taken up again from the chain.
    """
    fly(tmp_path)
    path = tmp_path / "journal.sqlite"
    with closing(sqlite3.connect(path)) as journal:
        journal.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    data = bytearray(path.read_bytes())
    match where:
        case "header":
            data[:16] = b"no such database"
        case "page":
            data[4096:8192] = bytes(range(256)) * 16
        case "text":
            at = data.index(b"completed")
            data[at : at + 9] = b"complated"
    path.write_bytes(data)

    (fault,) = refusal(tmp_path)
    assert fault.startswith(f"{path}: is not a campaign journal, or is damaged: ")
    assert "move journal.sqlite* away and run again" in fault
    assert any(str(path) in str(fault) for fault in verify_folder(tmp_path))
    for file in tmp_path.glob("journal.sqlite*"):
        file.rename(tmp_path.parent / file.name)
    summary = fly(tmp_path)
    assert (summary.flown, summary.outcomes) == (0, {Outcome.COMPLETED: 6})
    assert verify_folder(tmp_path) == []
    with open_journal(path) as journal_anew:
        assert len(journal_anew.recordings()) == 6
