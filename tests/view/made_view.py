"""A made campaign with a journal and recordings, served to a test."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any

import yaml

from bench.campaign import open_journal, write_result
from bench.campaign.storage._journal import PlannedRealization
from bench.contracts import AgentStatus, Evidence, Observation, Record, SessionResult, VehicleTopics
from bench.realization import RealizationPlan
from bench.simspec import SimSpec
from bench.view import Content, ViewServer

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import (
    OBSERVABLES,
    Made,
    _document_record,
    made_simspec,
    made_tape,
    make_campaign,
    write_recording,
)

MARKED_S = 60.0
"""When both agents report the first target, and the naive one marks it."""

STAGES = "close-1: in view at 20.0 s, never <i>held</i>"


def made_view(folder: Path, reason: str = "three views, one label") -> Path:
    """A campaign folder that is complete but for its last realization, which was planned and never flown."""
    made = Made(scenes=3)
    make_campaign(folder, made)
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    base = made_simspec(0, made.agents[0]).model_dump(mode="json", exclude={"realized"}, exclude_none=True)
    (folder / "campaign.yaml").write_text(yaml.safe_dump({**campaign, "base": base}))
    names = sorted(path.name for path in (folder / "runs").iterdir())
    with open_journal(folder / "journal.sqlite") as journal:
        simspec = made_simspec(0, made.agents[0])
        plans = [plan_of(name, simspec) for name in [*names, "p900-r0-reference-naive"]]
        journal.add(PlannedRealization(plan, "", "") for plan in plans)
        for name in names:
            result = fly(folder, name, reason)
            journal.finish(result, write_result(folder / "runs" / name, result))
    return folder


def plan_of(name: str, simspec: SimSpec) -> RealizationPlan:
    """A realization of the journal, by its name `pPPP-rR-AGENT`."""
    return RealizationPlan(name, name[:4], 0, {}, simspec, simspec.agent, 0)


def fly(folder: Path, name: str, reason: str) -> SessionResult:
    """Write the recording of a run, and return its result with a moment for each observable of KA-18."""
    point, _, agent = name.split("-", 2)
    simspec = made_simspec(int(point[1:]), agent)
    run = folder / "runs" / name
    run.mkdir(exist_ok=True)
    digest = write_recording(
        run / "recording.mcap", simspec, made_tape(simspec, reason), statuses(simspec, reason)
    )
    moment = Evidence(time_s=MARKED_S, text="marked beside <i>three</i> people")
    observations = tuple(
        Observation(observable=node, considered=True, x=0.5, evidence=(moment,), stages=STAGES)
        for node in OBSERVABLES["KA-18"]
    )
    stored = run / "result.json"
    result = SessionResult.model_validate_json(stored.read_text())
    return result.model_copy(update={"recording_sha256": digest, "observations": observations})


def statuses(simspec: SimSpec, text: str) -> list[Record]:
    """The agent's phases."""
    topic = VehicleTopics(simspec.vehicle.name).status
    phases: dict[float, Any] = {0.5: "starting", 10.0: "searching", 100.0: "returning"}
    said = [AgentStatus(time_s=time_s, phase=phase, text=text) for time_s, phase in phases.items()]
    return [_document_record(status.time_s, topic, status) for status in said]


def finish_last(folder: Path) -> str:
    """Fly what `made_view` has left, as a runner would; its name."""
    name, run = "p900-r0-reference-naive", folder / "runs" / "p900-r0-reference-naive"
    run.mkdir()
    first = folder / "runs" / "p000-r0-reference-naive"
    (run / "result.json").write_text((first / "result.json").read_text().replace(first.name, name))
    result = fly(folder, name, "")
    with open_journal(folder / "journal.sqlite") as journal:
        journal.finish(result, write_result(run, result))
    return name


@contextmanager
def served(content: Content) -> Iterator[ViewServer]:
    """A server of this content, on a thread."""
    with ViewServer(content) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


Ask = Callable[..., HTTPResponse]


@contextmanager
def asking(server: ViewServer) -> Iterator[Ask]:
    """A function that asks the server for a path with headers, and `method`; whatever it opened is closed."""
    opened: list[HTTPConnection] = []

    def ask(path: str, headers: Mapping[str, str] = {}, method: str = "GET") -> HTTPResponse:
        connection = HTTPConnection("127.0.0.1", server.server_port, timeout=60)
        opened.append(connection)
        connection.request(method, path, headers=dict(headers))
        return connection.getresponse()

    try:
        yield ask
    finally:
        for connection in opened:
            connection.close()


def cookie_of(server: ViewServer, ask: Ask) -> dict[str, str]:
    """The header that a browser sends once it has opened the printed address."""
    answer = ask(f"/?token={server.token}")
    return {"Cookie": str(answer.headers["Set-Cookie"]).split(";")[0]}
