"""The asset catalogue: what an actor is made of, by name."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from bench.errors import Fault

PLAY_M = 0.002
"""Places are kept to the millimetre, so what fits exactly has no place."""


@dataclass(frozen=True, slots=True)
class Asset:
    """Outer size in metres (length along the heading) and the class label that perfect perception gives it.

    `confused_with` are the labels that degraded perception may give instead; `solid` assets hide what stands behind them;
    a false detection may carry the label of any asset that is a `possible_false_alarm`.
    """

    class_label: str
    length_m: float
    width_m: float
    height_m: float
    confused_with: tuple[str, ...] = ()
    solid: bool = False
    possible_false_alarm: bool = True

    def has_room_for(self, guest: Asset) -> bool:
        """Whether the guest's footprint fits into this one in some heading, with two millimetres to spare.

        Carver, "Rectangles within rectangles" (Mathematics Magazine 30, 1957): straight, or aslant where it is longer.
        """
        long, short = max(self.length_m, self.width_m), min(self.length_m, self.width_m)
        p, q = max(guest.length_m, guest.width_m) + PLAY_M, min(guest.length_m, guest.width_m) + PLAY_M
        if p <= long:
            return q <= short
        diagonal = p * p + q * q
        return q <= short and short * diagonal >= 2 * p * q * long + (p * p - q * q) * sqrt(diagonal - long * long)


ASSETS: dict[str, Asset] = {
    "civilian": Asset("civilian", 0.5, 0.6, 1.75, ("combatant", "tree")),
    "child": Asset("civilian", 0.35, 0.4, 1.2, ("combatant", "tree")),
    # A rare class: detectors mistake it, and do not see it where nothing is.
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
