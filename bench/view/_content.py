"""What the page asks for, read from a campaign's folder or from the folder of one run. Nothing is written."""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import polars as pl

from bench import campaign, reporting
from bench.errors import SetupError
from bench.scoring import NodeFloor
from bench.visible_text import visible_values

RECORDING = "recording.mcap"
_ID = re.compile(r"[A-Za-z0-9][\w.-]*")  # of realizations; two dots alone would name a folder above
# While a campaign flies, reading its folder rests for so many times the CPU time that it took: 1 % of one core at most.
REST = 99
LOOK_S = 1.0  # host seconds between two looks at a folder. Chosen: sessions take seconds

T = TypeVar("T")


class NotThere(Exception):
    """The page asked for something that the folder does not hold."""


@dataclass
class Rested(Generic[T]):
    """A value that is read again when `stamp` changes, for all threads at once; while `is_busy`, after a rest."""

    read: Callable[[], T]
    stamp: Callable[[], object]
    is_busy: Callable[[], bool] = lambda: False
    now_s: Callable[[], float] = time.monotonic
    spent_s: Callable[[], float] = time.thread_time
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _known: tuple[object, T] | None = None
    _rest_until_s: float = 0.0

    def get(self) -> T:
        """The value, perhaps of before the last change."""
        with self._lock:
            stamp, known = self.stamp(), self._known
            rests = self.now_s() < self._rest_until_s and self.is_busy()
            if known is not None and (known[0] == stamp or rests):
                return known[1]
            begin_s = self.spent_s()
            self._known = (stamp, self.read())
            self._rest_until_s = self.now_s() + max(LOOK_S, REST * (self.spent_s() - begin_s))
            return self._known[1]


