"""Parameters kept in a file between one flight and the next."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from ports import free_port
from vehicle_client import mavlink, of

from bench.contracts import LinkSpec
from bench.errors import SetupError
from bench.simulation import StandalonePlan, run_standalone
from bench.simulation._parameter_file import ParameterFile


def fly_and_set(file: Path, *messages: bytes) -> list[bytes]:
    """Fly shortly while a client sends something; returns what it received."""
    port = free_port(socket.SOCK_DGRAM)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        client.connect(("127.0.0.1", port))
        link = LinkSpec("onboard", "udp_in", port=port, streams="none")
        client.setblocking(False)

        def say(line: str) -> None:
            for message in messages:
                client.send(message)

        plan = StandalonePlan("px4", [link], speed=100.0, duration_s=2.5, parameter_file=file)
        run_standalone(plan, say)
        datagrams = []
        while True:
            try:
                datagrams.append(client.recv(65535))
            except BlockingIOError:
                return datagrams


def test_set_parameters_survive_a_restart(tmp_path: Path) -> None:
    """A client's PARAM_SET is in the file after the flight, alone; the next flight begins with it."""
    file = tmp_path / "parameters.json"
    mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    fly_and_set(file, bytes(mavlink.MAVLink_param_set_message(1, 1, b"MIS_TAKEOFF_ALT", 7.5, 9).pack(mav)))
    assert ParameterFile(file).load() == {"MIS_TAKEOFF_ALT": 7.5}
    request = bytes(mavlink.MAVLink_param_request_read_message(1, 1, b"MIS_TAKEOFF_ALT", -1).pack(mav))
    messages = [
        message
        for data in fly_and_set(file, request)
        for message in mavlink.MAVLink(None).parse_buffer(data) or []
    ]
    assert [message.param_value for message in of("PARAM_VALUE", messages)] == [7.5]


@pytest.mark.parametrize("text", ["no json", "[1, 2]", '{"MIS_TAKEOFF_ALT": "high"}', '{"NO_SUCH": 1}'])
def test_a_bad_file_is_refused(tmp_path: Path, text: str) -> None:
    """Before anything flies, and the file stays as it was."""
    file = tmp_path / "parameters.json"
    file.write_text(text)
    with pytest.raises(SetupError):
        run_standalone(StandalonePlan(duration_s=0.1, parameter_file=file))
    assert file.read_text() == text
