"""The client is light: what a fresh interpreter loads for it, and how much CPU that takes.

And its half of the protocol.
"""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from typing import Any

import pytest

from agent_adapters.client._protocol import End, Tick, ack_line, hello_line, read_line
from bench import contracts

MAX_CPU_S = 0.3
HEAVY = (
    "jsbsim",
    "ortools",
    "statsmodels",
    "scipy",
    "pydantic",
    "numpy",
    "yaml",
    "networkx",
    "polars",
    "pandas",
)

IMPORT = """
import json, sys, time
began_s = time.process_time()
import agent_adapters.client
print(json.dumps({"cpu_s": time.process_time() - began_s, "modules": sorted(sys.modules)}))
"""


@cache
def imported() -> tuple[float, tuple[str, ...]]:
    """CPU seconds of the import, the least of three so that a busy host does not matter, and the modules that
    it loads.
    """
    runs = [
        json.loads(subprocess.run([sys.executable, "-c", IMPORT], check=True, capture_output=True).stdout)
        for _ in range(3)
    ]
    return min(run["cpu_s"] for run in runs), tuple(runs[0]["modules"])


@pytest.mark.parametrize("package", HEAVY)
def test_the_client_loads_no_heavy_package(package: str) -> None:
    _, modules = imported()

    assert [name for name in modules if name.split(".")[0] == package] == []


def test_the_client_loads_no_room_of_the_bench_but_streams() -> None:
    _, modules = imported()

    rooms = {name.split(".")[1] for name in modules if name.startswith("bench.")}
    # Besides streams only modules of the floor, which import nothing of ours.
    assert rooms == {"clock", "errors", "lazy", "streams", "values"}


def test_importing_the_client_costs_little_cpu() -> None:
    cpu_s, _ = imported()

    assert cpu_s <= MAX_CPU_S


def test_the_reference_agent_starts_without_what_a_plain_flight_does_not_need() -> None:
    """Its documents are plain values, and a lens that does not distort is asked without arrays."""
    program = "import sys, agent_adapters.reference._agent; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    ).stdout.split()

    assert {"agent_adapters.reference.perception._camera", "agent_adapters.client.documents"} <= set(loaded)
    assert {"numpy", "pydantic", "pydantic_core", "yaml", "bench.documents"}.isdisjoint(loaded)


def test_both_halves_of_the_protocol_agree() -> None:
    tick = contracts.Tick(number=3, time_ns=300_000_000, topics={"/clock": 4, "/ü": 2}, links={"onboard": 9})
    end = contracts.End(reason="the session is over")

    assert read_line(contracts.write_line(tick)) == Tick(
        3, 300_000_000, {"/clock": 4, "/ü": 2}, {"onboard": 9}
    )
    assert read_line(contracts.write_line(end)) == End("the session is over")
    hello = contracts.Hello(agent="mine", subscribes=("/clock", "/ü"), secret="s")
    ack = contracts.Ack(number=3, topics={"/ü": 1}, links={"onboard": 2})
    assert hello_line("mine", ("/clock", "/ü"), "s") == contracts.write_line(hello)
    assert ack_line(3, {"/ü": 1}, {"onboard": 2}) == contracts.write_line(ack)


def test_both_halves_agree_on_lines_with_the_air_network() -> None:
    """Objects and texts, and how often ticks are wanted."""
    air: list[dict[str, Any]] = [
        {"topic": "/ü", "message": {"b": 1, "a": [None, 0.5]}},
        {"topic": "/clock", "message": {}},
    ]
    texts = [{"topic": "/ü", "message": 'no "JSON"\n\u0000'}, air[0]]
    messages = [contracts.AirMessage.model_validate(message) for message in air]
    tick = contracts.Tick(number=3, time_ns=5, air=tuple(messages))
    assert read_line(contracts.write_line(tick)) == Tick(3, 5, {}, {}, tuple(air))
    ack = contracts.Ack(number=3, air=tuple(map(contracts.AirMessage.model_validate, texts)))
    assert contracts.read_line(ack_line(3, {}, {}, texts)) == ack
    hello = contracts.Hello(agent="mine", secret="s", interval_s=0.02)
    assert hello_line("mine", (), "s", 0.02) == contracts.write_line(hello)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"[]",
        b'{"kind":"tick"}',
        b'{"kind":"tick","number":-1,"time_ns":0}',
        b'{"kind":"tick","number":1,"time_ns":9007199254740992}',
        b'{"kind":"tick","number":1,"time_ns":0,"topics":[]}',
        b'{"kind":"tick","number":1,"time_ns":0,"links":{"onboard":-1}}',
        b'{"kind":"tick","number":1,"time_ns":0,"colour":"red"}',
        b'{"kind":"tick","number":1.5,"time_ns":0}',
        b'{"kind":"tick","number":1,"time_ns":0,"air":{}}',
        b'{"kind":"tick","number":1,"time_ns":0,"air":[{"topic":1,"message":{}}]}',
        b'{"kind":"tick","number":1,"time_ns":0,"air":[{"topic":"/clock"}]}',
        b'{"kind":"end","reason":5}',
        b'{"kind":"end","because":"x"}',
        b'{"kind":["end"]}',
        b"\xff\xfe",
        b"[" * 30_000,
    ],
)
def test_both_halves_refuse_the_same_lines(line: bytes) -> None:
    assert read_line(line) is None
    assert contracts.read_line(line) is None
