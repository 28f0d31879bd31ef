"""Runs of a campaign flown again, and compared bit for bit with what its folder holds."""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import anyio

from bench.contracts import (
    CAMERA_OPENED,
    SESSION_EVENTS,
    Arithmetic,
    EventDocument,
    Outcome,
    SessionResult,
    parse_document,
)
from bench.documents import load_json_document
from bench.recording import (
    RecordingDifference,
    read_metadata,
    read_records,
    read_tape,
    recording_difference,
    truth_distance,
)
from bench.removal import remove_tree
from bench.simspec import RealAutopilot, SimSpec
from bench.streams import String, decode
from bench.temporary_folders import temporary_folder
from decompositions import Decomposition

from .._versions import versions
from ..early_stopping._decisions import is_after_stop
from ..execution._event_loop import blocking, first_error_alone, open_stop_request
from ..execution._executor import FLIGHTS, Executor, OpenExecutor, Task, WorkerPlan
from ..execution._local_pool import open_local_pool
from ..storage._dropped import DroppedRecording, dropped_recording
from ..storage._folder import RECORDING, CampaignFolder
from ..storage._journal_file import open_journal_to_read
from ..storage._results import read_result
from ._finish import read_campaign_folder

# They end a session by the host's clock, so a slower machine ends the same session otherwise.
_TIMED_BY_HOST = frozenset({Outcome.AGENT_TIMEOUT, Outcome.AGENT_NEVER_CONNECTED})
_NEED_NOT_REPEAT = "a real autopilot flew, which need not repeat itself"
# What is no property of the session: seconds of the host, connections of strangers, paths in texts.
_OF_HOST = {"wall_s", "cpu_s", "agent_cpu_s", "counters", "reason", "facts"}


class ReflownStatus(StrEnum):
    IDENTICAL = "identical"  # recording and result are the same, bit for bit
    DIFFERENT = "different"
    # Of a real autopilot, which need not repeat itself: the same flight and results with other records; or how far the
    # two flights came apart.
    EQUAL = "equal"
    APART = "apart"
    OTHER_VERSIONS = "other versions"  # cannot be compared bit for bit: other software wrote the recording
    NOT_FLOWN = "not flown"  # the host or the set-up here kept the session from flying to its end


@dataclass(frozen=True, slots=True)
class ReflownRun:
    """A run that was flown again. `explanation` says where it differs, or why it could not be compared. `apart_m` is the
    largest distance between the two truths, where the recordings differ.
    """

    realization: str
    status: ReflownStatus
    explanation: str = ""
    apart_m: float | None = None


@dataclass(frozen=True, slots=True)
class ReflownSample:
    """Runs drawn with `seed` from `comparable` ones. `not_comparable` are the other runs that count, by reason."""

    seed: int
    comparable: int
    runs: tuple[ReflownRun, ...]
    not_comparable: Mapping[str, tuple[str, ...]]


def refly(
    path: Path,
    count: int,
    seed: int,
    workers: int = 1,
    *,
    job: str = FLIGHTS.flight,
    open_executor: OpenExecutor = open_local_pool,
) -> ReflownSample:
    """Draw up to `count` counted lockstep runs of a campaign folder, fly each again in a temporary folder, and compare.

    Writes nothing in the campaign folder. Check it with `verify_folder` first. The same seed draws the same
    runs from the same folder. Raises SetupError if the folder is no campaign or something in it cannot be read,
    KeyboardInterrupt on SIGINT or SIGTERM, WorkersUnusable if no worker process can be started.
    """
    folder, _, decomposition = read_campaign_folder(path)
    results, not_comparable = _counted_runs(folder)
    drawn = sorted(random.Random(seed).sample(sorted(results), min(count, len(results))))
    runs: list[ReflownRun] = []
    if drawn:
        with temporary_folder("refly") as home:
            flight = _Reflight(folder, decomposition, home, job, open_executor)
            fly = blocking(flight.fly)
            runs = fly({name: results[name] for name in drawn}, min(workers, len(drawn)))
    return ReflownSample(
        seed, len(results), tuple(sorted(runs, key=lambda run: run.realization)), not_comparable
    )


