"""What a companion has that knows nothing of the bench: Zenoh, `struct`, ROS 2's attachments, the lines of the tick socket."""

from __future__ import annotations

import json
import os
import socket
import struct
import threading
from collections.abc import Iterator
from typing import Any

import zenoh

DOMAIN = os.environ["ROS_DOMAIN_ID"]
HEADER, GID = bytes((0, 1, 0, 0)), bytes(range(16))


class ZenohCompanion:
    """`came` are the samples of each topic that it listens to, or answers of each service; `sent` are numbers of samples."""

    services: tuple[str, ...] = ()

    def __init__(self) -> None:
        config = zenoh.Config()
        for name, value in (
            ("mode", "client"),
            ("connect/endpoints", [os.environ["REBAR_ZENOH"]]),
            ("transport/auth/usrpwd/user", os.environ["REBAR_ZENOH_USER"]),
            ("transport/auth/usrpwd/password", os.environ["REBAR_ZENOH_PASSWORD"]),
            ("transport/shared_memory/enabled", False),
        ):
            config.insert_json5(name, json.dumps(value))
        self.session = zenoh.open(config)
        self.arrival = threading.Condition()
        self.came: dict[str, list[bytes]] = {service: [] for service in self.services}
        self.sent: dict[str, int] = {}
        self.publishers: dict[str, Any] = {}
        self.subscribers: list[Any] = []

    def subscribe(self, topic: str, key: str) -> None:
        self.came[topic] = []
        self.subscribers.append(self.session.declare_subscriber(key, self.hearer(topic)))

    def hearer(self, topic: str) -> Any:
        def hear(sample: zenoh.Sample) -> None:
            attachment = sample.attachment
            assert attachment is not None
            number, _, size, gid = struct.unpack("<qqB16s", attachment.to_bytes())
            with self.arrival:
                self.came[topic].append(sample.payload.to_bytes())
                assert (number, size) == (len(self.came[topic]), 16)
                # Of an answer both are those of the request.
                assert topic not in self.services or gid == GID
                self.arrival.notify_all()

        return hear

    def wait(self, counts: dict[str, int]) -> None:
        """Until everything that a tick states has come."""

        def complete() -> bool:
            return all(len(self.came[topic]) >= count for topic, count in counts.items())

        with self.arrival:
            assert self.arrival.wait_for(complete, 60.0)

    def attachment(self, topic: str) -> bytes:
        self.sent[topic] = self.sent.get(topic, 0) + 1
        return struct.pack("<qqB16s", self.sent[topic], 0, 16, GID)

    def put(self, topic: str, key: str, data: bytes) -> None:
        if topic not in self.publishers:
            self.publishers[topic] = self.session.declare_publisher(key)
        self.publishers[topic].put(HEADER + data, attachment=self.attachment(topic))

    def fly(self, flight: Iterator[None]) -> None:
        """Go on with a flight at each tick, until either ends."""
        host, port = os.environ["REBAR_TICK"].split(":")
        line = socket.create_connection((host, int(port))).makefile("rw", encoding="utf-8")
        hello = {"kind": "hello", "protocol": 1, "agent": "companion", "subscribes": list(self.came)}
        print(json.dumps({**hello, "secret": os.environ["REBAR_TICK_SECRET"]}), file=line, flush=True)
        for text in line:
            message = json.loads(text)
            if message["kind"] == "end":
                break
            self.wait(message["topics"])
            try:
                next(flight)
            except StopIteration:
                break
            ack = {"kind": "ack", "number": message["number"], "topics": self.sent, "links": {}}
            print(json.dumps(ack), file=line, flush=True)
        self.session.close()  # type: ignore[no-untyped-call]
