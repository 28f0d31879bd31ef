"""Scoring a recording again: what a session's result says of observables must follow from its recording alone."""

from __future__ import annotations

from pathlib import Path

from bench.contracts import Outcome, SessionResult, Tape
from bench.documents import load_document
from bench.errors import Fault, SetupError
from bench.recording import read_simspec, read_tape
from decompositions import Decomposition

from ..storage._folder import RECORDING, RESULT, digest_of
from ._measures import measure_all, measures_of

CUT_OFF = "the recording ends without an end: its session was cut off"


def rescore(folder: Path, decomposition: Decomposition) -> SessionResult:
    """The result of the run in `folder`, its observations measured anew from `recording.mcap`.

    How the session ended is taken from `result.json` where that is left, and from the recording otherwise. Raises SetupError
    when the folder holds no recording that can be read, or one that is not the one that its result speaks of.
    """
    recording = folder / RECORDING
    if not recording.is_file():
        raise SetupError(Fault(str(folder), f"there is no {RECORDING} here", "name the folder of a run or of a campaign"))
    faults = changed_since(folder)
    if faults:
        raise SetupError(faults)
    tape = read_tape(recording)
    kept = folder / RESULT
    result = load_document(kept, SessionResult) if kept.is_file() else _from_recording(folder.name, tape)
    observations = measure_all(measures_of(decomposition), tape, read_simspec(recording)) if result.outcome.counts else ()
    return result.model_copy(update={"observations": observations, "recording_sha256": digest_of(recording)})


def changed_since(folder: Path, noted: str | None = None) -> list[Fault]:
    """Whether the recording is another than the one that `result.json` beside it was made of: cut off, edited, exchanged.

    `noted` is the digest that a campaign's journal has of it, which tells when `result.json` is gone or changed as well.
    """
    kept = folder / RESULT
    if noted is not None and digest_of(folder / RECORDING) != noted:
        remedy = "put the recording back, or let `rebar run` fly it again"
        return [Fault(str(folder / RECORDING), "has changed since its session: the journal knows other bytes", remedy)]
    if not kept.is_file():
        return []
    stated = load_document(kept, SessionResult).recording_sha256
    if stated is None or digest_of(folder / RECORDING) == stated:
        return []
    return [
        Fault(
            str(folder / RECORDING),
            f"has changed since its session: {RESULT} speaks of other bytes",
            f"put the recording back, or remove {RESULT} to score what is there",
        )
    ]


def _from_recording(realization: str, tape: Tape) -> SessionResult:
    """What the recording itself says of the session's end; a recording without one was cut off, which is the bench's fault."""
    ended = [event for event in tape.events if event.value.name == "ended"]
    if not ended:
        return SessionResult(realization=realization, outcome=Outcome.WORKER_LOST, reason=CUT_OFF, simulated_s=tape.end_s)
    return SessionResult(
        realization=realization,
        outcome=Outcome(ended[-1].value.text),
        reason="read from the recording",
        simulated_s=ended[-1].time.s,
    )
