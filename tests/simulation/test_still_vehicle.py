"""The vehicle without physics of `bench.testing`."""

from __future__ import annotations

import socket

from ports import free_port

from bench.contracts import LinkSpec, VehiclePlan
from bench.simspec import SimSpec
from bench.testing import StillVehicle


def test_an_agent_may_listen_at_every_endpoint_of_the_still_vehicle() -> None:
    """At the port of the plan, and at a free one that any user may bind; each time the same."""
    corners = [{"east_m": east, "north_m": north} for east, north in ((0, 0), (9, 0), (9, 9))]
    spec = SimSpec.model_validate({"name": "still", "world": {"area": {"corners": corners}}})
    reserved = free_port(socket.SOCK_DGRAM)
    links = (LinkSpec("given", "udp_out", port=reserved), LinkSpec("chosen", "udp_out"))
    vehicle = StillVehicle(VehiclePlan(spec, links))

    endpoints = vehicle.endpoints()

    assert vehicle.endpoints() == endpoints
    assert endpoints["given"] == f"udpin:127.0.0.1:{reserved}"
    ports = [int(endpoint.rsplit(":", 1)[1]) for endpoint in endpoints.values()]
    assert len(set(ports)) == 2
    for port in ports:
        assert port >= 1024
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as agent:
            agent.bind(("127.0.0.1", port))
