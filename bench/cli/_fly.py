"""`rebar fly`: a simulated flight controller without the rest of the bench."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.contracts import LinkSpec
from bench.errors import SetupError
from bench.simspec import DEFAULT_VEHICLE, MAX_LATITUDE_DEG

if TYPE_CHECKING:
    from bench.simspec import PluginAutopilot

# The prefixes are those of connection strings in pymavlink.
KINDS: dict[str, Literal["udp_out", "udp_in", "tcp_in"]] = {
    "udpout": "udp_out",
    "udpin": "udp_in",
    "tcpin": "tcp_in",
}


@dataclass(frozen=True, slots=True)
class FlyOptions:
    """The options of `rebar fly`."""

    autopilot: Annotated[Literal["px4", "ardupilot"], typer.Option(help="Kind of flight controller")] = "px4"
    vehicle: Annotated[
        str, typer.Option(help="x500 (quadrotor), wing (fixed wing, px4 only), or a model of your own")
    ] = DEFAULT_VEHICLE
    mavlink: Annotated[
        list[str] | None,
        typer.Option(
            help="A link: udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT, serial:PATH or serial:auto. Repeatable"
        ),
    ] = None
    serial: Annotated[
        list[str] | None,
        typer.Option(
            help="A serial device with a companion computer, DEVICE or DEVICE:BAUD (921600). Repeatable; in real time"
        ),
    ] = None
    interface: Annotated[
        str,
        typer.Option(help="Listen on this network interface, such as eth0, for a companion computer"),
    ] = ""
    speed: Annotated[float, typer.Option(min=0.1, max=1000.0, help="Simulated seconds per second")] = 1.0
    home: Annotated[str, typer.Option(help="LAT,LON,ALT,HDG in degrees and metres")] = "47.3977,8.5456,488,0"
    signing_key: Annotated[str, typer.Option(help="Sign messages with this key, 64 hexadecimal digits")] = ""
    signing: Annotated[
        Literal["require", "accept"],
        typer.Option(help="With require, unsigned messages are ignored"),
    ] = "require"
    params: Annotated[Path | None, typer.Option(help="File that keeps the parameters between starts")] = None
    camera: Annotated[
        bool, typer.Option("--camera", help="Carry a camera on a gimbal; both answer on the links")
    ] = False
    firmware: Annotated[
        str,
        typer.Option(
            help="Fly a real autopilot: PX4's folder with bin/px4 and etc/, ArduPilot's program, or one of a plug-in, "
            "KIND:OPTION=VALUE,..."
        ),
    ] = ""
    duration: Annotated[float | None, typer.Option(help="Stop after this many simulated seconds")] = None

    def check(self) -> None:
        """Raises SetupError for options that cannot be, or not together."""
        plugin = parse_firmware(self.firmware)
        outside = {
            "--serial": self.serial,
            "--interface": self.interface,
            f"--firmware {self.firmware}": plugin,
        }
        if self.speed != 1.0 and (option := next((name for name, value in outside.items() if value), None)):
            what = (
                f"another computer, or the firmware of a plug-in, keeps real time, and {self.speed:g} is not"
            )
            raise SetupError("--speed", what, f"leave it out with {option}")
        if self.firmware and self.params is not None:
            raise SetupError("--params", "a real autopilot keeps its parameters itself", "leave out --params")

    def links(self) -> list[LinkSpec]:
        """The links that were asked for, signed; those of the autopilot's SITL if none was."""
        from bench.simulation import DEFAULT_LINKS, interface_links

        links = [parse_link(text, index) for index, text in enumerate(self.mavlink or ())]
        links += [parse_serial(text, len(links) + index) for index, text in enumerate(self.serial or ())]
        if self.interface:
            links += interface_links(self.autopilot, self.interface)
        return [
            replace(link, signing_key=self.signing_key, signing=self.signing)
            for link in links or DEFAULT_LINKS[self.autopilot]
        ]


