"""The broker that a bridge and its agent meet on: one of their own inside the session, or one that is let in."""

from __future__ import annotations

import base64
import hashlib
import os
import secrets
import shutil
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

from bench.brokers import BrokerOptions, parse_broker_url
from bench.documents import read_text
from bench.errors import Fault, LinkLost, SetupError

OWN_BROKER = "mosquitto"
BRIDGE_USER, AGENT_USER = "bridge", "agent"
# Debian keeps mosquitto where only root's search path looks.
PROGRAM_PLACES = "/usr/sbin:/usr/local/sbin:/sbin"
_OPTIONS = BrokerOptions(
    "--broker",
    "--ca",
    "service:NAME, mqtt://HOST or mqtts://USER@HOST:8883/PREFIX",
    "give a file: --password-file",
)
# Host seconds in which a broker of one's own listens: it takes 0.01 s on a quiet machine.
START_S = 10.0
# Between looking for a free port and binding it, another process may take it.
_ATTEMPTS = 3
# The default of mosquitto_passwd. The passwords are random, so more would protect nothing.
_HASH_ROUNDS = 101


@dataclass(frozen=True, slots=True)
class Account:
    """Who somebody is to the broker; without a user, nobody."""

    user: str = ""
    password: str = field(default="", repr=False)


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """Where the broker is, the prefix of all topics, and the accounts of the bridge and of its agent."""

    host: str
    port: int
    prefix: str
    bridge: Account
    agent: Account
    tls: ssl.SSLContext | None = field(default=None, repr=False)
    authority: Path | None = None

    @property
    def agent_url(self) -> str:
        """What the agent finds in REBAR_MQTT; the password is in REBAR_MQTT_PASSWORD."""
        user = f"{quote(self.agent.user, safe='')}@" if self.agent.user else ""
        scheme = "mqtts" if self.tls else "mqtt"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{scheme}://{user}{host}:{self.port}/{self.prefix}"


def broker_address(
    url: str,
    account_file: Path | None,
    authority: Path | None,
    variables: Mapping[str, str],
) -> BrokerAddress:
    """The broker of `mqtt[s]://[USER@]HOST[:PORT][/PREFIX]` or `service:NAME[/PREFIX]`.

    The account file has the password in its first line. Without a prefix it is one that no other session has. Raises
    SetupError for anything else, a password in the address included.
    """
    if url.startswith("service:"):
        url = _service_url(url, variables)
    parts = parse_broker_url(url, authority, _OPTIONS)
    password = _read_password(account_file) if account_file is not None else ""
    account = Account(parts.user, password)
    prefix = parts.prefix or f"rebar/{secrets.token_hex(8)}"
    return BrokerAddress(parts.host, parts.port, prefix, account, account, parts.tls, authority)


def _service_url(url: str, variables: Mapping[str, str]) -> str:
    name, _, prefix = url.removeprefix("service:").partition("/")
    user, _, name = name.rpartition("@")
    variable = f"REBAR_SERVICE_{name.upper().replace('-', '_')}"
    if not variables.get(variable):
        remedy = f"let it in: agent.services: [{{name: {name}, host: ..., port: 1883}}]"
        raise SetupError("--broker", f"the SimSpec lets no service {name!r} in", remedy)
    return f"mqtt://{user}{'@' if user else ''}{variables[variable]}/{prefix}"


def _read_password(path: Path) -> str:
    try:
        return read_text(path).split("\n", 1)[0]
    except SetupError as error:
        remedy = "write the password into its first line, and name the file under `read` of the manifest"
        raise SetupError([Fault(fault.where, fault.what, remedy) for fault in error.faults]) from None


@contextmanager
def open_own_broker(folder: Path, port: int = 0, places: str = PROGRAM_PLACES) -> Iterator[BrokerAddress]:
    """Start mosquitto on the session's loopback, for this bridge and its agent alone; leaving the block ends it.

    `port` 0 takes a free one; `places` are searched after PATH. Raises SetupError where the program is missing, LinkLost where it does not start.
    """
    search = os.pathsep.join((os.environ.get("PATH", os.defpath), places))
    program = shutil.which(OWN_BROKER, path=search)
    if program is None:
        remedy = "install it (Debian: mosquitto), or let a broker in and name it: --broker service:NAME"
        raise SetupError("broker", f"there is no program {OWN_BROKER!r} for one of the agent's own", remedy)
    bridge, agent = (Account(user, secrets.token_urlsafe(24)) for user in (BRIDGE_USER, AGENT_USER))
    _write_passwords(folder, [bridge, agent])
    for attempt in range(_ATTEMPTS):
        chosen = port or _free_port()
        configuration = _write_configuration(folder, chosen)
        with subprocess.Popen([program, "-c", str(configuration)]) as broker:
            try:
                if _listens(chosen, broker):
                    yield BrokerAddress("127.0.0.1", chosen, "rebar", bridge, agent)
                    return
            finally:
                broker.terminate()
        if port or attempt == _ATTEMPTS - 1:
            raise LinkLost(
                f"{program} ended with exit code {broker.returncode} before it listened on {chosen}"
            )


def _write_passwords(folder: Path, accounts: list[Account]) -> None:
    """As mosquitto_passwd(1) writes them, which cannot: it needs /tmp, and has the password on its command line."""
    lines = []
    for account in accounts:
        salt = secrets.token_bytes(12)
        key = hashlib.pbkdf2_hmac("sha512", account.password.encode(), salt, _HASH_ROUNDS)
        texts = [base64.b64encode(part).decode("ascii") for part in (salt, key)]
        lines.append(f"{account.user}:$7${_HASH_ROUNDS}${texts[0]}${texts[1]}\n")
    path = folder / "mosquitto.passwords"
    path.touch(mode=0o600)
    path.write_text("".join(lines), encoding="utf-8")


def _write_configuration(folder: Path, port: int) -> Path:
    """Passwords for all, each side's topics to itself, and no limit that drops a message."""
    rights = folder / "mosquitto.rights"
    rights.write_text(
        f"user {BRIDGE_USER}\ntopic readwrite rebar/#\n\n"
        f"user {AGENT_USER}\ntopic read rebar/#\ntopic write rebar/+/agent/+\n"
        "topic write rebar/mavlink/+/from_agent\ntopic write rebar/bridge/ready\ntopic write rebar/bridge/ack\n",
        encoding="utf-8",
    )
    lines = [
        f"listener {port} 127.0.0.1",
        "allow_anonymous false",
        f"password_file {folder / 'mosquitto.passwords'}",
        f"acl_file {rights}",
        "set_tcp_nodelay true",
        "max_inflight_messages 0",
        "max_queued_messages 0",
        "log_dest stderr",
        "log_type error",
        "log_type warning",
        # Started by root it would change to a user that the agent's box does not have.
        *(["user root"] if os.geteuid() == 0 else []),
    ]
    path = folder / "mosquitto.conf"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    for written in (rights, path):
        written.chmod(0o600)
    return path


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _listens(port: int, broker: subprocess.Popen[bytes]) -> bool:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline and broker.poll() is None:
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
            return True
        except OSError:
            time.sleep(0.005)
    return False
