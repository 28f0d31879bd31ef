"""ArduPilot's log over MAVLink: blocks as they are recorded, acknowledged, asked for again, and read by DFReader."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from log_client import ARM, dataflash
from vehicle_client import Client, Make, of, simspec

from vehicle_models.controller.links._dialect import dialect as mavlink

ACCEPTED = 0
STOP, START = 2_147_483_645, 2_147_483_646
NACK, ACK = 0, 1
# Of the SITL's LOG_MAV_BUFSIZE, 8 KiB.
MAX_BLOCKS = 37


@dataclass
class Receiver:
    """Takes blocks, drops those that `lost` picks, and asks for gaps."""

    client: Client
    lost: Callable[[int], bool] = lambda count: False
    blocks: dict[int, bytes] = field(default_factory=dict)
    received: int = 0

    def status(self, number: int, status: int = ACK) -> None:
        self.client.send(mavlink.MAVLink_remote_log_block_status_message(1, 1, number, status))

    def fly(self, seconds: float) -> list[int]:
        """Let time pass, acknowledging every step; the numbers of the blocks that came."""
        numbers = []
        for _ in range(round(seconds * 50)):
            for m in self.client.fly(0.02):
                if m.get_type() != "REMOTE_LOG_DATA_BLOCK":
                    continue
                numbers.append(m.seqno)
                self.received += 1
                if self.lost(self.received):
                    # Half of the losses are noticed at once; the others by the vehicle's patience.
                    if self.received % 2:
                        self.status(m.seqno, NACK)
                    continue
                self.blocks[m.seqno] = bytes(m.data)
                self.status(m.seqno)
        return numbers

    def content(self) -> bytes:
        """The blocks in order, without a record that the last one cuts off."""
        assert sorted(self.blocks) == list(range(len(self.blocks)))
        return b"".join(self.blocks[number] for number in range(len(self.blocks)))


def copter(make: Make, **parameters: float) -> Client:
    values = {"LOG_BACKEND_TYPE": 3.0, "LOG_DISARMED": 1.0, **parameters}
    client = make(simspec("ardupilot", vehicle={"parameters": values}), system=255)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    client.fly(0.1)
    return client


def whole_records(content: bytes, path: Path) -> dict[str, list[Any]]:
    """The log up to its last whole record: what a file ends with when the stream stops is a part of one."""
    lengths = {128: 89}
    place = 0
    while place + 3 <= len(content) and place + lengths[content[place + 2]] <= len(content):
        assert content[place : place + 2] == b"\xa3\x95"
        if content[place + 2] == 128:
            lengths[content[place + 3]] = content[place + 4]
        place += lengths[content[place + 2]]
    return dataflash(content[:place], path)


def test_a_receiver_with_losses_reassembles_a_log_that_dfreader_reads(make: Make, tmp_path: Path) -> None:
    client = copter(make)
    receiver = Receiver(client, lambda count: count % 7 in (3, 4))
    receiver.status(START)
    receiver.fly(3.0)
    client.put(WPNAV_SPEED=700)
    numbers = receiver.fly(38.0)
    assert len(numbers) > len(set(numbers)) > 100
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    receiver.fly(2.0)
    client.command(ARM, 1)
    receiver.fly(3.0)
    receiver.status(STOP)
    receiver.lost = lambda count: False
    assert not receiver.fly(1.0)
    # A block that was lost last never comes.
    gap = next(number for number in range(len(receiver.blocks) + 1) if number not in receiver.blocks)
    receiver.blocks = {number: data for number, data in receiver.blocks.items() if number < gap}
    log = whole_records(receiver.content(), tmp_path / "remote.bin")
    assert len({row.Name for row in log["PARM"]}) == 1397
    assert [row.Value for row in log["PARM"] if row.Name == "WPNAV_SPEED"][-1] == 700.0
    times_s = [row.TimeUS * 1e-6 for row in log["ATT"]]
    assert all(0.09 < after - before < 0.11 for before, after in itertools.pairwise(times_s))
    assert times_s[-1] - times_s[0] > 35.0
    assert [row.ModeNum for row in log["MODE"]] == [0, 4]


def test_a_block_comes_again_until_it_is_acknowledged(make: Make) -> None:
    """All blocks are in use after 37; whoever is silent gets them again, and loses what is recorded meanwhile."""
    client = copter(make)
    receiver = Receiver(client, lambda count: False)
    receiver.status(START)
    numbers = [m.seqno for m in of("REMOTE_LOG_DATA_BLOCK", client.fly(0.06))]
    assert numbers == list(range(27))
    later = [m.seqno for m in of("REMOTE_LOG_DATA_BLOCK", client.fly(2.0))]
    assert set(later) == set(range(MAX_BLOCKS))
    assert later.count(0) > 5
    # An acknowledgement makes room for one, a NACK sends its block at once; neither takes an unknown number.
    for number, status in ((5, ACK), (5, ACK), (5000, ACK), (5000, NACK), (5, NACK)):
        receiver.status(number, status)
    assert 5 not in (again := [m.seqno for m in of("REMOTE_LOG_DATA_BLOCK", client.fly(0.3))])
    assert max(again) == MAX_BLOCKS
    receiver.status(6, NACK)
    assert next(m.seqno for m in of("REMOTE_LOG_DATA_BLOCK", client.fly(0.02))) == 6


@pytest.mark.parametrize(("buffer_kib", "blocks"), [(1.0, 8), (4.0, 18)])
def test_the_buffer_bounds_what_waits(make: Make, buffer_kib: float, blocks: int) -> None:
    client = copter(make, LOG_MAV_BUFSIZE=buffer_kib)
    Receiver(client).status(START)
    numbers = {m.seqno for m in of("REMOTE_LOG_DATA_BLOCK", client.fly(2.0))}
    assert numbers == set(range(blocks))


def test_a_silent_receiver_is_given_up_and_may_begin_anew(make: Make) -> None:
    client = copter(make)
    receiver = Receiver(client)
    receiver.status(START)
    assert receiver.fly(1.0)
    client.fly(11.0)
    assert not of("REMOTE_LOG_DATA_BLOCK", client.fly(5.0))
    receiver.status(START)
    again = Receiver(client)
    assert again.fly(0.1)[0] == 0
    # A second start changes nothing.
    again.status(START)
    assert again.fly(0.1)[0] > 0
    assert again.blocks[0][:3] == b"\xa3\x95\x80"


@pytest.mark.parametrize("backend", [0.0, 1.0, 4.0])
def test_without_the_backend_nothing_is_sent(make: Make, backend: float) -> None:
    client = copter(make, LOG_BACKEND_TYPE=backend)
    receiver = Receiver(client)
    receiver.status(START)
    assert not receiver.fly(1.0)
    receiver.status(5)
    receiver.status(5, NACK)
    receiver.status(STOP)
    assert not receiver.fly(1.0)


def test_a_disarmed_copter_sends_the_head_alone(make: Make, tmp_path: Path) -> None:
    """With LOG_DISARMED 0 the records begin with arming, which sets home again; the head has home."""
    client = copter(make, LOG_DISARMED=0.0, LOG_BACKEND_TYPE=2.0)
    receiver = Receiver(client)
    receiver.status(START)
    receiver.fly(25.0)
    head = len(receiver.blocks)
    assert "ATT" not in whole_records(receiver.content(), tmp_path / "head.bin")
    assert client.command(ARM, 1) == [ACCEPTED]
    receiver.fly(4.0)
    assert len(receiver.blocks) > head
    log = whole_records(receiver.content(), tmp_path / "armed.bin")
    assert 30 < len(log["ATT"]) <= 41
    assert [row.Id for row in log["EV"]][:3] == [25, 25, 10]
