"""A real mosquitto with TLS and accounts, and certificates for it."""

from __future__ import annotations

import datetime as dt
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from embedded_broker import until
from ports import free_port

from agent_adapters.mqtt._broker import PROGRAM_PLACES, Account, _write_passwords

PROGRAM = shutil.which("mosquitto", path=os.pathsep.join((os.environ["PATH"], PROGRAM_PLACES)))
needs_mosquitto = pytest.mark.skipif(PROGRAM is None, reason="mosquitto is not installed")


def certificate(folder: Path, name: str) -> tuple[Path, Path]:
    """A self-signed certificate for localhost and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = dt.datetime.now(dt.UTC)
    signed = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + dt.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("localhost")]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    paths = folder / f"{name}.pem", folder / f"{name}.key"
    paths[0].write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    unencrypted = serialization.NoEncryption()
    paths[1].write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, unencrypted)
    )
    return paths


class Mosquitto:
    """A mosquitto that forgets everything when it stops."""

    def __init__(self, configuration: Path, port: int) -> None:
        self._configuration, self.port = configuration, port
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Return once it listens."""
        assert PROGRAM is not None
        self._process = subprocess.Popen([PROGRAM, "-c", str(self._configuration)], stderr=subprocess.DEVNULL)
        until(self._listens)

    def stop(self) -> None:
        """Return once it is gone."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _listens(self) -> bool:
        try:
            socket.create_connection(("localhost", self.port), 1.0).close()
        except OSError:
            return False
        return True


@contextmanager
def open_mosquitto(
    folder: Path, accounts: Mapping[str, str], authority: Path, key: Path
) -> Iterator[Mosquitto]:
    """Yield a mosquitto that listens on localhost by TLS, for these users and passwords alone."""
    _write_passwords(folder, [Account(user, password) for user, password in accounts.items()])
    port = free_port()
    lines = [
        f"listener {port} localhost",
        "allow_anonymous false",
        f"password_file {folder / 'mosquitto.passwords'}",
        f"certfile {authority}",
        f"keyfile {key}",
        "set_tcp_nodelay true",
        *(["user root"] if os.geteuid() == 0 else []),
    ]
    configuration = folder / "mosquitto.conf"
    configuration.write_text("\n".join(lines) + "\n")
    broker = Mosquitto(configuration, port)
    try:
        broker.start()
        yield broker
    finally:
        broker.stop()
