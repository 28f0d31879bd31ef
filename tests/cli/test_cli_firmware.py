"""`rebar fly` and `rebar doctor` with a real autopilot's stand-in."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest
from firmware_files import install_firmware
from pymavlink.dialects.v20 import common

from bench.cli._machine import _firmware
from bench.errors import SetupError

pytestmark = [pytest.mark.process, pytest.mark.flight]


def test_the_doctor_starts_a_firmware_or_says_what_is_missing(tmp_path: Path) -> None:
    px4 = install_firmware(tmp_path / "px4", "px4")
    for place in (px4, px4 / "bin" / "px4"):
        assert _firmware(str(place)).startswith("PX4 1.2.3 (5tand1n), px4 sha256:")
    (px4 / "etc" / "init.d-posix" / "rcS").unlink()
    with pytest.raises(SetupError, match=r"etc/init\.d-posix/rcS does not exist"):
        _firmware(str(px4))
    program = install_firmware(tmp_path / "ardupilot", "ardupilot")
    program.chmod(0o644)
    with pytest.raises(SetupError, match="is not an executable file"):
        _firmware(str(program))


def test_a_client_outside_meets_the_real_autopilot(tmp_path: Path) -> None:
    """The autopilot is in a network of the command's own, the link is on the host's."""
    px4 = install_firmware(tmp_path / "px4", "px4")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        client.settimeout(60.0)
        link = f"udpout:127.0.0.1:{client.getsockname()[1]}"
        options = ["--firmware", str(px4), "--mavlink", link, "--duration", "2", "--speed", "20"]
        command = [sys.executable, "-m", "bench.cli", "fly", "--autopilot", "px4", *options]
        flown = subprocess.run(command, capture_output=True, text=True, check=False, timeout=200)
        assert flown.returncode == 0, flown.stderr
        assert flown.stdout.startswith("PX4 1.2.3 (5tand1n)")
        parser = common.MAVLink(None)
        kinds = {message.get_type() for message in parser.parse_buffer(bytearray(client.recv(65536)))}
    assert {"ATTITUDE", "GLOBAL_POSITION_INT"} <= kinds
