"""Links that lead out of the session: whoever looks on sees the vehicle, and changes nothing; and an agent on another
computer, by serial devices and by Zenoh at an interface with a token.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from fake_agents import agent_manifest
from ports import free_port
from pydantic import ValidationError
from pymavlink.dialects.v20 import common
from serial_cable import Cable
from test_session import run, session_simspec

from bench.contracts import (
    CLOCK,
    OPERATOR_LINK,
    AgentManifest,
    AgentStatus,
    MavlinkNeed,
    Outcome,
    Record,
    SessionResult,
    StepTiming,
    VehicleTopics,
    document_text,
)
from bench.errors import LinkLost
from bench.simspec import AgentSpec, Mission, OutsideAir, OutsideLink, Pace, SimSpec, VehicleSpec
from bench.simulation import HostClock, session_faults
from bench.simulation._air_topics import DOMAIN
from bench.simulation._outside_links import outside_links
from bench.streams import AirAccess, Clock, String, open_client


def kinds(chunks: Iterable[bytes]) -> set[str]:
    """Names of the messages that came."""
    parser = common.MAVLink(None)
    parser.robust_parsing = True
    return {message.get_type() for message in parser.parse_buffer(b"".join(chunks)) or ()}


def order_to_arm(system: int) -> bytes:
    mav = common.MAVLink(None, srcSystem=system, srcComponent=190)
    return bytes(mav.command_long_encode(1, 1, 400, 0, 1, 21196, 0, 0, 0, 0, 0).pack(mav))


@dataclass
class GroundStation:
    """Listens on a UDP port of its own and answers each datagram with a command to arm."""

    sock: socket.socket
    datagrams: list[bytes] = field(default_factory=list)

    @property
    def port(self) -> int:
        return int(self.sock.getsockname()[1])

    def serve(self) -> None:
        while True:
            data, sender = self.sock.recvfrom(65536)
            if sender == self.sock.getsockname():
                return
            self.datagrams.append(data)
            self.sock.sendto(order_to_arm(255), sender)


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
    end, records = run(folder, agent_manifest("idle"), spec)
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    return records


def topics(records: list[Record]) -> set[str]:
    return {record.topic for record in records}


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    """What is recorded with no link to outside."""
    return fly(tmp_path_factory.mktemp("alone"), situation())


def test_two_who_look_on_see_the_vehicle_and_change_no_record(tmp_path: Path, alone: list[Record]) -> None:
    """Both stations ask to arm the whole time; the recording is that of a session without them."""
    with ground_station() as first, ground_station() as second:
        links = (
            OutsideLink(name="tower", port=first.port),
            OutsideLink(name="van", port=second.port, streams="onboard"),
        )
        watched = fly(tmp_path, situation(*links))
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT", "SYS_STATUS"} <= kinds(first.datagrams)
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT"} <= kinds(second.datagrams)
    assert watched == alone
    assert not any("tower" in topic or "van" in topic for topic in topics(watched))


def test_nobody_there_gives_the_same_records(tmp_path: Path, alone: list[Record]) -> None:
    """A link that listens, and one that sends to a port where nobody is."""
    links = (
        OutsideLink(name="tower", port=free_port(socket.SOCK_DGRAM)),
        OutsideLink(name="desk", kind="tcp_in", port=free_port()),
    )
    assert fly(tmp_path, situation(*links)) == alone


def test_a_heard_station_arms_the_vehicle_beside_a_silent_one(tmp_path: Path, alone: list[Record]) -> None:
    """The permission is of one link: what came over it is recorded, and acted upon."""
    with ground_station() as trusted, ground_station() as watching:
        links = (
            OutsideLink(name="tower", port=trusted.port, heard=True),
            OutsideLink(name="van", port=watching.port),
        )
        records = fly(tmp_path, situation(*links))
    assert "COMMAND_ACK" in kinds(trusted.datagrams)
    assert "COMMAND_ACK" not in kinds(watching.datagrams)
    new = topics(records) - topics(alone)
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


TOKEN = "a-token-of-24-characters"
ELSEWHERE = AgentManifest(
    name="elsewhere",
    command=("{python}", "-c", "import time; time.sleep(600)"),
    pace=("realtime", "lockstep"),
)


@contextmanager
def arming(cable: Cable) -> Iterator[list[bytes]]:
    """A companion that answers whatever comes over its cable with a command to arm."""
    over, received = threading.Event(), list[bytes]()

    def serve() -> None:
        while not over.wait(0.001):
            if data := cable.read():
                received.append(data)
                cable.write(order_to_arm(245))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield received
    finally:
        over.set()
        thread.join()


def test_a_companion_on_a_serial_device_flies_and_one_that_is_not_heard_does_not(tmp_path: Path) -> None:
    """Each with a device of its own; the recording has what went over the heard one."""
    now_s = 0.0

    def sleep(span_s: float) -> None:
        nonlocal now_s
        now_s += span_s
        # The companions' threads get their turn in each step.
        threading.Event().wait(0.002)

    with (
        closing(Cable(tmp_path / "ttyUSB0")) as telemetry,
        closing(Cable(tmp_path / "ttyUSB1")) as watching,
        arming(telemetry) as from_companion,
        arming(watching) as from_watcher,
    ):
        links = (
            OutsideLink(name="companion", kind="serial", device=str(telemetry.path), heard=True),
            OutsideLink(name="desk", kind="serial", device=str(watching.path), baud=57600),
        )
        spec = session_simspec(
            vehicle=VehicleSpec(model="x500", outside_links=links),
            mission=Mission(time_limit_s=4.0),
            pace=Pace(mode="realtime"),
        )
        assert session_faults(spec, ELSEWHERE) == []
        end, records = run(tmp_path, ELSEWHERE, spec, HostClock(lambda: now_s, sleep))
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    timing = end.fact(StepTiming)
    assert timing is not None
    assert timing.late == 0
    assert "COMMAND_ACK" in kinds(from_companion)
    assert "HEARTBEAT" in kinds(from_watcher)
    assert "COMMAND_ACK" not in kinds(from_watcher)
    assert any("companion" in topic for topic in topics(records))
    assert not any("desk" in topic for topic in topics(records))
    assert end.counters["serial_resets"] == 0


def air(folder: Path, text: str = TOKEN, mode: int = 0o600, interface: str = "lo") -> OutsideAir:
    path = folder / "token"
    path.touch(mode=0o600)
    path.chmod(0o600)
    path.write_text(f"{text}\n")
    path.chmod(mode)
    return OutsideAir(interface=interface, port=free_port(), token_file=str(path))


def elsewhere(outside: OutsideAir, mode: str = "realtime") -> SimSpec:
    return session_simspec(
        agent=AgentSpec(manifest="elsewhere", outside_air=outside),
        pace=Pace.model_validate({"mode": mode, "max_late_share": 1.0}),
        mission=Mission(time_limit_s=600.0),
    )


def test_an_agent_elsewhere_ends_its_mission_over_zenoh_and_a_stranger_does_not(tmp_path: Path) -> None:
    outside = air(tmp_path)
    spec = elsewhere(outside)
    assert session_faults(spec, ELSEWHERE) == []
    ends: list[tuple[SessionResult, list[Record]]] = []
    session = threading.Thread(target=lambda: ends.append(run(tmp_path, ELSEWHERE, spec)))
    session.start()
    locator = f"tcp/127.0.0.1:{outside.port}"
    status_topic = VehicleTopics(spec.vehicle.name).status
    with open_client(AirAccess(locator, "companion", TOKEN, DOMAIN), "far", timeout_s=60.0) as client:
        with (
            pytest.raises(LinkLost, match="refused user"),
            open_client(AirAccess(locator, "companion", TOKEN[::-1], DOMAIN), "stranger", timeout_s=0.4),
        ):
            pass
        clock = client.subscribe(CLOCK, Clock)
        assert clock.wait(1, 60.0)
        status = client.publisher(status_topic, String)
        while session.is_alive():
            status.put(String(document_text(AgentStatus(time_s=1.0, phase="complete"))))
            session.join(0.05)
    end, records = ends[0]
    assert end.outcome is Outcome.COMPLETED, end.reason
    assert status_topic in topics(records)
    assert TOKEN.encode() not in b"".join(record.data for record in records)
    assert TOKEN not in spec.model_dump_json()


def test_what_is_wrong_outside_is_told_before_takeoff(tmp_path: Path) -> None:
    def text(outside: OutsideAir, mode: str = "realtime") -> str:
        return " ".join(str(fault) for fault in session_faults(elsewhere(outside, mode), ELSEWHERE))

    assert "keeps real time, and the pace is lockstep" in text(air(tmp_path), "lockstep")
    assert "others on this host may read" in text(air(tmp_path, mode=0o640))
    assert "holds no token of 16 to 256" in text(air(tmp_path, "short"))
    assert "holds no token of 16 to 256" in text(air(tmp_path, "with a blank and a : colon"))
    gone = air(tmp_path).model_copy(update={"token_file": str(tmp_path / "none")})
    assert "none: there is no such file" in text(gone)
    assert "no interface 'eth77'" in text(air(tmp_path, interface="eth77"))
    missing = (OutsideLink(name="a", kind="serial", device=str(tmp_path / "ttyUSB9")),)
    spec = session_simspec(vehicle=VehicleSpec(model="x500", outside_links=missing))
    assert session_faults(spec, ELSEWHERE) == []
    with closing(Cable(tmp_path / "ttyUSB0")):
        end, _ = run(tmp_path, ELSEWHERE, spec)
    assert end.outcome is Outcome.SETUP_INVALID
    assert "there is no device" in end.reason


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"kind": "serial"}, "kind serial needs a device"),
        ({"kind": "udp_in", "device": "/dev/ttyUSB0"}, "kind serial needs a device"),
        ({"kind": "udp_out", "interface": "eth0"}, "udp_out does not listen"),
    ],
)
def test_fields_of_a_link_fit_its_kind(fields: dict[str, str], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        OutsideLink.model_validate({"name": "a", **fields})


def test_a_link_listens_at_an_interface() -> None:
    links = tuple(OutsideLink(name=name, kind="tcp_in", interface="lo") for name in ("a", "b"))
    spec = session_simspec(vehicle=VehicleSpec(model="x500", outside_links=links))
    assert [link.host for link in outside_links(spec)] == ["127.0.0.1", "127.0.0.1"]