def _counted_runs(folder: CampaignFolder) -> tuple[dict[str, SessionResult], dict[str, tuple[str, ...]]]:
    """The results that can be compared, and the other runs that count, by the reason why they cannot."""
    comparable: dict[str, SessionResult] = {}
    others = defaultdict(list)
    with open_journal_to_read(folder.journal) as journal:
        stops = journal.stops()
        for entry in journal.entries():
            result = read_result(folder.run(entry.id), entry.id)
            if result is None or not result.outcome.counts or is_after_stop(entry, stops):
                continue
            if result.recording_sha256 is None:
                others["without a recording"].append(entry.id)
            elif result.outcome in _TIMED_BY_HOST:
                others["ended by the host's clock"].append(entry.id)
            elif reason := _not_repeatable(load_json_document(folder.simspec(entry.id), SimSpec)):
                others[reason].append(entry.id)
            else:
                comparable[entry.id] = result
    return comparable, {reason: tuple(names) for reason, names in sorted(others.items())}


def _not_repeatable(simspec: SimSpec) -> str:
    """Why nobody can fly a session with this SimSpec again bit for bit; empty if it can be done."""
    if simspec.pace.mode != "lockstep":
        # Most clients repeat in warp, but not those in which one message wakes two threads (docs/time.md).
        return "flown in warp" if simspec.pace.mode == "warp" else "flown in real time"
    # What comes over these is nobody's to repeat.
    if any(link.heard for link in simspec.vehicle.outside_links):
        return "with a link from outside that the vehicle obeys"
    return "with services from outside" if simspec.agent.services else ""


def _need_not_repeat(simspec: SimSpec) -> bool:
    """Whether a real autopilot flies. PX4's threads run in wall time between two samples, and at the pace `quiet` two of
    ten flights differed all the same; ArduPilot repeated by script, but not always with an agent (docs/real-autopilots.md).
    """
    return isinstance(simspec.vehicle.autopilot, RealAutopilot)


class _Reflight:
    """Flights of one campaign's runs in a folder of their own."""

    def __init__(
        self,
        folder: CampaignFolder,
        decomposition: Decomposition,
        home: Path,
        job: str,
        open_executor: OpenExecutor,
    ) -> None:
        self._folder, self._home = folder, home
        self._plan, self._open_executor = WorkerPlan(job, decomposition), open_executor

    async def fly(self, results: Mapping[str, SessionResult], workers: int) -> list[ReflownRun]:
        """Fly these runs and compare each with its result."""
        runs: list[ReflownRun] = []
        waiting = iter(results.items())

        async def fly_one_by_one(executor: Executor) -> None:
            for name, result in waiting:  # one iterator that all of them share is the whole queue
                reflown = await executor.fly(self._task(name), on_start=lambda worker: None)
                runs.append(self._compare(result, reflown))
                # Recordings of a large sample would fill a small temporary disk.
                remove_tree(self._home / name)

        with first_error_alone():
            async with (
                open_stop_request() as stop,
                self._open_executor(self._plan, workers, self._home) as executor,
            ):
                with stop.scope:
                    async with anyio.create_task_group() as flights:
                        for _ in range(workers):
                            flights.start_soon(fly_one_by_one, executor)
        if stop.reason is not None:
            raise KeyboardInterrupt
        return runs

    def _task(self, realization: str) -> Task:
        simspec = self._folder.simspec(realization).resolve()
        run = self._home / realization
        run.mkdir()
        return Task(realization, simspec, run, load_json_document(simspec, SimSpec).budgets.wall_s)

    def _compare(self, result: SessionResult, reflown: SessionResult) -> ReflownRun:
        name = result.realization
        if not reflown.outcome.counts or reflown.outcome in _TIMED_BY_HOST:
            return ReflownRun(name, ReflownStatus.NOT_FLOWN, f"{reflown.outcome}: {_brief(reflown.reason)}")
        if result.recording_sha256 == reflown.recording_sha256:
            fields = _different_fields(result, reflown)
            if not fields:
                return ReflownRun(name, ReflownStatus.IDENTICAL)
            what = f"the recordings are equal, the results differ in {', '.join(fields)}"
            return ReflownRun(name, ReflownStatus.DIFFERENT, what)
        if (dropped := dropped_recording(self._folder.run(name))) is not None:
            return self._unlike_dropped(name, dropped, _other_arithmetic(result, reflown))
        recordings = self._folder.run(name) / RECORDING, self._home / name / RECORDING
        difference = recording_difference(*recordings)
        software = _other_versions(*recordings) + _other_arithmetic(result, reflown)
        fields = [field for field in _different_fields(result, reflown) if field != "recording_sha256"]
        if software:
            return self._of_other_software(name, recordings, difference, fields, software)
        if difference is None:
            return ReflownRun(name, ReflownStatus.DIFFERENT, "the same content is stored in other bytes")
        return self._apart(name, recordings, str(difference), fields)

    def _of_other_software(
        self,
        name: str,
        recordings: tuple[Path, Path],
        difference: RecordingDifference | None,
        fields: list[str],
        software: list[str],
    ) -> ReflownRun:
        what = f"cannot be compared bit for bit: it was flown with {', '.join(software)}"
        if difference is None or difference.time_s is None:
            return ReflownRun(name, ReflownStatus.OTHER_VERSIONS, f"{what}; all records are equal")
        # Last bits or another flight: the distance and the observations say which.
        distance = truth_distance(*(read_tape(recording) for recording in recordings))
        parts = [what, str(difference), *([str(distance)] if distance else []), _results_text(fields)]
        apart_m = distance.distance_m if distance else None
        return ReflownRun(name, ReflownStatus.OTHER_VERSIONS, "; ".join(parts), apart_m)

    def _unlike_dropped(
        self, name: str, dropped: DroppedRecording, other_arithmetic: list[str]
    ) -> ReflownRun:
        what = "it has another digest than the recording that was dropped; what differs cannot be told"
        if software := _version_differences(dropped.versions, versions()) + other_arithmetic:
            what = f"cannot be compared bit for bit: it was flown with {', '.join(software)}; {what}"
            return ReflownRun(name, ReflownStatus.OTHER_VERSIONS, what)
        if _need_not_repeat(load_json_document(self._folder.simspec(name), SimSpec)):
            what = f"{_NEED_NOT_REPEAT}: {what}"
            return ReflownRun(name, ReflownStatus.APART, what)
        return ReflownRun(name, ReflownStatus.DIFFERENT, what)

    def _apart(
        self, name: str, recordings: tuple[Path, Path], difference: str, fields: list[str]
    ) -> ReflownRun:
        distance = truth_distance(*(read_tape(recording) for recording in recordings))
        apart_m = distance.distance_m if distance else None
        where = f"{difference}; {distance}" if distance else difference
        if not _need_not_repeat(load_json_document(self._folder.simspec(name), SimSpec)):
            return ReflownRun(name, ReflownStatus.DIFFERENT, where, apart_m)
        what = f"{_NEED_NOT_REPEAT}: {distance or difference}; {_results_text(fields)}"
        status = ReflownStatus.EQUAL if apart_m == 0.0 and not fields else ReflownStatus.APART
        return ReflownRun(name, status, what, apart_m)


