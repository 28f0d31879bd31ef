"""No two sessions get one UDP port, and a port that was reserved leaves nothing behind."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from bench.errors import SetupError
from bench.simulation import _ports
from bench.simulation._ports import reserved_udp_port

HOLD = """
import sys
from bench.simulation import _ports
_ports.PORTS = range(int(sys.argv[1]), int(sys.argv[1]) + 1)
with _ports.reserved_udp_port():
    print("held", flush=True)
    sys.stdin.read()
"""


def test_two_at_once_differ_and_the_first_is_free_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with reserved_udp_port() as one:
        with reserved_udp_port() as two:
            assert one != two
        # The agent binds it: nothing else may hold the port itself.
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as agent:
            agent.bind(("127.0.0.1", one))
    monkeypatch.setattr(_ports, "PORTS", range(one, one + 1))
    with reserved_udp_port() as again:
        assert again == one
    assert os.listdir(tmp_path) == []


def test_another_process_keeps_its_port_until_it_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    with reserved_udp_port() as port:
        pass
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    monkeypatch.setattr(_ports, "PORTS", range(port, port + 1))
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(SetupError, match="no UDP port"), reserved_udp_port():
            pass
    finally:
        holder.kill()
        holder.communicate()
    with reserved_udp_port() as again:
        assert again == port


def test_a_port_that_a_program_has_bound_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.bind(("127.0.0.1", 0))
        taken = program.getsockname()[1]
        monkeypatch.setattr(_ports, "PORTS", range(taken, taken + 1))
        with pytest.raises(SetupError, match="no UDP port"), reserved_udp_port():
            pass
