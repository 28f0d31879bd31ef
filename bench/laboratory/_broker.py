"""Where the broker is, and who the bench is to it."""

from __future__ import annotations

import ssl
from dataclasses import dataclass, field
from pathlib import Path

from bench.brokers import BrokerOptions, parse_broker_url

DEFAULT_PREFIX = "rebar"
_OPTIONS = BrokerOptions(
    "--mqtt", "--mqtt-ca", "mqtt://HOST, or mqtts://USER@HOST:8883/PREFIX", "set REBAR_MQTT_PASSWORD"
)


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
    parts = parse_broker_url(url, authority, _OPTIONS)
    return Broker(
        parts.host, parts.port, parts.user or None, password, parts.prefix or DEFAULT_PREFIX, parts.tls
    )
