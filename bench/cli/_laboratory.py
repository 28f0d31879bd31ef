"""Options of `rebar run` for a laboratory's MQTT broker and test stand."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.errors import SetupError

if TYPE_CHECKING:
    from bench.campaign import Completeness
    from bench.laboratory import LaboratoryBus

# From the environment, not by an option: command lines are visible to other users of the machine.
PASSWORD_VARIABLE = "REBAR_MQTT_PASSWORD"


@dataclass(frozen=True, slots=True)
class LaboratoryOptions:
    """What `rebar run` was given: a broker, and the topics of a test stand."""

    mqtt: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            envvar="REBAR_MQTT",
            help="Broker to tell events, status and scores: mqtt[s]://[USER@]HOST[:PORT][/PREFIX]",
        ),
    ] = None
    mqtt_ca: Annotated[
        Path | None,
        typer.Option("--mqtt-ca", metavar="FILE", help="Certificates that vouch for the broker (PEM)"),
    ] = None
    stand_ready: Annotated[
        str | None,
        typer.Option("--stand-ready", metavar="TOPIC", help="Before each session, wait for a message here"),
    ] = None
    stand_announce: Annotated[
        str | None,
        typer.Option("--stand-announce", metavar="TOPIC", help="Send a message here before each session"),
    ] = None
    stand_release: Annotated[
        str | None,
        typer.Option("--stand-release", metavar="TOPIC", help="Send a message here after each session"),
    ] = None


def warn(warning: str) -> None:
    """Print a warning, to stderr."""
    print(f"WARNING: {warning}", file=sys.stderr, flush=True)


@contextmanager
def open_laboratory(options: LaboratoryOptions, campaign: str) -> Iterator[LaboratoryBus | None]:
    """Yield the bus of the options; None where no broker was named. Raises SetupError for options that cannot be."""
    if options.mqtt is None:
        for name in ("mqtt_ca", "stand_ready", "stand_announce", "stand_release"):
            if getattr(options, name) is not None:
                option = f"--{name.replace('_', '-')}"
                raise SetupError(option, "needs a broker", "give --mqtt too")
        yield None
        return
    # Imported here: the client and asyncio take 60 ms that a run without a broker does without.
    from bench.laboratory import Stand, open_bus, parse_broker

    broker = parse_broker(options.mqtt, os.environ.get(PASSWORD_VARIABLE), options.mqtt_ca)
    stand = Stand(options.stand_ready, options.stand_announce, options.stand_release)
    with open_bus(broker, campaign, stand=stand, warn=warn) as bus:
        yield bus


def tell_end(bus: LaboratoryBus | None, completeness: Completeness | None, report_json: str | None) -> None:
    """Send the scores, where there are any, and how the campaign ended."""
    if bus is None:
        return
    if report_json is not None:
        bus.send_scores(report_json)
    bus.end("complete" if completeness is not None and completeness.complete else "incomplete")