def fly(options: FlyOptions) -> None:
    """Run a simulated flight controller by itself, in place of a SITL.

    Example: rebar fly --autopilot px4 --mavlink udpout:127.0.0.1:14540
    """
    from bench.simulation import StandalonePlan, run_standalone

    options.check()
    with terminated_as_interrupted():
        plan = StandalonePlan(
            options.autopilot,
            links=options.links(),
            home=parse_home(options.home),
            speed=options.speed,
            duration_s=options.duration,
            parameter_file=options.params,
            model=options.vehicle,
            camera=options.camera,
            firmware=parse_firmware(options.firmware) or options.firmware,
        )
        # Flushed: a program that reads the output through a pipe waits for the first line.
        run_standalone(plan, partial(print, flush=True))


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """Let SIGTERM end the program in good order, as Ctrl-C does.

    Containers and services are stopped by SIGTERM.
    """
    former = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, former)


def parse_home(text: str) -> tuple[float, float, float, float]:
    """Latitude and longitude (degrees), altitude (metres above sea level) and heading (degrees)."""
    try:
        latitude, longitude, altitude, heading = (float(part) for part in text.split(","))
    except ValueError:
        raise SetupError(
            "--home", f"{text!r} is not LAT,LON,ALT,HDG", "for example 47.3977,8.5456,488,0"
        ) from None
    if not (
        abs(latitude) <= MAX_LATITUDE_DEG
        and -180 <= longitude <= 180
        and -400 <= altitude <= 5000
        and 0 <= heading < 360
    ):
        raise SetupError(
            "--home",
            f"{text!r} is out of range",
            f"latitude -{MAX_LATITUDE_DEG:g} to {MAX_LATITUDE_DEG:g}, longitude -180 to 180, altitude -400 to 5000 m, "
            "heading 0 to 360",
        )
    return latitude, longitude, altitude, heading


def parse_link(text: str, index: int) -> LinkSpec:
    """A LinkSpec from the text of `--mavlink`."""
    kind, _, rest = text.partition(":")
    if kind == "serial" and rest:
        return LinkSpec(name=f"link{index}", kind="serial", path=rest)
    host, _, port = rest.rpartition(":")
    if ":" in host:
        raise SetupError("--mavlink", f"{text!r}: links have no IPv6", "give an IPv4 address or a name")
    if kind not in KINDS or not host or not port.isdigit() or not 0 < int(port) < 65536:
        what = f"{text!r} is not a link"
        raise SetupError("--mavlink", what, "for example udpout:127.0.0.1:14540 or tcpin:127.0.0.1:5760")
    return LinkSpec(name=f"link{index}", kind=KINDS[kind], host=host, port=int(port))


def parse_serial(text: str, index: int) -> LinkSpec:
    """A LinkSpec from the text of `--serial`."""
    path, baud = _parse_device(text)
    return LinkSpec(name=f"serial{index}", kind="serial", path=path, baud=baud)


def parse_firmware(text: str) -> PluginAutopilot | None:
    """The plug-in's autopilot of `--firmware`, KIND:OPTION=VALUE,...; None for the path of a firmware."""
    from bench.documents import validate_document
    from bench.simspec import PluginAutopilot

    kind, colon, options = text.partition(":")
    if not colon or "/" in kind or Path(text).exists():
        return None
    pairs = [option.partition("=") for option in options.split(",")]
    if not all(name and equals for name, equals, _ in pairs):
        example = "for example px4-board:device=/dev/ttyACM0,baud=921600"
        raise SetupError("--firmware", f"{text!r} is not KIND:OPTION=VALUE,...", example)
    document = {"kind": kind, "options": {name: value for name, _, value in pairs}}
    return validate_document(document, PluginAutopilot, source="--firmware")


def _parse_device(text: str) -> tuple[str, int]:
    """Path and speed of DEVICE or DEVICE:BAUD."""
    from bench.simspec import DEFAULT_BAUD

    path, colon, baud = text.rpartition(":")
    # Names under /dev/serial/by-path hold colons too.
    if not (colon and baud.isdigit()) or Path(text).exists():
        path, baud = text, str(DEFAULT_BAUD)
    if not path or int(baud) <= 0:
        raise SetupError(
            "--serial", f"{text!r} is no device", "give DEVICE or DEVICE:BAUD, such as /dev/ttyUSB0:921600"
        )
    return path, int(baud)
