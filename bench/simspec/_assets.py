"""The asset catalogue: size and class label of every kind of actor, by name."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from bench.errors import Fault

# Positions are rounded to the millimetre, so a guest that fits exactly would have no position left.
CLEARANCE_M = 0.002


@dataclass(frozen=True, slots=True)
class Asset:
    """Outer size in metres (length along the heading), and the class label that perfect perception reports.

    Degraded perception may report a label of `confused_with` instead. A `solid` asset hides what is behind
    it. A false detection carries the label of an asset that is a `possible_false_alarm`.
    """

    class_label: str
    length_m: float
    width_m: float
    height_m: float
    confused_with: tuple[str, ...] = ()
    solid: bool = False
    possible_false_alarm: bool = True

    def has_room_for(self, guest: Asset) -> bool:
        """Whether the guest's footprint fits into this one at some heading, with a clearance of two
        millimetres.

        Source: Carver, "Rectangles within rectangles", Mathematics Magazine 30, 1957. A guest longer than the
        host can still fit diagonally.
        """
        long, short = max(self.length_m, self.width_m), min(self.length_m, self.width_m)
        p, q = (
            max(guest.length_m, guest.width_m) + CLEARANCE_M,
            min(guest.length_m, guest.width_m) + CLEARANCE_M,
        )
        if p <= long:
            return q <= short
        diagonal = p * p + q * q
        return q <= short and short * diagonal >= 2 * p * q * long + (p * p - q * q) * sqrt(
            diagonal - long * long
        )


ASSETS: dict[str, Asset] = {
    "civilian": Asset("civilian", 0.5, 0.6, 1.75, ("combatant", "tree")),
    "child": Asset("civilian", 0.35, 0.4, 1.2, ("combatant", "tree")),
    # A rare class: detectors confuse it with others, and never report it where there is nothing.
    "aid-worker": Asset("aid_worker", 0.5, 0.6, 1.75, ("civilian", "combatant"), possible_false_alarm=False),
    "civilian-car": Asset("civilian_vehicle", 4.4, 1.8, 1.5, ("military_vehicle", "crate")),
    "soldier": Asset("combatant", 0.6, 0.7, 1.8, ("civilian", "tree")),
    "radar-vehicle": Asset("mobile_radar", 8.0, 2.6, 4.2, ("military_vehicle", "civilian_vehicle")),
    "military-truck": Asset("military_vehicle", 6.5, 2.5, 2.8, ("civilian_vehicle", "mobile_radar")),
    "house": Asset("building", 12.0, 9.0, 6.5, (), True),
    "shed": Asset("building", 5.0, 4.0, 3.0, ("crate",), True),
    "tree": Asset("tree", 4.0, 4.0, 6.0, ("crate",), True),
    "crate": Asset("crate", 2.4, 2.4, 2.4, ("civilian_vehicle",)),
}


def asset_fault(where: str, asset: str) -> Fault | None:
    """The fault of naming an asset that the catalogue does not have; None for an asset that it has."""
    if asset in ASSETS:
        return None
    return Fault(where, f"there is no asset {asset!r}", f"the catalogue has {', '.join(ASSETS)}")
