"""MAVLink links that lead out of the session, to the network of the host, where the SimSpec asks for them."""

from __future__ import annotations

from bench.contracts import LinkSpec, MavlinkTap
from bench.network_namespace import outside_socket
from bench.simspec import SimSpec

from ._interface import interface_address
from ._truth import TruthRecorder


def outside_links(simspec: SimSpec) -> tuple[LinkSpec, ...]:
    """The links to outside. Their sockets are on the host's network, wherever this process is."""
    return tuple(
        LinkSpec(
            link.name,
            link.kind,
            interface_address(link.interface, f"vehicle.outside_links[{link.name}].interface")
            if link.interface
            else link.host,
            link.port,
            link.streams,
            path=link.device,
            baud=link.baud if link.kind == "serial" else 0,
            heard=link.heard,
            open_socket=outside_socket,
        )
        for link in simspec.vehicle.outside_links
    )


def recorded_links(simspec: SimSpec, truth: TruthRecorder) -> MavlinkTap:
    """Keeps what goes over the links, but for those on which somebody only looks on.

    Such a link carries messages only while somebody listens, so recording them would make the recording depend on
    who looks on.
    """
    watched = {link.name for link in simspec.vehicle.outside_links if not link.heard}
    if not watched:
        return truth.keep_mavlink

    def keep(link: str, direction: str, frames: bytes) -> None:
        if link not in watched:
            truth.keep_mavlink(link, direction, frames)

    return keep
