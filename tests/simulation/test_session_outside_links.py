"""Links that lead out of the session: whoever looks on sees the vehicle, and changes nothing."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from ports import free_port
from pydantic import ValidationError
from pymavlink.dialects.v20 import common
from test_session import session_simspec

from bench.agents import open_agent
from bench.contracts import OPERATOR_LINK, MavlinkNeed, Outcome, Record
from bench.simspec import Mission, OutsideLink, SimSpec, VehicleSpec
from bench.simulation import SessionPlan, run_session, session_faults
from bench.testing import agent_manifest


@dataclass
class GroundStation:
    """Listens on a UDP port of its own and answers each datagram with a command to arm."""

    sock: socket.socket
    datagrams: list[bytes] = field(default_factory=list)

    @property
    def port(self) -> int:
        return int(self.sock.getsockname()[1])

    def serve(self) -> None:
        mav = common.MAVLink(None, srcSystem=255, srcComponent=190)
        arm = mav.command_long_encode(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0).pack(mav)
        while True:
            data, sender = self.sock.recvfrom(65536)
            if sender == self.sock.getsockname():
                return
            self.datagrams.append(data)
            self.sock.sendto(arm, sender)

    def kinds(self) -> set[str]:
        """Names of the messages that came."""
        mav = common.MAVLink(None)
        messages = [message for data in self.datagrams for message in mav.parse_buffer(data) or ()]
        return {message.get_type() for message in messages}


@contextmanager
def ground_station() -> Iterator[GroundStation]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        station = GroundStation(sock)
        thread = threading.Thread(target=station.serve)
        thread.start()
        try:
            yield station
        finally:
            sock.sendto(b"", sock.getsockname())
            thread.join()


def situation(*links: OutsideLink) -> SimSpec:
    """A quadrotor that stands on the ground for five simulated seconds."""
    return session_simspec(
        vehicle=VehicleSpec(model="x500", outside_links=links), mission=Mission(time_limit_s=5.0)
    )


def fly(folder: Path, spec: SimSpec) -> list[Record]:
    records: list[Record] = []
    folder.mkdir()
    plan = SessionPlan(spec, agent_manifest("idle"), folder, open_agent, folder / "scratch", records.append)
    end = run_session(plan)
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    return records


def events(records: list[Record]) -> set[str]:
    return {record.topic for record in records}


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    """What is recorded with no link to outside."""
    return fly(tmp_path_factory.mktemp("alone") / "run", situation())


def test_two_who_look_on_see_the_vehicle_and_change_no_record(tmp_path: Path, alone: list[Record]) -> None:
    """Both stations ask to arm the whole time; the recording is that of a session without them."""
    with ground_station() as first, ground_station() as second:
        links = (
            OutsideLink(name="tower", port=first.port),
            OutsideLink(name="van", port=second.port, streams="onboard"),
        )
        watched = fly(tmp_path / "run", situation(*links))
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT", "SYS_STATUS"} <= first.kinds()
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT"} <= second.kinds()
    assert watched == alone
    assert not any("tower" in topic or "van" in topic for topic in events(watched))


def test_nobody_there_gives_the_same_records(tmp_path: Path, alone: list[Record]) -> None:
    """A link that listens, and one that sends to a port where nobody is."""
    links = (
        OutsideLink(name="tower", port=free_port(socket.SOCK_DGRAM)),
        OutsideLink(name="desk", kind="tcp_in", port=free_port()),
    )
    assert fly(tmp_path / "run", situation(*links)) == alone


def test_a_heard_station_arms_the_vehicle_beside_a_silent_one(tmp_path: Path, alone: list[Record]) -> None:
    """The permission is of one link: what came over it is recorded, and acted upon."""
    with ground_station() as trusted, ground_station() as watching:
        links = (
            OutsideLink(name="tower", port=trusted.port, heard=True),
            OutsideLink(name="van", port=watching.port),
        )
        records = fly(tmp_path / "run", situation(*links))
    assert "COMMAND_ACK" in trusted.kinds()
    assert "COMMAND_ACK" not in watching.kinds()
    new = events(records) - events(alone)
    assert new
    assert all("tower" in topic for topic in new)


def test_names_that_clash_are_refused_before_takeoff() -> None:
    """With the agent's link, with the operator's, with each other."""
    manifest = agent_manifest("idle").model_copy(update={"mavlink": (MavlinkNeed(name="mine"),)})
    spec = situation(
        OutsideLink(name="mine"), OutsideLink(name=OPERATOR_LINK, port=14551), OutsideLink(name="free")
    )
    texts = [str(fault) for fault in session_faults(spec, manifest)]
    assert len(texts) == 2
    assert "vehicle.outside_links[mine]: the agent has a link" in texts[0]
    assert f"vehicle.outside_links[{OPERATOR_LINK}]: the operator has a link" in texts[1]
    with pytest.raises(ValidationError, match="'tower' stands twice"):
        situation(OutsideLink(name="tower"), OutsideLink(name="tower", port=14551))
