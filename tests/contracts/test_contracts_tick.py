"""The lockstep protocol's lines."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.contracts import Ack, End, Hello, SimTime, Tick, read_line, write_line


@pytest.mark.parametrize(
    "message",
    [
        Hello(agent="a", subscribes=("/clock",)),
        Hello(agent="a", interval_s=0.02),
        Tick(number=3, time_ns=300_000_000, topics={"/clock": 4}, links={"onboard": 17}),
        Ack(number=3, links={"onboard": 2}),
        End(reason="over"),
    ],
)
def test_lines_round_trip(message: Hello | Tick | Ack | End) -> None:
    assert read_line(write_line(message)) == message


@given(st.binary(max_size=300))
def test_noise_is_no_message(noise: bytes) -> None:
    read_line(noise)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{}",
        b'{"kind":"ack"}',
        b'{"kind":"ack","number":-1}',
        b'{"kind":"ack","number":1,"topics":{"a":"b"}}',
        b"[]",
        b"null",
    ],
)
def test_near_misses_are_none(line: bytes) -> None:
    assert read_line(line) is None


def test_simulated_time_counts_nanoseconds() -> None:
    """A tenth of a second added ten times is one second, exactly."""
    time = SimTime(0)
    for _ in range(10):
        time = time.after(0.1)
    assert time == SimTime(1_000_000_000)
    assert time.since(SimTime(500_000_000)) == 0.5
