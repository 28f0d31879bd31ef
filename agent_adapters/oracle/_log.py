"""What the oracle publishes of what it knows."""

from __future__ import annotations

from ..reference._log import Log, Publish
from ..reference.perception._tracks import Tracks
from ._perception import TruthPerception


class OracleLog(Log):
    """Publishes tracks of what the camera has had in view, and of nothing else that the oracle knows."""

    def __init__(self, publish: Publish, vehicle: str, eyes: TruthPerception) -> None:
        super().__init__(publish, vehicle)
        self._published = eyes.truth_tracks.published

    def publish_due(self, tracks: Tracks) -> None:
        super().publish_due(self._published)


class SilentLog(Log):
    """Takes what a watch would say: the oracle says it from the schedule."""

    def __init__(self, log: Log) -> None:
        self._log = log

    @property
    def now_s(self) -> float:  # type: ignore[override]
        return self._log.now_s

    def decide(self, *decision: object, **details: object) -> None:
        """Say nothing, whatever was decided."""
