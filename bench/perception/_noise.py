"""Random processes of every actor that are alike in near moments."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bench.contracts import SimTime

_ROOT_HALF = math.sqrt(0.5)


class CorrelatedNoise:
    """Standard normal processes of every actor, first-order Markov in time: exactly normal at any moment,
    alike in near ones. `memory_s` has the correlation time of each process.
    """

    def __init__(self, actors: int, memory_s: tuple[float, ...]) -> None:
        self._memory_s = np.array(memory_s)
        self._state = np.zeros((actors, len(memory_s)))
        self._moment: SimTime | None = None

    def advance(self, to: SimTime, draws: NDArray[np.float64]) -> None:
        """Move to a moment, with a fresh standard normal for each actor and process."""
        keep = np.zeros(len(self._memory_s))
        if self._moment is not None:
            # A correlation time of 0 means independent frames; the floor keeps the division finite.
            keep = np.exp(-to.since(self._moment) / np.maximum(self._memory_s, 1e-9))
        self._state = keep * self._state + np.sqrt(1.0 - keep * keep) * draws
        self._moment = to

    def normal(self, process: int, actor: int) -> float:
        """The present value of one process."""
        return float(self._state[actor, process])

    def uniform(self, process: int, actor: int) -> float:
        """The present value of one process, made uniform on [0, 1] by the normal distribution function."""
        return 0.5 * math.erfc(-float(self._state[actor, process]) * _ROOT_HALF)


def uniform_of(normal: float) -> float:
    """A standard normal made uniform on [0, 1]."""
    return 0.5 * math.erfc(-normal * _ROOT_HALF)
