"""Grounds on which one member of a group has to stand, because others are to stand near some member."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import shapely

from bench.simspec import ActorGroup, SimSpec

from .._geometry import Geometry, areal_parts, simplified
from .._groups import member_count
from ..relations._other_groups import group_relations

# An anchor that leaves more than this share of a group's ground helps nobody to find it. Chosen, not measured.
MOST_OF_GROUND = 0.5


def anchor_grounds(
    simspec: SimSpec, order: Sequence[ActorGroup], remaining: Mapping[str, Geometry], attempt: int
) -> dict[str, list[Geometry]]:
    """For each group the grounds on which some member is to stand for the sake of groups placed later.

    A radar that is pinned to a point and near some tree needs one of the trees near that point: trees come first
    and would be drawn anywhere. Where several groups can lend the member, the attempts take them in turn.
    """
    anchors: dict[str, list[Geometry]] = {}
    for group in reversed(order):
        if not member_count(simspec, group):
            continue
        spots = [remaining[group.id], *anchors.get(group.id, [])]
        for tie in group_relations(simspec, group):
            names = [name for name in tie.of if simspec.group(name).placement.at is None]
            if tie.quantifier != "some" or len(names) < len(tie.of) or not names:
                continue
            name = names[attempt % len(names)]
            for spot in spots:
                ground = tie.reverse_ground(simplified(spot))
                if ground is None:
                    continue
                anchor = areal_parts(remaining[name].intersection(ground))
                if 0.0 < shapely.area(anchor) < MOST_OF_GROUND * shapely.area(remaining[name]):
                    anchors.setdefault(name, []).append(anchor)
    return anchors
