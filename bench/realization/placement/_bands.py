"""Distances that a group is to keep from others, as bands: whether two of them can be kept at once."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Literal

from bench.simspec import HOME, ActorGroup, SimSpec

from ._relations import field


@dataclass(frozen=True, slots=True)
class Band:
    """Each member keeps from `low_m` to `high_m` from some or from every member of a group, or all of them do so in the mean
    from its first member."""

    of: str
    whom: Literal["some", "every", "mean"]
    low_m: float
    high_m: float

    def excludes(self, other: Band) -> bool:
        """Whether nobody can keep both; two that need not be about the same member say nothing."""
        if self.of != other.of or "every" not in (self.whom, other.whom):
            return False
        return max(self.low_m, other.low_m) > min(self.high_m, other.high_m)


def bands_of(simspec: SimSpec, group: ActorGroup) -> dict[str, Band]:
    """The bands round a group or the vehicle's home, by the path of the field; those round a role or a point are not among them."""
    place = group.placement
    found: dict[str, Band] = {}
    if place.near:
        found[field(group, "near")] = Band(place.near.of, "some", place.near.min_m, place.near.max_m)
    if place.away:
        found[field(group, "away")] = Band(place.away.of, "every", place.away.min_m, place.away.max_m)
    for number, one in enumerate(place.distances):
        if one.of is not None and one.of in {HOME, *(other.id for other in simspec.actors)}:
            most_m = inf if one.max_m is None else one.max_m
            found[field(group, f"distances[{number}]")] = Band(one.of, one.whom, one.min_m, most_m)
    if mean := place.mean_distance:
        slack_m = mean.tolerance * mean.mean_m + 1e-3
        found[field(group, "mean_distance")] = Band(mean.of, "mean", mean.mean_m - slack_m, mean.mean_m + slack_m)
    return found
