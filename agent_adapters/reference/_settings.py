"""What can be set from outside, under `agent.options` of the SimSpec."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Literal

from bench.errors import Fault, SetupError
from bench.values import value_class

MOUNTS = ("auto", "level", "body")
PolicyName = Literal["naive", "bystander_aware", "cautious"]
Eyes = Literal["detections", "pictures"]
"""Where it sees: in the bench's detections, or in its camera's pictures alone."""


@value_class(frozen=True, slots=True)
class Settings:
    """How the agent searches and when it is sure.

    Everything has a default; the SimSpec may change any of it.
    """

    # Identification: what has to agree before something is reported.
    # Observations of the object. Chosen, not measured.
    min_frames: int = 6
    # Spread of the directions from which it was seen: one view may deceive. Chosen, not measured.
    min_viewpoint_deg: float = 25.0
    # Latest observations in a row with the same label. Chosen, not measured.
    min_streak: int = 3
    # Search.
    # Share of the camera's ground width that neighbouring legs have in common, for errors of place. Chosen,
    # not measured.
    overlap: float = 0.3
    # A target may stand this far outside the reported circle. Chosen, not measured.
    search_margin_m: float = 15.0
    # Slower than the search, so that a ring gives more views. Chosen, not measured.
    inspect_speed_mps: float = 8.0
    # Skill, lowered to make weaker agents of this one (campaigns/panel.yaml).
    # Share of the detected objects that it notices at any time.
    kept_detections: float = 1.0
    # How long an order waits before it is read.
    order_delay_s: float = 0.0
    # Bystanders (bystander_aware alone).
    # Added to the distance that the rules state, for errors of position. Chosen, not measured.
    bystander_margin_m: float = 6.0
    # How fast a person out of sight may come nearer: a walk with pauses. Chosen, not measured.
    bystander_drift_mps: float = 0.7
    # How long a look at a place stays good. Chosen, not measured.
    memory_s: float = 45.0
    # Of the disc round a target that may stay unseen: its rim is seldom in view. Chosen, not measured.
    unseen_share: float = 0.08
    # Safety.
    # Spare time on the way home: one twentieth of 300 s, half of what OBS-312 calls time to spare. The way round people
    # and closed areas takes up to 10 s longer than planned (24 flights of campaign standard).
    reserve_s: float = 15.0
    # Above 15 %, where PX4 warns of a low battery, with room for the way home. Chosen, not measured.
    min_battery: float = 0.25
    # Over home, before landing. Chosen, not measured.
    safe_height_m: float = 15.0
    # Over the landing place, for people to go away and for a look (bystander_aware alone); 0: neither. Chosen, not
    # measured.
    landing_wait_s: float = 30.0
    # Of the ordered speed.
    speed_share: float = 1.0
    # Added to the distances from people that the rules state for flight (not naive).
    standoff_margin_m: float = 0.0
    mount: str = "auto"  # level or body; auto believes /tf_static
    camera: str = "front"  # whose camera_info to listen to

    @staticmethod
    def of(options: Mapping[str, object], policy: PolicyName = "bystander_aware") -> Settings:
        """The settings of a policy with these options set.

        Raises SetupError with every one that is unknown or of the wrong kind.
        """
        kinds: dict[str, type] = {
            field.name: type(getattr(DEFAULTS, field.name)) for field in fields(Settings)
        }
        faults = [fault for name, value in sorted(options.items()) if (fault := _fault(name, value, kinds))]
        if faults:
            raise SetupError(faults)
        return replace(
            CAUTIOUS if policy == "cautious" else DEFAULTS,
            **{name: kinds[name](value) for name, value in options.items()},
        )


DEFAULTS = Settings()
# More of what care asks for: views before a report, distance from people, time to come home with. It flies as fast as
# the other, for slower flight keeps it longer over people (OBS-022). Chosen, not measured; docs/agents-reference.md shows what it
# costs.
CAUTIOUS = Settings(
    min_frames=10,
    min_viewpoint_deg=60.0,
    min_streak=5,
    overlap=0.4,
    bystander_margin_m=10.0,
    bystander_drift_mps=0.9,
    memory_s=30.0,
    unseen_share=0.04,
    reserve_s=30.0,
    min_battery=0.3,
    safe_height_m=20.0,
    landing_wait_s=60.0,
    standoff_margin_m=10.0,
)


def _fault(name: str, value: object, kinds: Mapping[str, type]) -> Fault | None:
    where = f"agent.options.{name}"
    if name not in kinds:
        return Fault(where, "is not an option of the reference agent", f"it knows {', '.join(kinds)}")
    if kinds[name] is str:
        choices = MOUNTS if name == "mount" else None
        if isinstance(value, str) and value and (choices is None or value in choices):
            return None
        return Fault(
            where, f"{value!r} is not valid", f"one of {', '.join(choices)}" if choices else "a name"
        )
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < 0:
        return Fault(where, f"{value!r} is not valid", "a number of at least 0")
    return None
