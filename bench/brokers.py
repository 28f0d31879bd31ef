"""Addresses of MQTT brokers: `mqtt://[USER@]HOST[:PORT][/PREFIX]`, or `mqtts://...` with TLS."""

from __future__ import annotations

import ssl
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlsplit

from bench.documents import open_file
from bench.errors import Fault, SetupError

_PORTS = {"mqtt": 1883, "mqtts": 8883}


@dataclass(frozen=True, slots=True)
class BrokerOptions:
    """What faults name: the options with the address and with the certificates, the forms of an address, and where a
    password belongs.
    """

    address: str
    authority: str
    forms: str
    password_place: str


@dataclass(frozen=True, slots=True)
class BrokerUrl:
    """What an address says. `user` and `prefix` are empty without one; `tls` is None for a connection in the clear."""

    host: str
    port: int
    user: str
    prefix: str
    tls: ssl.SSLContext | None = field(repr=False)


def parse_broker_url(url: str, authority: Path | None, options: BrokerOptions) -> BrokerUrl:
    """The broker of an address.

    `authority` is a PEM file with the certificate that signed the broker's, in place of the host's own list.
    Raises SetupError for anything else, and for a password in the address.
    """

    def refused(what: str) -> SetupError:
        remedy = f"write {options.forms}; an IPv6 address stands in brackets"
        return SetupError(options.address, f"{url!r}: {what}", remedy)

    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise refused(str(error)) from None
    if parts.scheme not in _PORTS or not parts.hostname:
        raise refused("it is no address of a broker")
    if parts.password is not None:
        what = "a password in the address is visible to all users"
        raise SetupError(options.address, what, options.password_place)
    if "?" in url or "#" in url:
        raise refused("it has a query or a fragment")
    prefix = unquote(parts.path).strip("/")
    if prefix:
        check_topic(options.address, prefix)
    if authority is not None and parts.scheme != "mqtts":
        remedy = f"use mqtts://, or leave {options.authority} out"
        raise SetupError(options.authority, "mqtt:// has no TLS", remedy)
    tls = _tls_context(authority) if parts.scheme == "mqtts" else None
    return BrokerUrl(parts.hostname, port or _PORTS[parts.scheme], unquote(parts.username or ""), prefix, tls)


def check_topic(where: str, topic: str) -> None:
    """Raise SetupError unless messages can be sent to a topic: MQTT 3.1.1, section 4.7."""
    if not topic or topic.startswith(("/", "$")) or any(mark in topic for mark in "+#\0"):
        raise SetupError(
            Fault(where, f"{topic!r} is no topic to send to", "name one without +, #, or a leading / or $")
        )


def _tls_context(authority: Path | None) -> ssl.SSLContext:
    if authority is not None:
        # First: OpenSSL would wait at a pipe.
        open_file(authority).close()
    try:
        return ssl.create_default_context(cafile=None if authority is None else str(authority))
    except (OSError, ssl.SSLError) as error:
        raise SetupError(
            str(authority), f"cannot be read as certificates: {error}", "give a PEM file"
        ) from None
