"""Small realized SimSpecs for the tests of the scene."""

from __future__ import annotations

from collections.abc import Sequence

from bench.contracts import SimTime, VehicleState
from bench.simspec import (
    ActorGroup,
    Camera,
    Environment,
    Motion,
    Perception,
    PlacedActor,
    Point,
    Polygon,
    Realized,
    Role,
    Seeds,
    SimSpec,
    VehicleSpec,
    World,
)

Placement = tuple[str, float, float, float]
"""Asset, east in metres, north in metres, heading in degrees."""


def square(side_m: float) -> Polygon:
    half = side_m / 2.0
    return Polygon(
        corners=tuple(
            Point(east_m=a * half, north_m=b * half) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        )
    )


def scene_simspec(
    placements: Sequence[Placement],
    *,
    motion: Motion | None = None,
    concealment: float = 0.0,
    area: Polygon | None = None,
    camera: Camera | None = None,
    environment: Environment | None = None,
    perception: Perception | None = None,
    root: int = 0,
) -> SimSpec:
    """One group for each asset; houses stand still, others have `motion`."""
    assets = list(dict.fromkeys(asset for asset, *_ in placements))
    groups = tuple(
        ActorGroup(
            id=asset,
            asset=asset,
            role=Role.CLUTTER,
            count=sum(placement[0] == asset for placement in placements),
            concealment=concealment,
            motion=motion if motion is not None and asset != "house" else Motion(),
        )
        for asset in assets
    )
    placed = tuple(
        PlacedActor(id=f"a{index}", group=asset, east_m=east, north_m=north, heading_deg=heading)
        for index, (asset, east, north, heading) in enumerate(placements)
    )
    return SimSpec(
        name="situation",
        world=World(area=area or square(400.0)),
        environment=environment or Environment(),
        vehicle=VehicleSpec(camera=camera or Camera()),
        actors=groups,
        perception=perception or Perception(),
        seeds=Seeds(root=root),
        realized=Realized(actors=placed),
    )


def hovering(
    east_m: float,
    north_m: float,
    up_m: float,
    yaw_rad: float = 0.0,
    roll_rad: float = 0.0,
    pitch_rad: float = 0.0,
) -> VehicleState:
    """A hovering vehicle at a place given in metres, with its attitude in radians."""
    return VehicleState(SimTime(0), (east_m, north_m, up_m), (0.0, 0.0, 0.0), roll_rad, pitch_rad, yaw_rad)