def _results_text(fields: list[str]) -> str:
    return f"the results differ in {', '.join(fields)}" if fields else "the results are equal"


def _different_fields(result: SessionResult, reflown: SessionResult) -> list[str]:
    """The fields in which two results of one session differ, observations by their ids."""
    first, second = (run.model_dump(exclude=_OF_HOST | {"observations"}) for run in (result, reflown))
    observations = [
        {observation.observable: observation for observation in run.observations} for run in (result, reflown)
    ]
    ids = sorted(observations[0].keys() | observations[1].keys())
    return [
        *(field for field in first if first[field] != second[field]),
        *(name for name in ids if observations[0].get(name) != observations[1].get(name)),
    ]


def _other_versions(recording: Path, reflown: Path) -> list[str]:
    """Each package of which another version wrote the recording, with both versions; other builds of renderers and OpenCV too."""
    cameras = [
        f"{old} (here {new})"
        for old, new in zip(_camera_builds(recording), _camera_builds(reflown), strict=False)
        if old != new
    ]
    return cameras + _version_differences(read_metadata(recording).get("rebar.versions", {}), versions())


def _other_arithmetic(result: SessionResult, reflown: SessionResult) -> list[str]:
    """Where the hosts of two flights compute differently; nothing for a result that does not say where it was flown."""
    written, here = (run.fact(Arithmetic) for run in (result, reflown))
    return _version_differences(written.model_dump(), here.model_dump()) if written and here else []


def _version_differences(written: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    return [
        f"{name} {written.get(name, 'unknown')} (here {here.get(name, 'not installed')})"
        for name in sorted(written.keys() | here.keys())
        if written.get(name) != here.get(name)
    ]


def _camera_builds(recording: Path) -> list[str]:
    """What drew the pictures of each camera, in the order in which they were opened; empty if none were drawn."""
    builds = []
    for record in read_records(recording):
        message = decode(String, record.data) if record.topic == SESSION_EVENTS else None
        event = parse_document(EventDocument, message.data) if message is not None else None
        if event is not None and event.name == CAMERA_OPENED:
            builds.append(event.text)
    return builds


def _brief(reason: str) -> str:
    # The last line of a traceback says what went wrong.
    return next(reversed(reason.strip().splitlines()), "")
