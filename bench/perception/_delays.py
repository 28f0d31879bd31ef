"""From exposure to publication: how long each frame's result takes, and the results on their way."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Self

from bench.contracts import Detection, DetectionFrame, SimTime
from bench.simspec import Camera, Seeds, SimSpec, generator

from ._draws import LATENCY_DRAWS, seeds_of_camera


@dataclass(frozen=True, slots=True)
class FrameLatency:
    """The delay that `perception.model` states, drawn anew for each frame."""

    latency_s: float
    jitter_s: float
    seeds: Seeds

    @classmethod
    def of(cls, simspec: SimSpec, camera: Camera) -> Self:
        """The delay of the detections in one camera's frames."""
        model = simspec.perception.model
        return cls(model.latency_s, model.latency_jitter_s, seeds_of_camera(simspec, camera))

    def of_frame(self, number: int) -> float:
        """Seconds from the exposure of frame `number` to the publication of its result."""
        if self.jitter_s == 0.0:
            return self.latency_s
        uniform = float(generator(self.seeds, "perception", LATENCY_DRAWS, number).random())
        return self.latency_s + self.jitter_s * uniform


class DelayedResults:
    """Results on their way, in the order of exposure: one that is late holds up those behind it."""

    def __init__(self, camera: str = "") -> None:
        """`camera` is that of a DetectionFrame."""
        self._camera = camera
        self._waiting: deque[DetectionFrame] = deque()
        self._latest: SimTime | None = None

    def put(self, exposed: SimTime, latency_s: float, detections: tuple[Detection, ...]) -> None:
        """Send the result of one exposure on its way."""
        published = exposed.after(latency_s)
        if self._latest is not None:
            published = max(published, self._latest)
        self._latest = published
        self._waiting.append(DetectionFrame(exposed, published, detections, self._camera))

    def due(self, now: SimTime) -> list[DetectionFrame]:
        """The results that are published by `now` and were not handed out before."""
        ready: list[DetectionFrame] = []
        while self._waiting and self._waiting[0].published <= now:
            ready.append(self._waiting.popleft())
        return ready
