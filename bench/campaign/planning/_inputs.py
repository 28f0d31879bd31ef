"""`campaign.yaml` and `decomposition.yaml`: what a campaign folder was made from, kept in the journal too.

A person may take the copies in the folder for the files to edit. The journal's copy tells an edit from what the
bench wrote, and says what was edited.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from difflib import SequenceMatcher
from pathlib import Path

from bench.documents import MAX_BYTES
from bench.errors import Fault, SetupError

from ..storage._files import digest_of, write_whole
from ..storage._folder import CampaignFolder
from ..storage._journal import Journal
from ..storage._manifest import Manifest

# An error stays readable in a terminal; a whole situation may stand in one line.
_SHOWN_CHARACTERS = 60


def write_input(path: Path, text: str, journal: Journal) -> None:
    """Write one of the two documents and note its text in the journal. Raises SetupError for one that is too large."""
    if len(text.encode()) > MAX_BYTES:
        what = f"would be larger than {MAX_BYTES} bytes, and could not be read again"
        raise SetupError(path, what, "make several campaigns of it")
    noted = _noted(journal, path)
    if noted != [text]:
        # Both texts while the file is exchanged: after a kill in between, neither of them is an edit.
        journal.note(path.name, json.dumps([*noted, text]))
    write_whole(path, text)
    journal.note(path.name, json.dumps([text]))


def input_faults(folder: CampaignFolder, journal: Journal, manifest: Manifest | None) -> Iterator[Fault]:
    """A fault for each of the two that is not what was written. One that is gone is no fault: it is made again."""
    for path in (folder.campaign, folder.decomposition):
        if not path.is_file():
            continue
        noted = _noted(journal, path)
        text = _text(path)
        edit = ""
        if noted:
            edit = "" if text in noted else _first_edit(noted[-1], text)
        # The journal was made anew: the manifest has the digest alone.
        elif manifest and manifest.files.get(path.name) not in (None, digest_of(path)):
            edit = f"differs from the one in {folder.manifest.name}"
        if edit:
            yield Fault(
                str(path),
                f"was edited after it was written: {edit}",
                "restore it from a copy, or delete it and run your own campaign file again with "
                f"--out {folder.path}; to change the campaign, edit that file, not the copy in the folder",
            )


def _noted(journal: Journal, path: Path) -> list[str]:
    """The texts that the file may have: one, or two if a runner was killed while it wrote the second."""
    texts: list[str] = json.loads(journal.fact(path.name) or "[]")
    return texts


def _text(path: Path) -> str:
    # Not `read_text`: it would hide that line ends were changed.
    return path.read_bytes().decode(errors="replace")


def _first_edit(written: str, present: str) -> str:
    """The first line in which two texts differ, and how many differ after it."""
    old, new = written.splitlines(), present.splitlines()
    edits = [
        edit for edit in SequenceMatcher(None, old, new, autojunk=False).get_opcodes() if edit[0] != "equal"
    ]
    if not edits:
        return "its line ends are different"
    _, old_begin, old_end, new_begin, new_end = edits[0]
    was, now = (
        _shown(lines[begin:end])
        for lines, begin, end in ((old, old_begin, old_end), (new, new_begin, new_end))
    )
    more = f", and in {len(edits) - 1} more places" if len(edits) > 1 else ""
    return f"line {new_begin + 1} has {now} in place of {was}{more}"


def _shown(lines: list[str]) -> str:
    text = " ".join(" ".join(lines).split())
    if not text:
        return "nothing"
    return repr(text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}...")
