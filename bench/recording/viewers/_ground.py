"""What stands in the SimSpec and never moves: areas, roads and home, in the scene and on the map."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import pymap3d

from bench.geodesy import wrapped
from bench.simspec import Point as GroundPoint
from bench.simspec import SimSpec
from bench.streams import Pose, Time, Vector3

from ._messages import Color, CylinderPrimitive, LinePrimitive, LineType, SceneEntity, SceneUpdate
from ._shapes import (
    AREA_COLOR,
    GEOFENCE_COLOR,
    HOME_COLOR,
    NAMED_AREA_COLOR,
    NO_FLY_COLOR,
    ROAD_COLOR,
    centre,
    closed_line,
    entity,
    label,
    on_ground,
)

HOME_RADIUS_M = 2.0
HOME_HEIGHT_M = 0.2


@dataclass(frozen=True, slots=True)
class Outline:
    """A polygon with the name under which it is shown."""

    name: str
    text: str
    corners: tuple[GroundPoint, ...]
    color: Color


def outlines(simspec: SimSpec) -> Iterator[Outline]:
    """Every polygon of the situation: the area of interest, geofence, no-fly areas, named areas."""
    yield Outline("area", "area", simspec.world.area.corners, AREA_COLOR)
    if simspec.rules.geofence is not None:
        yield Outline("geofence", "geofence", simspec.rules.geofence.corners, GEOFENCE_COLOR)
    for no_fly in simspec.rules.no_fly:
        # A viewer shows the area all the time, so its label says when it holds.
        until = "" if no_fly.until_s is None else f" until {no_fly.until_s:g} s"
        times = f" from {no_fly.from_s:g} s{until}" if no_fly.from_s or until else ""
        yield Outline(f"no_fly {no_fly.id}", f"no-fly {no_fly.id}{times}", no_fly.area.corners, NO_FLY_COLOR)
    for area in simspec.world.areas:
        yield Outline(f"area {area.id}", area.id, area.corners, NAMED_AREA_COLOR)


def ground_scene(simspec: SimSpec, time: Time) -> SceneUpdate:
    """Everything that never moves, as one update."""
    return SceneUpdate(entities=tuple(_entities(simspec, time)))


def ground_map(simspec: SimSpec) -> str:
    """The same polygons and roads as a GeoJSON document, for the map panel."""
    origin = simspec.world.origin

    def positions(points: Iterable[GroundPoint]) -> list[list[float]]:
        places = (
            pymap3d.enu2geodetic(
                point.east_m, point.north_m, 0.0, origin.latitude_deg, origin.longitude_deg, origin.altitude_m
            )
            for point in points
        )
        # GeoJSON: longitude before latitude. Nine decimals are a tenth of a millimetre. At the date line longitudes go
        # on beyond 180 degrees: a line that jumps from one side to the other would be drawn round the earth.
        return [
            [
                round(origin.longitude_deg + wrapped(float(longitude) - origin.longitude_deg), 9),
                round(float(latitude), 9),
            ]
            for latitude, longitude, _ in places
        ]

    features = [
        _feature(
            outline.text,
            outline.color,
            {
                "type": "Polygon",
                "coordinates": [positions((*outline.corners, outline.corners[0]))],
            },
        )
        for outline in outlines(simspec)
    ]
    features += [
        _feature(road.id, ROAD_COLOR, {"type": "LineString", "coordinates": positions(road.points)})
        for road in simspec.world.roads
    ]
    home = {"type": "Point", "coordinates": positions([simspec.vehicle.home])[0]}
    features.append(_feature("home", HOME_COLOR, home))
    return json.dumps({"type": "FeatureCollection", "features": features})


def _entities(simspec: SimSpec, time: Time) -> Iterator[SceneEntity]:
    for outline in outlines(simspec):
        corners = tuple(on_ground(corner) for corner in outline.corners)
        yield entity(
            time,
            outline.name,
            lines=(closed_line(corners, outline.color),),
            texts=(label(outline.text, centre(corners), outline.color),),
        )
    for road in simspec.world.roads:
        points = tuple(on_ground(point) for point in road.points)
        # Not invariant to scale: the line is as wide as the road, in metres.
        strip = LinePrimitive(LineType.STRIP, Pose(), road.width_m, False, points, ROAD_COLOR)
        yield entity(time, f"road {road.id}", lines=(strip,), texts=(label(road.id, centre(points)),))
    home = on_ground(simspec.vehicle.home, HOME_HEIGHT_M / 2.0)
    size_m = Vector3(2.0 * HOME_RADIUS_M, 2.0 * HOME_RADIUS_M, HOME_HEIGHT_M)
    pad = CylinderPrimitive(Pose(home), size_m, color=HOME_COLOR)
    yield entity(time, "home", cylinders=(pad,), texts=(label("home", home, HOME_COLOR),))


def _feature(name: str, color: Color, geometry: Mapping[str, object]) -> dict[str, object]:
    style = {"color": _web_color(color), "weight": 2, "fillOpacity": 0.05}
    return {"type": "Feature", "geometry": geometry, "properties": {"name": name, "style": style}}


def _web_color(color: Color) -> str:
    return "#" + "".join(f"{round(255 * share):02x}" for share in (color.r, color.g, color.b))
