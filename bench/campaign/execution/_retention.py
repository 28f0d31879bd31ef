"""Which recordings a campaign keeps."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.contracts import Outcome, SessionResult
from bench.documents import load_json_document
from bench.simspec import SimSpec
from decompositions import Decomposition

from .._document import Keep


class Retention:
    """Decides, once a result is there, whether its recording stays."""

    def __init__(
        self, keep: Keep | None, decomposition: Decomposition, study: Sequence[str], seed: int
    ) -> None:
        self._keep, self._decomposition, self._study, self._seed = keep, decomposition, study, seed

    @property
    def policy(self) -> str:
        """The policy in words."""
        if self._keep is None:
            return "all"
        sample = f" and {self._keep.sample:.0%} of the others" if self._keep.sample else ""
        return f"{self._keep.recordings}{sample}"

    def drops(self, result: SessionResult, simspec: Path) -> bool:
        """Whether the recording of a result goes. `simspec` is the file of its realized SimSpec."""
        if self._keep is None or self._keep.recordings == "all" or result.recording_sha256 is None:
            return False
        if self._is_drawn(result.realization):
            return False
        return self._keep.recordings == "none" or self._passes(result, simspec)

    def _is_drawn(self, realization: str) -> bool:
        """Whether the run is of the sample: drawn from the design's seed, whatever else the campaign holds."""
        words = (self._seed, zlib.crc32(b"keep"), zlib.crc32(realization.encode()))
        number = int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0])
        return self._keep is not None and number < self._keep.sample * 2**64

    def _passes(self, result: SessionResult, simspec: Path) -> bool:
        """Whether a session ended as planned and passed every node under study that it considered."""
        if result.outcome is not Outcome.COMPLETED:
            return False
        # Imported here: scoring brings its arrays along, and campaigns that keep everything do without.
        from bench.scoring import difficulty_of, score_run, studied_key_attributes

        difficulty = difficulty_of(self._decomposition, load_json_document(simspec, SimSpec))
        scores = score_run(self._decomposition, difficulty, result.observations)
        confidences = [
            scores[node].confidence
            for node in studied_key_attributes(self._decomposition, tuple(self._study))
        ]
        return all(confidence in (None, 1.0) for confidence in confidences)
