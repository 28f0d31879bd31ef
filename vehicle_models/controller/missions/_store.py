"""Plans as they are stored: missions, fences and rally points, and what their items say."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field

MISSION, FENCE, RALLY = 0, 1, 2  # MAV_MISSION_TYPE
ABOVE_SEA, ABOVE_HOME, PLACELESS, ABOVE_GROUND = frozenset({0, 5}), frozenset({3, 6}), frozenset({2}), frozenset({10, 11})
_ITEM = struct.Struct("<HBBfffffii")


@dataclass(frozen=True, slots=True)
class Item:
    """One item. `x` and `y` are 1e-7 degree of latitude and longitude in global frames; `z` metres in the frame's sense."""

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
        """Whether the item names a place, and one that is not on Earth."""
        return self.frame not in PLACELESS and self.place_deg is None


@dataclass(slots=True)
class Plan:
    """The items of one kind. `identity` is a checksum over them: equal plans, equal identity; 0 for none."""

    items: tuple[Item, ...] = ()
    identity: int = 0
    on_change: list[Callable[[], None]] = field(default_factory=list)

    def put(self, items: tuple[Item, ...]) -> None:
        self.items = items
        self.identity = identity_of(items)
        for listener in self.on_change:
            listener()


class Plans:
    """The three plans of a vehicle, by MAV_MISSION_TYPE."""

    def __init__(self) -> None:
        self.mission, self.fence, self.rally = Plan(), Plan(), Plan()
        self.by_type = {MISSION: self.mission, FENCE: self.fence, RALLY: self.rally}


def identity_of(items: tuple[Item, ...]) -> int:
    """CRC-32 over the items in order."""
    crc = 0
    for one in items:
        crc = zlib.crc32(_ITEM.pack(one.command, one.frame, one.autocontinue, *one.params, one.z, one.x, one.y), crc)
    return crc
