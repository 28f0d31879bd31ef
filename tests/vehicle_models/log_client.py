"""A client of flight logs: it lists, fetches and reads them, and drops messages on the way."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from pymavlink.DFReader import DFReader_binary
from pyulog.core import ULog
from vehicle_client import NAN, Client, mavlink, of, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
ACCEPTED, TEMPORARILY_REJECTED, UNSUPPORTED = 0, 1, 3
FORCE = 21196
FTP_HEAD = struct.Struct("<HBBBBBBI")


def listed(client: Client, start: int = 0, end: int = 0xFFFF) -> list[Any]:
    client.send(mavlink.MAVLink_log_request_list_message(1, 1, start, end))
    return of("LOG_ENTRY", client.fly(0.1))


@dataclass
class Download:
    """What a client of one log has; it drops every message that `lost` picks, and asks for the gaps again."""

    client: Client
    number: int
    size: int
    lost: Callable[[int], bool] = lambda count: False
    parts: dict[int, bytes] = field(default_factory=dict)
    received: int = 0

    def request(self, offset: int, count: int) -> None:
        self.client.send(mavlink.MAVLink_log_request_data_message(1, 1, self.number, offset, count))

    def take(self, messages: list[Any]) -> None:
        for m in messages:
            if m.get_type() == "LOG_DATA" and m.id == self.number:
                self.received += 1
                if not self.lost(self.received):
                    self.parts[m.ofs] = bytes(m.data[: m.count])

    def first_gap(self) -> tuple[int, int]:
        """Where the first gap begins and ends."""
        begin = 0
        while self.parts.get(begin):
            begin += len(self.parts[begin])
        return begin, min((place for place in self.parts if place > begin), default=self.size)

    def content(self) -> bytes:
        return b"".join(part for _, part in sorted(self.parts.items()))


def downloaded(
    client: Client, entry: Any, lost: Callable[[int], bool] = lambda count: False, limit: int = 200
) -> bytes:
    """A whole log, asked for again gap by gap until there is none."""
    transfer = Download(client, entry.id, entry.size, lost)
    transfer.request(0, 0xFFFFFFFF)
    transfer.take(client.fly(entry.size / 90 / 40 * 0.02 + 0.04))
    for _ in range(limit):
        begin, end = transfer.first_gap()
        if begin >= entry.size:
            break
        transfer.request(begin, end - begin)
        transfer.take(client.fly((end - begin) / 90 / 40 * 0.02 + 0.04))
    assert len(transfer.content()) == entry.size
    return transfer.content()


def ulog(content: bytes) -> ULog:
    return ULog(io.BytesIO(content))


def dataflash(content: bytes, path: Path) -> dict[str, list[Any]]:
    """Messages by name."""
    path.write_bytes(content)
    reader = DFReader_binary(str(path))
    messages: dict[str, list[Any]] = {}
    while (message := reader.recv_msg()) is not None:
        messages.setdefault(message.get_type(), []).append(message)
    assert "BAD_DATA" not in messages
    reader.data_map.close()
    reader.filehandle.close()
    return messages


@dataclass
class FlownLogs:
    """A PX4 that has flown, then stood armed once more; its two logs as a client received them."""

    client: Client
    entries: list[Any]
    contents: list[bytes]


def fly_twice(client: Client) -> None:
    client.fly(4.0)
    assert client.command(ARM, 1) == [ACCEPTED]
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, NAN) == [ACCEPTED]
    client.fly(7.0)
    client.put(MPC_XY_CRUISE=3.5, NAV_ACC_RAD=4.25)
    client.fly(1.0)
    assert client.command(mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, NAN, NAN, NAN) == [ACCEPTED]
    client.fly(9.0)
    assert not client.vehicle.condition().armed
    assert client.command(ARM, 1) == [ACCEPTED]
    client.fly(2.0)
    assert client.command(ARM, 0) == [ACCEPTED]
    client.fly(1.0)


@pytest.fixture
def two_links() -> Iterator[Callable[..., tuple[Client, Client]]]:
    """Two clients of one vehicle, each on a link of its own. The second only listens while the first flies."""
    with ExitStack() as stack:

        def build(autopilot: str, **changes: Any) -> tuple[Client, Client]:
            first, second = Client(), Client(244)
            links = []
            for number, client in enumerate((first, second)):
                stack.callback(client.socket.close)
                links.append(LinkSpec(f"link{number}", "udp_out", port=client.port, streams="none"))
            first.vehicle = second.vehicle = stack.enter_context(
                open_x500(VehiclePlan(simspec(autopilot, **changes), tuple(links)))
            )
            first.fly(1.1)
            second._listen()
            return first, second

        yield build
