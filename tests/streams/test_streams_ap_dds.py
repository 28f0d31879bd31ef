"""The messages and services of ArduPilot's topics, compared with the hashes and encoders of others."""

from __future__ import annotations

import csv
import json
import struct
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from random import Random
from typing import Any

import pytest
import zenoh
from other_encoder import encoded, random_message, store_of

from bench.streams import (
    AP_FROM_AGENT,
    AP_SERVICES,
    AP_TO_AGENT,
    AirAccess,
    AirPlan,
    Service,
    ap_message,
    data_key,
    decode,
    encode,
    filled,
    open_router,
    service_parts,
    type_hash,
)

# Those of ardupilot_msgs and of services from a generator of its own; eight of the others are those of real installations.
with Path(__file__).with_name("ap_hashes.csv").open(encoding="utf-8") as _file:
    HASHES = {row["type"]: row["hash"] for row in csv.DictReader(_file)}
TOPIC_TYPES = sorted({*AP_TO_AGENT.values(), *AP_FROM_AGENT.values()})
PARTS = [part.TYPE for kind in sorted(set(AP_SERVICES.values())) for part in service_parts(ap_message(kind))]


def test_the_hashes_of_all_topics_and_services_are_those_of_ros() -> None:
    names = {*TOPIC_TYPES, *AP_SERVICES.values()}
    assert {name: type_hash(ap_message(name)) for name in names} == {
        name: f"RIHS01_{hashed}" for name, hashed in HASHES.items()
    }
    with pytest.raises(KeyError):
        ap_message("ardupilot_msgs/msg/Rc")


@pytest.mark.parametrize("type_name", [*TOPIC_TYPES, *PARTS])
def test_random_messages_are_encoded_as_rosbags_does(type_name: str) -> None:
    kind, random = ap_message(type_name), Random(7)
    store = store_of(kind)
    for _ in range(5):
        mine: Any = random_message(kind, random)
        assert encode(mine) == encoded(store, mine)
        assert decode(kind, encode(mine)) == mine
        assert filled(kind, asdict(mine)) == mine


def test_what_is_not_given_is_zero_and_no_value_is_shared() -> None:
    kind = ap_message("sensor_msgs/msg/NavSatFix")
    first, second = filled(kind, {"status": {"status": -1}}), filled(kind, {})
    assert (first.status.status, second.status.status, second.header.frame_id) == (-1, 0, "")
    assert first.status is not second.status
    assert second.position_covariance == (0.0,) * 9


# Services over Zenoh, asked by a program with Zenoh alone.

TAKEOFF = "/ap/experimental/takeoff"
KIND = ap_message("ardupilot_msgs/srv/Takeoff")
GID = bytes(range(16))


def request(height_m: float) -> bytes:
    return bytes((0, 1, 0, 0)) + struct.pack("<f", height_m)


class Caller:
    """A client of the service; `answers` are payload and attachment, in the order in which they came."""

    def __init__(self, access: AirAccess) -> None:
        config = zenoh.Config()
        for name, value in (
            ("mode", "client"),
            ("connect/endpoints", [access.locator]),
            ("transport/auth/usrpwd/user", access.user),
            ("transport/auth/usrpwd/password", access.password),
            ("transport/shared_memory/enabled", False),
        ):
            config.insert_json5(name, json.dumps(value))
        self.session = zenoh.open(config)
        self.answers: list[tuple[bytes, bytes]] = []
        self.ended = threading.Event()

    def call(self, key: str, data: bytes | None, attachment: bytes | None) -> None:
        def take(reply: zenoh.Reply) -> None:
            sample = reply.ok
            assert sample is not None
            assert sample.attachment is not None
            self.answers.append((sample.payload.to_bytes(), sample.attachment.to_bytes()))

        handler = zenoh.handlers.Callback(take, self.ended.set)
        self.session.get(
            key,
            handler,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            payload=data,
            attachment=attachment,
        )

    def ask(self, height_m: float, number: int) -> None:
        self.call(data_key(3, TAKEOFF, KIND), request(height_m), struct.pack("<qqB16s", number, 0, 16, GID))


@pytest.fixture
def served() -> Iterator[tuple[Service, Caller]]:
    plan = AirPlan(3, (), (), agent_calls=((TAKEOFF, KIND),), agent_limit_bytes=1000)
    with open_router(plan) as router:
        service = router.node("session").serve(TAKEOFF, KIND)
        caller = Caller(router.access)
        with caller.session:
            yield service, caller


def test_requests_are_answered_in_order_with_the_number_and_the_id_of_their_client(
    served: tuple[Service, Caller],
) -> None:
    """Numbers of a client may begin anywhere; a request that is not accepted has no answer."""
    service, caller = served
    for index, height_m in enumerate((5.0, 6.0, 7.0)):
        caller.ask(height_m, 41 + index)
        # One after the other, so that they come in this order.
        assert service.wait(index + 1, 30.0)
    samples = service.take()
    assert [(sample.sequence, sample.message().alt) for sample in samples] == [(1, 5.0), (2, 6.0), (3, 7.0)]
    response = service.response
    service.accept(1)
    service.accept(3)
    before_ns = time.time_ns()
    for status in (True, False):
        service.put_bytes(encode(response(status=status)))
    deadline_s = time.monotonic() + 30.0
    while len(caller.answers) < 2:
        assert time.monotonic() < deadline_s
        time.sleep(0.001)
    payloads = {struct.unpack("<qqB16s", attachment)[0]: data for data, attachment in caller.answers}
    assert payloads == {41: b"\0\1\0\0\1", 43: b"\0\1\0\0\0"}
    for _, attachment in caller.answers:
        _, stamp_ns, size, gid = struct.unpack("<qqB16s", attachment)
        assert (size, gid) == (16, GID)
        assert stamp_ns >= before_ns
    assert service.sequence == 2


@pytest.mark.parametrize(
    ("data", "attachment"), [(None, bytes(33)), (request(5.0), None), (request(5.0), b"x")]
)
def test_a_request_without_content_or_a_proper_attachment_is_counted_and_ends_at_once(
    data: bytes | None, attachment: bytes | None, served: tuple[Service, Caller]
) -> None:
    service, caller = served
    caller.call(data_key(3, TAKEOFF, KIND), data, attachment)
    assert caller.ended.wait(30.0)
    assert (caller.answers, service.malformed, service.received) == ([], 1, 0)


@pytest.mark.parametrize("pad", [900, 2000])
def test_a_service_beyond_the_plan_or_a_request_beyond_the_limit_reaches_nobody(
    pad: int, served: tuple[Service, Caller]
) -> None:
    """Another service of the same type is not asked, and of requests only those within the limit come."""
    service, caller = served
    attachment = struct.pack("<qqB16s", 1, 0, 16, GID)
    caller.call(data_key(3, "/ap/other", KIND), request(1.0), attachment)
    assert caller.ended.wait(30.0)
    caller.call(data_key(3, TAKEOFF, KIND), request(2.0) + bytes(pad), attachment)
    caller.ask(3.0, 2)
    assert service.wait(2 if pad < 1000 else 1, 30.0)
    sizes = [len(sample.data) for sample in service.take()]
    assert sizes == ([908, 8] if pad < 1000 else [8])
    assert not caller.answers
