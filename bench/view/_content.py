"""What the page asks for, read from a campaign's folder or from the folder of one run. Nothing is written."""

from __future__ import annotations

import json
import re
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Generic, TypeVar

import polars as pl

from bench.campaign import (
    CampaignFolder,
    campaign_state,
    can_check_signatures,
    digest_of,
    fingerprint_of,
    is_campaign,
    open_journal_to_read,
    read_signature,
    signature_faults,
)
from bench.errors import Fault, SetupError
from bench.reporting import (
    csv_text,
    load_report_data,
    matching,
    runs_document,
    runs_table,
    scores_table,
    sheets,
)
from bench.visible_text import visible_values

RECORDING = "recording.mcap"
# Of realizations: letters, digits, hyphens and underscores. A dot alone would name a folder above.
_ID = re.compile(r"[A-Za-z0-9][\w.-]*")
# While a campaign flies, reading its folder rests for so many times the CPU time that it took: 1 % of one core at most.
REST = 99
# Host seconds between two looks at a folder. Chosen: sessions take seconds.
LOOK_S = 1.0
# Of a single recording: the page has no table of runs.
MAX_RESULT_BYTES = 64 * 1024**2

T = TypeVar("T")


class NotThere(Exception):
    """The page asked for something that the folder does not hold."""


class _Rested(Generic[T]):
    """A value that is read again when `stamp` changes, for all threads at once."""

    def __init__(
        self,
        read: Callable[[], T],
        stamp: Callable[[], object],
        is_busy: Callable[[], bool],
        clocks: tuple[Callable[[], float], Callable[[], float]] = (time.monotonic, time.thread_time),
    ) -> None:
        self._read, self._stamp, self._is_busy = read, stamp, is_busy
        self._now_s, self._spent_s = clocks
        self._lock = threading.Lock()
        self._known: tuple[object, T] | None = None
        self._rest_until_s = 0.0

    def get(self) -> T:
        with self._lock:
            stamp = self._stamp()
            if self._known is None or (
                self._known[0] != stamp and (self._now_s() >= self._rest_until_s or not self._is_busy())
            ):
                begin_s = self._spent_s()
                self._known = (stamp, self._read())
                spent_s = self._spent_s() - begin_s
                self._rest_until_s = self._now_s() + max(LOOK_S, REST * spent_s)
            return self._known[1]


