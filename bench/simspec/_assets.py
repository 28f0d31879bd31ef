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
    # Appended: the surrogate draws by place in this table, and false detections by the labels above. A new label is
    # therefore no possible false alarm, so that flights of older SimSpecs stay as they are.
    "man": Asset("civilian", 0.5, 0.6, 1.8, ("combatant", "tree")),
    "woman": Asset("civilian", 0.5, 0.55, 1.66, ("combatant", "tree")),
    "police-officer": Asset("civilian", 0.5, 0.6, 1.8, ("combatant",)),
    "armed-person": Asset("combatant", 0.6, 0.95, 1.78, ("civilian",)),
    "pickup": Asset("civilian_vehicle", 5.3, 1.95, 1.8, ("military_vehicle",)),
    "van": Asset("civilian_vehicle", 5.5, 2.0, 2.5, ("military_vehicle",)),
    "ambulance": Asset("civilian_vehicle", 5.5, 2.0, 2.7, ("military_vehicle",)),
    "bus": Asset("civilian_vehicle", 12.0, 2.55, 3.3, ("building",)),
    "truck": Asset("civilian_vehicle", 8.5, 2.5, 3.6, ("military_vehicle",)),
    "fuel-truck": Asset("civilian_vehicle", 8.9, 2.5, 3.3, ("military_vehicle",)),
    "motorcycle": Asset("civilian_vehicle", 2.1, 0.8, 1.1, ("crate",)),
    "tracked-vehicle": Asset("military_vehicle", 7.0, 3.1, 2.6, ("civilian_vehicle", "mobile_radar")),
    "apartment-block": Asset("building", 18.0, 12.0, 12.0, (), True),
    "conifer": Asset("tree", 3.8, 3.8, 9.0, ("crate",), True),
    "bush": Asset("tree", 2.0, 2.0, 1.2, ("crate",)),
    "crate-stack": Asset("crate", 3.6, 2.4, 1.9, ("civilian_vehicle",)),
    "tent": Asset("tent", 5.2, 4.0, 2.6, ("building",), possible_false_alarm=False),
    "cow": Asset("animal", 2.4, 0.7, 1.45, ("civilian",), possible_false_alarm=False),
    "sheep": Asset("animal", 1.2, 0.55, 0.9, ("civilian",), possible_false_alarm=False),
    "dog": Asset("animal", 1.0, 0.2, 0.65, ("civilian",), possible_false_alarm=False),
}


def asset_fault(where: str, asset: str) -> Fault | None:
    """The fault of naming an asset that the catalogue does not have; None for an asset that it has."""
    if asset in ASSETS:
        return None
    return Fault(where, f"there is no asset {asset!r}", f"the catalogue has {', '.join(ASSETS)}")
