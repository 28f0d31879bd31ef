"""Plans as they are stored: missions, fences and rally points."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field

from ..links._enums import MAV_FRAME

# MAV_MISSION_TYPE
MISSION, FENCE, RALLY = 0, 1, 2
# Frames of items by what their height is measured from; MAV_FRAME_MISSION is for items without a place.
ABOVE_SEA = frozenset({MAV_FRAME.GLOBAL, MAV_FRAME.GLOBAL_INT})
ABOVE_HOME = frozenset({MAV_FRAME.GLOBAL_RELATIVE_ALT, MAV_FRAME.GLOBAL_RELATIVE_ALT_INT})
ABOVE_GROUND = frozenset({MAV_FRAME.GLOBAL_TERRAIN_ALT, MAV_FRAME.GLOBAL_TERRAIN_ALT_INT})
PLACELESS = frozenset({MAV_FRAME.MISSION})
_ITEM = struct.Struct("<HBBfffffii")


@dataclass(frozen=True, slots=True)
class MissionItem:
    """A plan's item; `x`, `y` 1e-7 degree of latitude, longitude in global frames, `z` metres by the frame."""

    command: int
    frame: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1
    current: int = 0

    @property
    def place_deg(self) -> tuple[float, float] | None:
        """Latitude and longitude; None where the item names no place on Earth."""
        if self.frame in PLACELESS or abs(self.x) > 900_000_000 or abs(self.y) > 1_800_000_000:
            return None
        return self.x * 1e-7, self.y * 1e-7

    @property
    def nowhere(self) -> bool:
        """Whether the item names a place that is not on Earth."""
        return self.frame not in PLACELESS and self.place_deg is None


@dataclass(slots=True)
class StoredPlan:
    """The items of one kind. `identity` is a checksum over them: equal plans, equal identity; 0 for none."""

    items: tuple[MissionItem, ...] = ()
    identity: int = 0
    on_change: list[Callable[[], object]] = field(default_factory=list)

    def put(self, items: tuple[MissionItem, ...]) -> None:
        self.items = items
        self.identity = identity_of(items)
        for listener in self.on_change:
            listener()


class StoredPlans:
    """The three plans of a vehicle, by MAV_MISSION_TYPE."""

    def __init__(self) -> None:
        self.mission, self.fence, self.rally = StoredPlan(), StoredPlan(), StoredPlan()
        self.by_type = {MISSION: self.mission, FENCE: self.fence, RALLY: self.rally}


def identity_of(items: tuple[MissionItem, ...]) -> int:
    """CRC-32 over the items in order."""
    crc = 0
    for item in items:
        crc = zlib.crc32(
            _ITEM.pack(item.command, item.frame, item.autocontinue, *item.params, item.z, item.x, item.y), crc
        )
    return crc
