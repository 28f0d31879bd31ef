"""`evidence.jsonl`: a chain of digests, one line for everything that happened to a result.

A line holds the digests of a result and of its recording, and the digest of the line before it. So no line can be
changed, moved or taken out without a trace in all that follow, and the digest of the last line stands for all
of them. The manifest holds that digest.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from bench.contracts import SessionResult
from bench.documents import Document, open_file
from bench.errors import Fault, SetupError

FIRST_PREVIOUS = "0" * 64
"""What the first line has in place of the digest of the line before."""

Kind = Literal["flown", "measured", "dropped", "withdrawn"]


class EvidenceEntry(Document):
    """One line. The latest line about a realization says which result it has; after `withdrawn` it has none."""

    number: int = Field(ge=1)
    kind: Kind = Field(
        description="flown: the session ended; measured: its recording was measured again; dropped: its recording was deleted by the campaign's `keep`; withdrawn: the result is gone or no longer wanted."
    )
    realization: str
    outcome: str = ""
    result_sha256: str = ""
    recording_sha256: str | None = None
    note: str = ""
    previous: str = Field(description="SHA-256 of the line before, without its line end.")


class EvidenceLog:
    """The chain of one campaign folder as it was when this was made. Only the holder of the folder's lock adds to it.

    `faults` names the first line that does not follow from the one before; only the lines before it count. Lines are
    kept as they are in the file, and parsed when they are asked for: parsed, they take five times as much.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.faults: list[Fault] = []
        self._lines: list[bytes] = []
        self._latest: dict[str, int] = {}
        self._torn = False
        self._read()

    def __len__(self) -> int:
        return len(self._lines)

    def entries(self, begin: int = 0) -> Iterator[EvidenceEntry]:
        """The lines, in their order, without the first `begin` of them."""
        return map(_parsed, islice(self._lines, begin, None))

    def result_of(self, realization: str) -> EvidenceEntry | None:
        """The line about the result that a realization has; None if it has none."""
        place = self._latest.get(realization)
        entry = None if place is None else _parsed(self._lines[place])
        return None if entry is None or entry.kind == "withdrawn" else entry

    def knows(self, realization: str, result_sha256: str) -> bool:
        """Whether any line, also a withdrawn one, is about this result of a realization."""
        return (realization, result_sha256) in self._results

    @cached_property
    def _results(self) -> set[tuple[str, str]]:
        # Asked for only where journal and files disagree, and then perhaps for every realization.
        return {(entry.realization, entry.result_sha256) for entry in self.entries()}

    @property
    def head(self) -> str:
        """The digest of the last line, which stands for the whole chain."""
        return str(self.digest_at(len(self)))

    def digest_at(self, count: int) -> str | None:
        """The digest of the chain's first `count` lines; None if it has fewer."""
        if count > len(self):
            return None
        return hashlib.sha256(self._lines[count - 1]).hexdigest() if count else FIRST_PREVIOUS

    def add_result(self, kind: Kind, result: SessionResult, result_sha256: str) -> None:
        """Add a line about a result, unless the latest one about its realization says the same."""
        last = self.result_of(result.realization)
        if last and (last.result_sha256, last.recording_sha256) == (result_sha256, result.recording_sha256):
            return
        self._add(
            EvidenceEntry(
                number=len(self) + 1,
                kind=kind,
                realization=result.realization,
                outcome=result.outcome,
                result_sha256=result_sha256,
                recording_sha256=result.recording_sha256,
                previous=self.head,
            )
        )

    def drop(self, realization: str, policy: str) -> None:
        """Add a line that the recording behind a result is deleted; the result stays."""
        last = self.result_of(realization)
        if last is not None and last.kind != "dropped":
            self._add(
                last.model_copy(
                    update={
                        "number": len(self) + 1,
                        "kind": "dropped",
                        "note": f"kept are: {policy}",
                        "previous": self.head,
                    }
                )
            )

    def withdraw(self, realization: str, note: str) -> None:
        """Add a line that the realization has no result any more, if it had one."""
        if self.result_of(realization) is not None:
            number = len(self) + 1
            self._add(
                EvidenceEntry(
                    number=number, kind="withdrawn", realization=realization, note=note, previous=self.head
                )
            )

    def _add(self, entry: EvidenceEntry) -> None:
        # What follows a broken line would prove nothing, and would look as if somebody had checked it.
        if self.faults:
            raise SetupError(self.faults)
        line = _line(entry)
        with self.path.open("ab") as file:
            if self._torn:
                # A power cut in mid-line; its result was not noted either.
                file.truncate(sum(len(whole) + 1 for whole in self._lines))
                self._torn = False
            file.write(line + b"\n")
            file.flush()
            os.fsync(file.fileno())
        self._take(entry, line)

    def _take(self, entry: EvidenceEntry, line: bytes) -> None:
        self._latest[entry.realization] = len(self._lines)
        self._lines.append(line)
        if "_results" in self.__dict__:
            self._results.add((entry.realization, entry.result_sha256))

    def _read(self) -> None:
        if not self.path.exists():
            return
        with open_file(self.path) as file:
            content = file.read()
        *lines, torn = content.split(b"\n")
        self._torn = bool(torn)
        for number, line in enumerate(lines, start=1):
            try:
                entry = EvidenceEntry.model_validate_json(line)
            except ValidationError:
                entry = None
            if (
                entry is None
                or entry.number != number
                or entry.previous != self.head
                # Other spellings of the same line would have other digests.
                or _line(entry) != line
            ):
                self.faults = [
                    Fault(
                        f"{self.path}:{number}",
                        "does not follow from the line before: the chain of evidence was edited or damaged",
                        "restore the file from a copy; without one, results from this line on prove nothing",
                    )
                ]
                return
            self._take(entry, line)


def _line(entry: EvidenceEntry) -> bytes:
    return entry.model_dump_json(exclude_defaults=True).encode()


def _parsed(line: bytes) -> EvidenceEntry:
    return EvidenceEntry.model_validate_json(line)