class Content:
    """The folder of one run. `root` is fixed: no answer comes from outside of it."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve(strict=True)

    def summary(self) -> dict[str, Any]:
        """What the folder is, with its scores."""
        return {"kind": "run", "name": self.root.name, "run": self.root.name}

    def run(self, name: str) -> dict[str, Any]:
        """One run: its result, how it was scored, and the runs of other agents in its scene."""
        result = self._result(name)
        return {"run": result.get("realization", name), "nodes": [], "beside": [], "result": result}

    def recording(self, name: str) -> Path:
        """The recording of a run, perhaps still being written. Raises NotThere for one outside of the folder."""
        return self._inside(self._folder_of(name) / RECORDING)

    def _folder_of(self, name: str) -> Path:
        if name != self.root.name:
            raise NotThere
        return self.root

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
            result = json.loads(path.read_bytes(), parse_constant=lambda _: None)
        except (NotThere, ValueError, RecursionError):
            return {}
        return result if isinstance(result, dict) else {}


class CampaignContent(Content):
    """The folder of a campaign, finished or flying."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self._paths = campaign.CampaignFolder(self.root)
        # Once before it is measured: what it imports would count as a second of reading.
        self._read_live()
        self._live = Rested(self._read_live, time.monotonic, lambda: True)
        load = partial(reporting.load_report_data, self.root)
        self._data = Rested(load, self._stamp, lambda: self.live()["process"] is not None)
        self._table = Rested(lambda: reporting.runs_table(self._data.get()), lambda: id(self._data.get()))

    def summary(self) -> dict[str, Any]:
        data, manifest = self._data.get(), self._paths.manifest
        return {
            "kind": "campaign",
            "name": data.name,
            "description": data.description,
            "agents": data.agents,
            "roots": data.roots,
            "notes": data.notes,
            "nodes": [asdict(node) for node in data.nodes.values()],
            "scores": reporting.scores_table(data).filter(pl.col("configuration") == "all").to_dicts(),
            "floors": {
                name: share for name in data.floors if (share := _floor(data.floors[name])) is not None
            },
            "sheets": [asdict(sheet) for sheet in reporting.sheets(data)],
            "signature": self._signature(),
            "manifest_sha256": campaign.digest_of(manifest) if manifest.is_file() else None,
            "plan": [[entry.id, entry.agent] for entry in self._entries()],
        }

    def runs(self) -> str:
        """The table of runs, column by column, as JSON. Its texts are as they were: the page shows every character."""
        # Not through `document_text`: of 20,000 runs it would look at millions of values, for ten seconds.
        return json.dumps(
            reporting.runs_document(self._table.get(), {}, {}), ensure_ascii=False, allow_nan=False
        )

    def where(self, condition: str) -> dict[str, Any]:
        """The rows of the table of runs for which a condition holds, or why it cannot be read."""
        table = self._table.get()
        try:
            chosen = reporting.matching(table, condition, "filter")
        except SetupError as error:
            return {"fault": str(error)}
        rows = table.select("run").with_row_index("row").join(chosen.select("run"), on="run", how="semi")
        return {"rows": rows["row"].to_list()}

    def csv(self, condition: str) -> str:
        """The same rows with all columns."""
        table = self._table.get()
        return reporting.csv_text(reporting.matching(table, condition, "filter") if condition else table)

    def run(self, name: str) -> dict[str, Any]:
        data = self._data.get()
        run = next((run for run in data.runs if run.realization == name), None)
        rows = data.scores.filter(pl.col("realization").cast(pl.String) == name)
        columns = ("node", "achieved", "considered", "difficulty", "score", "x", "verdict", "standing")
        return super().run(name) | {
            "agent": run and run.agent,
            "nodes": rows.select(columns).to_dicts(),
            "beside": [other.realization for other in data.runs if run and other.scene == run.scene],
        }

    def live(self) -> dict[str, Any]:
        """Where the campaign stands, and for each realization of the plan a sign that `legend` explains."""
        return self._live.get()

    def _folder_of(self, name: str) -> Path:
        if not _ID.fullmatch(name):
            raise NotThere
        return self._paths.run(name)

    def _stamp(self) -> tuple[int, ...]:
        files = (self._paths.scores, self._paths.manifest, self._paths.journal)
        return (*(path.stat().st_mtime_ns if path.exists() else 0 for path in files), self.live()["done"])

    def _entries(self) -> list[campaign.JournalEntry]:
        with campaign.open_journal_to_read(self._paths.journal) as journal:
            return journal.entries()

    def _read_live(self) -> dict[str, Any]:
        state = campaign.campaign_state(self.root).model_dump(mode="json")
        states = [str(entry.outcome or entry.state) for entry in self._entries()]
        if not state["process"]:
            # A runner that was killed leaves what it flew as running.
            states = ["planned" if name == "running" else name for name in states]
        legend = list(dict.fromkeys(["planned", "running", *states]))
        return {**state, "legend": legend, "cells": "".join(chr(48 + legend.index(name)) for name in states)}

    def _signature(self) -> dict[str, Any]:
        document, faults = campaign.read_signature(self.root), campaign.signature_faults(self.root)
        checked = (
            "fits manifest.json" if campaign.can_check_signatures() else "not checked: needs the extra `sign`"
        )
        state = "; ".join(fault.what for fault in faults) or (checked if document else "not signed")
        return {"state": state, "key": document and campaign.fingerprint_of(document.public_key)}


def _floor(floor: NodeFloor) -> float | None:
    """Of principles alone: a floor of other nodes is a confidence, and no share of runs."""
    passed, considered = floor.verdict_passed, floor.verdict_considered
    return passed / considered if considered and passed is not None else None


def content_of(path: Path) -> Content:
    """What `rebar view PATH` shows. Raises SetupError for a path that is neither campaign, run nor recording."""
    folder = path.parent if path.name == RECORDING and path.is_file() else path
    if campaign.is_campaign(folder):
        return CampaignContent(folder)
    if (folder / RECORDING).is_file():
        return Content(folder)
    remedy = "name the folder of a campaign or of a run, or a file recording.mcap"
    raise SetupError(str(path), "holds neither a campaign nor a recording", remedy)


def document_text(document: object) -> str:
    """JSON in which every character is seen."""
    return json.dumps(visible_values(document), ensure_ascii=False, allow_nan=False)
