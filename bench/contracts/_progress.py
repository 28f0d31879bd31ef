"""How far a session is, for those who watch it; nothing of it is recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ProgressUpdate:
    """Where a session stands.

    `speed` is simulated seconds for each host second since the update before, `wall_s` host seconds since the session began.
    `phase` is the agent's last `AgentStatus.phase`; None: it has stated none yet.
    """

    simulated_s: float
    time_limit_s: float
    wall_s: float
    speed: float
    phase: str | None = None


OnProgress = Callable[[ProgressUpdate], None]
"""Called with each update, from the session's own thread: returns at once and never raises."""


def ignore_progress(update: ProgressUpdate) -> None:
    """For sessions that nobody watches."""
    del update
