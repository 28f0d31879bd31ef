"""What a worker is given, and what it says back."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from bench.contracts import SessionResult
from bench.errors import RebarError
from bench.simspec import SimSpec

FLY = "bench.campaign.execution._flight:fly_realization"


class Job(Protocol):
    """What a worker does with a realization: fly it into `folder` (there, and empty) and return the result, unwritten."""

    def __call__(self, simspec: SimSpec, decomposition: Any, folder: Path, realization: str) -> SessionResult: ...


@dataclass(frozen=True, slots=True)
class Task:
    """One realization to fly. It ends by the host's clock after `wall_s`, by its own means or by force."""

    realization: str
    simspec: Path
    folder: Path
    wall_s: float


@dataclass(frozen=True, slots=True)
class WorkerPlan:
    """What a worker process is told once: its job, by importable path, and what all tasks share."""

    job: str
    decomposition: Any


@dataclass(frozen=True, slots=True)
class Ready:
    """The worker has imported its job."""


@dataclass(frozen=True, slots=True)
class Broken:
    """The worker cannot import its job; no task would fare better."""

    reason: str


@dataclass(frozen=True, slots=True)
class Ended:
    """A task is over."""

    realization: str
    worker: str
    result: SessionResult


class WorkersUnusable(RebarError):
    """No worker can be brought to work; nothing was decided about any realization."""


class BenchBroken(RebarError):
    """Every one of the first sessions ended by a fault of the bench's own; the others would fare no better."""


def load_job(path: str) -> Job:
    """The function behind `module:name`."""
    module, _, name = path.partition(":")
    job: Job = getattr(importlib.import_module(module), name)
    return job
