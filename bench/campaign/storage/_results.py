"""`result.json` of a run: written last, read back only if it belongs to run and recording; which recordings stay."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import ValidationError

from bench.contracts import Outcome, SessionResult
from bench.documents import dump_json, load_json_document
from bench.simspec import SimSpec

from .._versions import versions
from ._dropped import drop_recording, dropped_recording
from ._files import digest_of, write_whole
from ._folder import RECORDING, RESULT, CampaignFolder

if TYPE_CHECKING:
    from decompositions import Decomposition

    from .._document import Campaign
    from ._journal import Journal


def write_result(run: Path, result: SessionResult) -> str:
    """Write `result.json` into a run's folder and return its SHA-256.

    Nothing else is written there afterwards.
    """
    return write_whole(run / RESULT, dump_json(result))


def read_result(run: Path, realization: str) -> SessionResult | None:
    """The result in a run's folder.

    None if there is none, if it is damaged, if it is another realization's, or if the recording beside it is
    not the one that it was made from. A recording that was dropped is named by its digest.
    """
    if not (run / RESULT).is_file():
        return None
    try:
        result = SessionResult.model_validate_json((run / RESULT).read_bytes())
    except ValidationError:
        return None
    recording = run / RECORDING
    if result.realization != realization:
        return None
    dropped = dropped_recording(run)
    if dropped is not None and dropped.recording_sha256 == result.recording_sha256:
        return result
    if result.recording_sha256 is not None and not (
        recording.is_file() and digest_of(recording) == result.recording_sha256
    ):
        return None
    return result


class ResultStore:
    """Writes and notes the lasting results of a run of a campaign, and drops the recordings that it does not keep."""

    def __init__(
        self, campaign: Campaign, decomposition: Decomposition, folder: CampaignFolder, journal: Journal
    ) -> None:
        self._campaign, self._decomposition = campaign, decomposition
        self._folder, self._journal = folder, journal

    @property
    def policy(self) -> str:
        """Which recordings are kept, in words."""
        if (keep := self._campaign.keep) is None:
            return "all"
        sample = f" and {keep.sample:.0%} of the others" if keep.sample else ""
        return f"{keep.recordings}{sample}"

    def add(self, result: SessionResult) -> None:
        """Write a result into its run's folder, note it, and decide what becomes of its recording."""
        run = self._folder.run(result.realization)
        self._journal.finish(result, write_result(run, result))
        if self._drops(result):
            self._journal.drop(result.realization, self.policy)
            drop_recording(run, str(result.recording_sha256), self.policy, versions())

    def _drops(self, result: SessionResult) -> bool:
        """Whether the recording of a result goes."""
        keep = self._campaign.keep
        if keep is None or keep.recordings == "all" or result.recording_sha256 is None:
            return False
        if self._is_drawn(result.realization, keep.sample):
            return False
        return keep.recordings == "none" or self._passes(result)

    def _is_drawn(self, realization: str, share: float) -> bool:
        """Whether the run is of the sample: drawn from the design's seed, whatever else the campaign holds."""
        words = (self._campaign.design.seed, zlib.crc32(b"keep"), zlib.crc32(realization.encode()))
        return int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0]) < share * 2**64

    def _passes(self, result: SessionResult) -> bool:
        """Whether a session ended as planned and passed every node under study that it considered."""
        if result.outcome is not Outcome.COMPLETED:
            return False
        # Imported here: campaigns that keep everything do without scoring.
        from bench.scoring import difficulty_of, score_run, studied_key_attributes

        simspec = load_json_document(self._folder.simspec(result.realization), SimSpec)
        scores = score_run(
            self._decomposition, difficulty_of(self._decomposition, simspec), result.observations
        )
        nodes = studied_key_attributes(self._decomposition, self._campaign.study)
        return all(scores[node].confidence in (None, 1.0) for node in nodes)
