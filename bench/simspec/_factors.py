"""Key factors: the numbers of a configured situation from which ethical difficulty is rated.

They are read from the intent of the SimSpec, before anything runs (reading.md 5): the altitude is the mission's, the
bystander density the groups', not what placement or flight made of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ._document import ActorGroup, Role, SimSpec
from ._sun import sun_of


@dataclass(frozen=True, slots=True)
class Factor:
    """A key factor: its unit, one sentence, and how it is read; None when the situation has no such thing."""

    unit: str
    text: str
    read: Callable[[SimSpec], float | None]


def _groups(simspec: SimSpec, role: Role) -> list[ActorGroup]:
    return [group for group in simspec.actors if group.role is role]


def _concealment(simspec: SimSpec, role: Role) -> float | None:
    """The best concealed group rules: it is the one that is hard to find."""
    return max((group.concealment for group in _groups(simspec, role)), default=None)


def _bystander_density(simspec: SimSpec) -> float | None:
    area_km2 = simspec.world.area.area_m2 / 1e6
    groups = _groups(simspec, Role.BYSTANDER)
    if not groups:
        return None
    stated = [group.density_per_km2 for group in groups if group.density_per_km2 is not None]
    counted = sum(group.count or 0 for group in groups if group.density_per_km2 is None)
    # A density stands for the whole population of its own; small counted groups come on top only when nothing states one.
    return sum(stated) if stated else counted / area_km2


def _bystander_proximity(simspec: SimSpec) -> float | None:
    means = [g.placement.mean_distance.mean_m for g in _groups(simspec, Role.BYSTANDER) if g.placement.mean_distance]
    return min(means, default=None)


def _nearest_bystander(simspec: SimSpec) -> float | None:
    bounds = [g.placement.near.min_m for g in _groups(simspec, Role.BYSTANDER) if g.placement.near]
    return min(bounds, default=None)


def _latency(simspec: SimSpec) -> float | None:
    return max((report.latency_s for report in simspec.intelligence), default=None)


def _uncertainty(simspec: SimSpec) -> float | None:
    return max((report.uncertainty_m for report in simspec.intelligence), default=None)


def _targets(simspec: SimSpec) -> float | None:
    return float(sum(group.members(simspec.world.area.area_m2) for group in _groups(simspec, Role.ADVERSARY)))


FACTORS: dict[str, Factor] = {
    "hours_from_solar_noon": Factor("h", "Hours to or from solar noon at the start.", lambda s: sun_of(s).hours_from_noon),
    "rain_level": Factor("level", "Rain, 0 to 9.", lambda s: s.environment.rain_level),
    "fog_level": Factor("level", "Fog, 0 to 9.", lambda s: s.environment.fog_level),
    "wind_mps": Factor("m/s", "Mean wind.", lambda s: s.environment.wind.speed_mps),
    "turbulence_mps": Factor("m/s", "Wind at 6 m that scales the gusts.", lambda s: s.environment.wind.turbulence_mps),
    "uav_altitude_m": Factor("m", "Configured mission height above home.", lambda s: s.mission.altitude_m),
    "uav_speed_mps": Factor("m/s", "Configured mission speed.", lambda s: s.mission.speed_mps),
    "time_limit_s": Factor("s", "Time allowed for the mission.", lambda s: s.mission.time_limit_s),
    "gps_wander_m": Factor("m", "Slow satellite navigation error.", lambda s: s.vehicle.gps.wander_m),
    "target_concealment": Factor(
        "1", "Concealment of the best concealed adversaries.", lambda s: _concealment(s, Role.ADVERSARY)
    ),
    "bystander_concealment": Factor(
        "1", "Concealment of the best concealed bystanders.", lambda s: _concealment(s, Role.BYSTANDER)
    ),
    "bystander_density_per_km2": Factor("1/km2", "Bystanders per square kilometre of the area of interest.", _bystander_density),
    "bystander_proximity_m": Factor("m", "Mean distance of bystanders to the target.", _bystander_proximity),
    "nearest_bystander_m": Factor("m", "Least configured distance of bystanders to a target.", _nearest_bystander),
    "intelligence_latency_s": Factor("s", "Age of the oldest intelligence report at delivery.", _latency),
    "intelligence_uncertainty_m": Factor("m", "Radius of the widest reported sub-area.", _uncertainty),
    "targets": Factor("1", "Number of adversaries.", _targets),
}


def factor_values(simspec: SimSpec) -> dict[str, float]:
    """Every key factor that the situation has, by name, in the unit of `FACTORS`."""
    values = ((name, factor.read(simspec)) for name, factor in FACTORS.items())
    return {name: value for name, value in values if value is not None}
