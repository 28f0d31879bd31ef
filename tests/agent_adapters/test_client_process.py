"""How a Python agent starts and ends: cheaply, because every session pays for it. And its half of the protocol."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from typing import Any

import pytest

from agent_adapters.client._protocol import End, Tick, ack_line, hello_line, read_line
from bench import contracts


def run(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=variables)


@pytest.mark.parametrize(("variables", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_numpy_keeps_to_one_thread_where_nobody_has_said_otherwise(
    variables: dict[str, str], threads: str
) -> None:
    """What the user has set stays."""
    code = "import os; from agent_adapters.client import use_one_thread; use_one_thread(); print(os.environ['OPENBLAS_NUM_THREADS'])"
    assert run(code, **variables).stdout.split() == [threads]


@pytest.mark.parametrize("code", [0, 3])
def test_a_process_ends_at_once_with_all_that_it_has_printed(code: int) -> None:
    """Both streams are complete; exit handlers do not run."""
    ended = run(
        "import atexit, sys; from agent_adapters.client import end_process; atexit.register(print, 'handler'); "
        f"sys.stdout.write('out'); sys.stderr.write('err'); end_process({code})"
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "out", "err")


# Documents are plain values to agents, and a lens that does not distort is asked without arrays.
OF_THE_BENCH = {
    *("bench.simspec._document", "bench.contracts._truth_documents", "bench.documents"),
    *("numpy", "pydantic", "pydantic_core", "yaml"),
}


@pytest.mark.parametrize("module", ["reference._agent", "null.__main__"])
def test_an_agent_does_not_import_what_only_the_bench_needs(module: str) -> None:
    """The SimSpec and the documents of the truth cost a fifth of a second in each session."""
    assert all(map(find_spec, OF_THE_BENCH))
    loaded = set(run(f"import sys, agent_adapters.{module}; print(*sys.modules)").stdout.split())
    assert f"agent_adapters.{module}" in loaded
    assert loaded & OF_THE_BENCH == set()


HEAVY = {
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
}
IMPORT = """
import json, sys, time
began_s = time.process_time()
import agent_adapters.client
print(json.dumps({"cpu_s": time.process_time() - began_s, "modules": sorted(sys.modules)}))
"""


def test_the_client_loads_little_and_costs_little_cpu() -> None:
    """No heavy package, of the bench only streams and modules of the floor, which import nothing of ours."""
    # The least of three, so that a busy host does not matter.
    runs = [json.loads(run(IMPORT).stdout) for _ in range(3)]
    assert {name.split(".")[0] for name in runs[0]["modules"]} & HEAVY == set()
    rooms = {name.split(".")[1] for name in runs[0]["modules"] if name.startswith("bench.")}
    assert rooms == {"clock", "errors", "lazy", "streams", "values"}
    assert min(each["cpu_s"] for each in runs) <= 0.3


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
