"""What a vehicle carries beside its autopilot, and what the bench lets its autopilot do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bench.simspec import Camera

BreakPart = Callable[[str, int, bool], bool]
"""Breaks (True) or repairs (False) a part: the kind of a SimSpec's failure, and its instance, 0 for all.
Returns False where there is no such part.
"""


@dataclass(frozen=True, slots=True)
class Equipment:
    """The camera, whose `gimbal` and `mavlink` define what of it is on the links, and what the bench offers.

    `truth` gives HIL_STATE_QUATERNION in wire order; None keeps the true motion from the links. `break_part`
    serves INJECT_FAILURE. Without `simulation_control` clients may neither inject failures nor set the parameters
    of the simulation: an agent would choose the situation in which it is tested. `px4_topics`: a companion sees PX4's topics
    beside the links.
    """

    camera: Camera | None = None
    truth: Callable[[], tuple[Any, ...]] | None = None
    break_part: BreakPart | None = None
    simulation_control: bool = True
    px4_topics: bool = False
