"""Services on the host's network or the internet that an agent may ask during its session."""

from __future__ import annotations

import ipaddress
import re
from itertools import combinations

from pydantic import Field, field_validator

from bench.documents import Document

from ._quantities import Identifier

# Labels as in RFC 1123, and the underscore that names in containers' networks have. The name becomes a line of
# /etc/hosts, so nothing else may be in it.
_LABEL = r"[A-Za-z0-9]([A-Za-z0-9_-]{0,61}[A-Za-z0-9])?"
_NAME = re.compile(rf"{_LABEL}(\.{_LABEL})*")
LOCALHOST = "127.0.0.1"


class OutsideService(Document):
    """A TCP service outside of the session that the agent may ask: a language model, a map server.

    The agent finds the address that leads to it in `variable`. A session with services cannot be repeated bit for bit,
    because nobody knows what they answer.
    """

    name: Identifier = Field(description="Ends the name of the variable: REBAR_SERVICE_NAME.")
    host: str = Field(max_length=253, description="Name or address, as a program on the host would give it.")
    port: int = Field(ge=1, le=65535)

    @field_validator("host")
    @classmethod
    def _host_is_a_name_or_an_address(cls, host: str) -> str:
        if _is_address(host):
            return host
        # As in URLs: what ends in a number is an address, and a wrong one here.
        if not _NAME.fullmatch(host) or host.rpartition(".")[2].isdigit():
            raise ValueError(
                f"{host!r} is neither a host name nor an IP address; write api.example.org, 127.0.0.1 or ::1, without "
                "http://, port and brackets"
            )
        return host.lower()

    @property
    def variable(self) -> str:
        """The environment variable of the agent that holds the address."""
        return f"REBAR_SERVICE_{self.name.upper().replace('-', '_')}"

    @property
    def has_host_name(self) -> bool:
        """Whether the host is given by a name that a program looks up."""
        return not _is_address(self.host)

    @property
    def canonical_host(self) -> str:
        """The host, with one spelling for this host itself."""
        return LOCALHOST if self.host == "localhost" else self.host


class OutsideAir(Document):
    """A way into the air network (Zenoh) of the session for an agent on another computer, in real time.

    The computer connects to the interface's address and `port` as user `companion`, with the text in `token_file` as its
    password. It may read and write what an agent may. Nothing on the way is encrypted.
    """

    interface: str = Field(
        min_length=1, max_length=15, description="Network interface of the host, such as eth0."
    )
    port: int = Field(7447, ge=1, le=65535)
    token_file: str = Field(
        min_length=1,
        description="File with the token, 16 characters or more, that nobody else on the host may read. The token "
        "stands in no document.",
    )


def raise_clashes(services: tuple[OutsideService, ...]) -> None:
    """Raises ValueError where two services would have one variable, or are one address."""
    for first, second in combinations(services, 2):
        pair = f"services: {first.name!r} and {second.name!r}"
        if first.variable == second.variable:
            raise ValueError(f"{pair} give one variable, {first.variable}; rename one of them")
        if (first.canonical_host, first.port) == (second.canonical_host, second.port):
            raise ValueError(f"{pair} are both {first.host}:{first.port}; remove one of them")


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True
