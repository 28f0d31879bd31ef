"""Where the broker is, and who the bench is to it."""

from __future__ import annotations

import ssl
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlsplit

from bench.documents import open_file
from bench.errors import Fault, SetupError

_PORTS = {"mqtt": 1883, "mqtts": 8883}
DEFAULT_PREFIX = "rebar"


@dataclass(frozen=True, slots=True)
class Broker:
    """An MQTT broker. `prefix` begins every topic; `tls` is None for a connection in the clear."""

    host: str
    port: int
    user: str | None
    password: str | None = field(repr=False)
    prefix: str
    tls: ssl.SSLContext | None = field(repr=False)


def parse_broker(url: str, password: str | None = None, authority: Path | None = None) -> Broker:
    """The broker of `mqtt://[USER@]HOST[:PORT][/PREFIX]`, or of `mqtts://...` with TLS.

    `authority` is a PEM file with the certificate that signed the broker's, in place of the host's own list.
    Raises SetupError for anything else, and for a password in the address.
    """
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise _fault(url, str(error)) from None
    if parts.scheme not in _PORTS or not parts.hostname:
        raise _fault(url, "it is no address of a broker")
    if parts.password is not None:
        raise SetupError(
            Fault("--mqtt", "a password in the address is visible to all users", "set REBAR_MQTT_PASSWORD")
        )
    if "?" in url or "#" in url:
        raise _fault(url, "it has a query or a fragment")
    prefix = unquote(parts.path).strip("/") or DEFAULT_PREFIX
    check_topic("--mqtt", prefix)
    if authority is not None and parts.scheme != "mqtts":
        raise SetupError(Fault("--mqtt-ca", "mqtt:// has no TLS", "use mqtts://, or leave --mqtt-ca out"))
    return Broker(
        host=parts.hostname,
        port=port or _PORTS[parts.scheme],
        user=unquote(parts.username) if parts.username else None,
        password=password,
        prefix=prefix,
        tls=_tls(authority) if parts.scheme == "mqtts" else None,
    )


def check_topic(where: str, topic: str) -> None:
    """Raise SetupError unless messages can be sent to a topic: MQTT 3.1.1, section 4.7."""
    if not topic or topic.startswith(("/", "$")) or any(mark in topic for mark in "+#\0"):
        raise SetupError(
            Fault(where, f"{topic!r} is no topic to send to", "name one without +, #, or a leading / or $")
        )


def _tls(authority: Path | None) -> ssl.SSLContext:
    if authority is not None:
        # First: OpenSSL would wait at a pipe.
        open_file(authority).close()
    try:
        return ssl.create_default_context(cafile=None if authority is None else str(authority))
    except (OSError, ssl.SSLError) as error:
        raise SetupError(
            Fault(str(authority), f"cannot be read as certificates: {error}", "give a PEM file")
        ) from None


def _fault(url: str, what: str) -> SetupError:
    return SetupError(
        Fault(
            "--mqtt",
            f"{url!r}: {what}",
            "write mqtt://HOST, or mqtts://USER@HOST:8883/PREFIX; an IPv6 address stands in brackets",
        )
    )
