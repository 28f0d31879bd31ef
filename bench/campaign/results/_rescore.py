"""Measures a recording again. The observations of a result follow from its recording alone."""

from __future__ import annotations

import zlib
from pathlib import Path

from bench.contracts import Outcome, ReportStatements, SessionResult, Tape, TruthSightings
from bench.documents import dump_json, load_json_document
from bench.errors import Fault, SetupError
from bench.recording import check_whole, read_simspec, read_tape
from decompositions import Decomposition

from ..planning._honeypots import truth_sightings
from ..planning._measures import measure_all, measures_of
from ..planning._statements import report_statements
from ..storage._files import digest_of
from ..storage._folder import RECORDING, RESULT, campaign_of

MEASURED_FACTS = (TruthSightings.key, ReportStatements.key)
"""Facts that follow from the recording, as observations do."""

CUT_OFF = "the recording has no end event: its session was cut off"
# A campaign knows its recordings by their digests, so there a result that is deleted lets no other one in.
_REMEDY_IN_CAMPAIGN = "restore it from a copy, or delete it to fly the session again with `rebar run`"
_REMEDY_ELSEWHERE = f"restore it from a copy; a recording that was edited and is whole is scored as it is if you delete {RESULT}"


def rescore(folder: Path, decomposition: Decomposition) -> SessionResult:
    """The result of the run in `folder`, with its observations measured again from `recording.mcap`.

    The outcome is taken from `result.json` if there is one, and from the recording otherwise. Raises SetupError if the folder
    has no readable recording, one that differs from the recording of its result, or one without a result that is damaged.
    """
    recording = folder / RECORDING
    if not recording.is_file():
        raise SetupError(folder, f"there is no {RECORDING} here", "name the folder of a run or of a campaign")
    faults = recording_faults(folder)
    if faults:
        raise SetupError(faults)
    file = folder / RESULT
    written = load_json_document(file, SessionResult) if file.is_file() else None
    # Without a digest only the recording itself says whether it is as it was written.
    if written is None or written.recording_sha256 is None:
        check_whole(recording)
    simspec = read_simspec(recording)
    tape = read_tape(recording, simspec)
    result = written or _from_recording(folder.name, tape)
    observations = measure_all(measures_of(decomposition), tape, simspec) if result.outcome.counts else ()
    return result.model_copy(
        update={
            "observations": observations,
            "recording_sha256": digest_of(recording),
            "facts": {key: fact for key, fact in result.facts.items() if key not in MEASURED_FACTS},
        }
    ).with_facts(*truth_sightings(simspec, tape), *report_statements(simspec, tape))


def pack_rescored(folder: Path, decomposition: Decomposition) -> bytes:
    """`rescore`, as compressed JSON: results wait until all are there, and parsed ones take thirty times as much."""
    return zlib.compress(dump_json(rescore(folder, decomposition)).encode())


def unpack_rescored(content: bytes) -> SessionResult:
    """The result that `pack_rescored` packed."""
    return SessionResult.model_validate_json(zlib.decompress(content))


def recording_faults(folder: Path, journal_sha256: str | None = None) -> list[Fault]:
    """A fault if the recording is not the one that `result.json` was made from: cut off, edited or exchanged.

    `journal_sha256` is its digest in the campaign's journal, which also works when `result.json` is gone or
    changed.
    """
    if journal_sha256 is not None and digest_of(folder / RECORDING) != journal_sha256:
        return [_changed_recording(folder, "the journal", _REMEDY_IN_CAMPAIGN)]
    file = folder / RESULT
    if not file.is_file():
        return []
    result_sha256 = load_json_document(file, SessionResult).recording_sha256
    if result_sha256 is None or digest_of(folder / RECORDING) == result_sha256:
        return []
    remedy = _REMEDY_ELSEWHERE if campaign_of(folder) is None else _REMEDY_IN_CAMPAIGN
    return [_changed_recording(folder, RESULT, remedy)]


def _changed_recording(folder: Path, witness: str, remedy: str) -> Fault:
    what = f"has changed since its session: its digest differs from the one in {witness}"
    return Fault(str(folder / RECORDING), what, remedy)


def _from_recording(realization: str, tape: Tape) -> SessionResult:
    """A result with the outcome that the recording itself holds."""
    ended = [event for event in tape.events if event.value.name == "ended"]
    if not ended:
        # Every session records its end, whatever the agent does, so without one the bench was killed.
        return SessionResult(
            realization=realization, outcome=Outcome.WORKER_LOST, reason=CUT_OFF, simulated_s=tape.end_s
        )
    return SessionResult(
        realization=realization,
        outcome=Outcome(ended[-1].value.text),
        reason="read from the recording",
        simulated_s=ended[-1].time.s,
    )
