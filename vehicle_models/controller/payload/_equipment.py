"""What a vehicle carries beside its autopilot, and what the bench lets its autopilot do: given when it is built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bench.simspec import Camera

BreakPart = Callable[[str, int, bool], bool]
"""Break (True) or repair (False) a part, by the kind of a SimSpec's failure and its instance, 0 for all. False: no such part."""


@dataclass(frozen=True, slots=True)
class Equipment:
    """The camera (whose `gimbal` and `mavlink` say what of it is on the links), true motion where that may be told, and failures.

    `truth` gives the fields of HIL_STATE_QUATERNION in wire order.
    """

    camera: Camera | None = None
    truth: Callable[[], tuple[Any, ...]] | None = None
    break_part: BreakPart | None = None