class Content(ABC):
    """A folder as the page sees it. `root` is fixed: no answer comes from outside of it."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve(strict=True)

    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """What the folder is, with its scores."""

    @abstractmethod
    def run(self, name: str) -> dict[str, Any]:
        """One run: its result, and how it was scored."""

    @abstractmethod
    def _folder_of(self, name: str) -> Path: ...

    def runs(self) -> dict[str, Any]:
        """The table of runs, column by column."""
        raise NotThere

    def where(self, condition: str) -> dict[str, Any]:
        """The rows of the table of runs for which a condition holds, or why it cannot be read."""
        raise NotThere

    def csv(self, condition: str) -> str:
        """The same rows with all columns."""
        raise NotThere

    def live(self) -> dict[str, Any]:
        """Where a campaign stands."""
        raise NotThere

    def recording(self, name: str) -> Path:
        """The recording of a run, perhaps still being written. Raises NotThere for one that lies outside of the folder."""
        return self._inside(self._folder_of(name) / RECORDING)

    def _inside(self, path: Path) -> Path:
        try:
            resolved = path.resolve(strict=True)
        except (OSError, RuntimeError):  # RuntimeError: a loop of links, before Python 3.13
            raise NotThere from None
        if not resolved.is_relative_to(self.root) or not resolved.is_file():
            raise NotThere
        return resolved

    def _result(self, name: str) -> dict[str, Any]:
        """`result.json` as plain values; empty where there is none yet."""
        try:
            path = self._inside(self._folder_of(name) / "result.json")
            if path.stat().st_size > MAX_RESULT_BYTES:
                return {}
            result = json.loads(path.read_bytes(), parse_constant=lambda _: None)
        except (NotThere, ValueError, RecursionError):
            return {}
        return result if isinstance(result, dict) else {}


class RunContent(Content):
    """The folder of one run."""

    def summary(self) -> dict[str, Any]:
        return {"kind": "run", "name": self.root.name, "run": self.root.name}

    def run(self, name: str) -> dict[str, Any]:
        result = self._result(name)
        return {
            "run": str(result.get("realization", self.root.name)),
            "nodes": [],
            "beside": [],
            "result": result,
        }

    def _folder_of(self, name: str) -> Path:
        if name != self.root.name:
            raise NotThere
        return self.root


class CampaignContent(Content):
    """The folder of a campaign, finished or flying."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self._paths = CampaignFolder(self.root)
        # Once before it is measured: what it imports would count as a second of reading.
        self._read_live()
        self._live = _Rested(self._read_live, time.monotonic, lambda: True)
        is_flying = self._is_flying
        self._data = _Rested(lambda: load_report_data(self.root), self._stamp, is_flying)
        self._table = _Rested(
            lambda: runs_table(self._data.get()), lambda: id(self._data.get()), lambda: False
        )

    def summary(self) -> dict[str, Any]:
        data = self._data.get()
        columns = ("agent", "node", "flown", "runs", "passed", "passed.low", "passed.high")
        more = ("competence_90", "competence_90.low", "score", "difficulty.low", "difficulty.high")
        table = scores_table(data)
        scores = table.filter(pl.col("configuration") == "all") if table.height else table
        return {
            "kind": "campaign",
            "name": data.name,
            "description": data.description,
            "agents": data.agents,
            "study": data.study,
            "roots": data.roots,
            "nodes": [asdict(node) for node in data.nodes.values()],
            "scores": scores.select(*columns, *more).to_dicts(),
            # Of principles alone: a floor of other nodes is a confidence, and no share of runs.
            "floors": {
                name: floor.verdict_passed / floor.verdict_considered
                for name, floor in data.floors.items()
                if floor.verdict_considered and floor.verdict_passed is not None
            },
            "notes": data.notes,
            "sheets": [asdict(sheet) for sheet in sheets(data)],
            "signature": self._signature(),
            "manifest_sha256": digest_of(self._paths.manifest) if self._paths.manifest.is_file() else None,
            "plan": [[entry.id, entry.agent] for entry in self._entries()],
        }

    def runs(self) -> dict[str, Any]:
        return runs_document(self._table.get(), {})

    def where(self, condition: str) -> dict[str, Any]:
        table = self._table.get()
        try:
            chosen = matching(table, condition, "filter")
        except SetupError as error:
            return {"fault": "; ".join(f"{fault.what} ({fault.remedy})" for fault in error.faults)}
        rows = table.select("run").with_row_index("row").join(chosen.select("run"), on="run", how="semi")
        return {"rows": rows["row"].to_list()}

    def csv(self, condition: str) -> str:
        table = self._table.get()
        return csv_text(matching(table, condition, "filter") if condition.strip() else table)

    def run(self, name: str) -> dict[str, Any]:
        data, result = self._data.get(), self._result(name)
        runs = [run for run in data.runs if run.realization == name]
        scene = runs[0].scene if runs else None
        rows = data.scores.filter(pl.col("realization").cast(pl.String) == name)
        columns = ("node", "achieved", "considered", "difficulty", "score", "x", "verdict", "standing")
        return {
            "run": name,
            "agent": runs[0].agent if runs else None,
            "nodes": rows.select(
                pl.col(columns).cast(pl.String) if not rows.height else pl.col(columns)
            ).to_dicts(),
            "beside": [run.realization for run in data.runs if run.scene == scene],
            "result": result,
        }

    def live(self) -> dict[str, Any]:
        return self._live.get()

    def _folder_of(self, name: str) -> Path:
        if not _ID.fullmatch(name):
            raise NotThere
        return self._paths.run(name)

    def _is_flying(self) -> bool:
        return bool(self.live().get("process"))

    def _stamp(self) -> tuple[int, ...]:
        files = (self._paths.scores, self._paths.manifest, self._paths.journal, self._paths.signature)
        times = (path.stat().st_mtime_ns if path.exists() else 0 for path in files)
        return (*times, int(self.live().get("done", 0)))

    def _entries(self) -> list[Any]:
        with open_journal_to_read(self._paths.journal) as journal:
            return journal.entries()

    def _read_live(self) -> dict[str, Any]:
        """The state of the campaign, and of each realization in the order of the plan a sign that `legend` explains."""
        state = campaign_state(self.root).model_dump(mode="json")
        states = [str(entry.outcome or entry.state) for entry in self._entries()]
        legend = list(dict.fromkeys(["planned", "running", *states]))
        if not state["process"]:
            states = ["planned" if name == "running" else name for name in states]
        return {**state, "legend": legend, "cells": "".join(chr(48 + legend.index(name)) for name in states)}

    def _signature(self) -> dict[str, Any]:
        if not self._paths.signature.is_file():
            return {"state": "not signed", "key": None}
        faults = [fault.what for fault in signature_faults(self.root)]
        document = read_signature(self.root)
        checked = (
            "fits manifest.json"
            if can_check_signatures()
            else "was not checked: the extra `sign` is not installed"
        )
        return {
            "state": "; ".join(faults) or checked,
            "key": fingerprint_of(document.public_key) if document else None,
        }


def content_of(path: Path) -> Content:
    """What `rebar view PATH` shows. Raises SetupError for a path that is neither campaign, run nor recording."""
    folder = path.parent if path.name == RECORDING and path.is_file() else path
    if is_campaign(folder):
        return CampaignContent(folder)
    if (folder / RECORDING).is_file():
        return RunContent(folder)
    remedy = "name the folder of a campaign or of a run, or a file recording.mcap"
    raise SetupError(Fault(str(path), "holds neither a campaign nor a recording", remedy))


def document_text(document: object) -> str:
    """JSON in which every character is seen."""
    return json.dumps(visible_values(document), ensure_ascii=False, allow_nan=False)
