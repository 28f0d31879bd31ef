"""What can be set from outside, under `agent.options` of the SimSpec."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Literal

from bench.errors import Fault, SetupError

MOUNTS = ("auto", "level", "body")
PolicyName = Literal["naive", "bystander_aware"]


@dataclass(frozen=True, slots=True)
class Settings:
    """How the agent searches and when it is sure. Everything has a default; the SimSpec may change any of it."""

    # Identification: what has to agree before something is reported.
    min_frames: int = 6  # observations of the object
    min_viewpoint_deg: float = 25.0  # spread of the directions that it was seen from
    min_streak: int = 3  # latest observations in a row that carry the same label
    # Search.
    overlap: float = 0.3  # share of the camera's ground width that neighbouring legs have in common
    search_margin_m: float = 15.0  # a target may stand this far outside the reported circle
    inspect_speed_mps: float = 8.0
    # Bystanders (bystander_aware alone).
    bystander_margin_m: float = 6.0  # for errors of position, added to the distance that the rules state
    bystander_drift_mps: float = 0.7  # how fast one that is out of sight may come nearer: a walk with pauses
    memory_s: float = 45.0  # how long a look at a place stays good
    unseen_share: float = 0.08  # of the disc round a target that may stay unseen
    # Safety.
    reserve_s: float = 8.0  # spare time on the way home
    min_battery: float = 0.25
    safe_height_m: float = 15.0  # flown over home before landing
    mount: str = "auto"  # level or body; auto believes /tf_static
    camera: str = "front"  # whose camera_info to listen to

    @staticmethod
    def of(options: Mapping[str, object]) -> Settings:
        """Settings with these options set. Raises SetupError with every one that is unknown or of the wrong kind."""
        kinds: dict[str, type] = {field.name: type(getattr(DEFAULTS, field.name)) for field in fields(Settings)}
        faults = [fault for name, value in sorted(options.items()) if (fault := _fault(name, value, kinds))]
        if faults:
            raise SetupError(faults)
        return Settings(**{name: kinds[name](value) for name, value in options.items()})


DEFAULTS = Settings()


def _fault(name: str, value: object, kinds: Mapping[str, type]) -> Fault | None:
    where = f"agent.options.{name}"
    if name not in kinds:
        return Fault(where, "is not an option of the reference agent", f"it knows {', '.join(kinds)}")
    if kinds[name] is str:
        choices = MOUNTS if name == "mount" else None
        if isinstance(value, str) and value and (choices is None or value in choices):
            return None
        return Fault(where, f"{value!r} is not valid", f"one of {', '.join(choices)}" if choices else "a name")
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < 0:
        return Fault(where, f"{value!r} is not valid", "a number of at least 0")
    return None
