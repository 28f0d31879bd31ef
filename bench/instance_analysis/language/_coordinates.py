"""Places given by numbers: metres east and north of the origin, or degrees of latitude and longitude."""

from __future__ import annotations

from dataclasses import dataclass

from bench.simspec import Origin


@dataclass(frozen=True, slots=True)
class Coordinates:
    """A place as stated: metres east and north of the origin, or of home when `from_home`; degrees of latitude
    and longitude (WGS84) when `degrees` is true.
    """

    first: float
    second: float
    degrees: bool = False
    from_home: bool = False

    def moved(self, east_m: float, north_m: float) -> Coordinates:
        """The place so many metres further east and north."""
        return Coordinates(self.first + east_m, self.second + north_m, self.degrees, self.from_home)


def local_m(place: Coordinates, origin: Origin) -> tuple[float, float]:
    """Metres east and north of the origin in its tangent plane (WGS84), rounded to the centimetre."""
    if not place.degrees:
        return place.first, place.second
    # Imported here: few texts have degrees.
    from pymap3d import geodetic2enu

    east, north, _ = geodetic2enu(
        place.first,
        place.second,
        origin.altitude_m,
        origin.latitude_deg,
        origin.longitude_deg,
        origin.altitude_m,
    )
    return round(float(east), 2), round(float(north), 2)
