"""How an autopilot transfers plans, which items it takes, and how it flies a mission."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal

from ..state._parameter_store import ParameterStore
from ..state._plan_store import PLACELESS, MissionItem
from ..state._texts import StatusText


class MissionResult(IntEnum):
    """Values of MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferPolicy:
    """The mission protocol: uploads, downloads and clearing of missions, fences and rally points."""

    request: Literal["MISSION_REQUEST", "MISSION_REQUEST_INT"]
    repeat_s: float
    timeout_s: float
    timeout_result: MissionResult | None
    timeout_texts: Mapping[int, StatusText]
    """By MAV_MISSION_TYPE."""
    clears_at_start: bool
    max_items: Mapping[int, int]
    """By MAV_MISSION_TYPE."""
    too_many_text: StatusText | None
    uploaded_texts: Mapping[int, StatusText]
    """By MAV_MISSION_TYPE."""
    bad_item_text: StatusText | None
    wrong_sequence_ends: bool
    no_upload_text: StatusText | None
    bad_type: MissionResult
    clears_all_types: bool
    clears_flown_mission: bool
    cleared_texts: Mapping[int, StatusText] = field(default_factory=dict)
    """By MAV_MISSION_TYPE."""
    one_at_a_time: bool
    client_cancels: bool
    partial_lists: bool
    partial_refused_text: StatusText | None
    past_the_end: Callable[[int, int, int], MissionResult | None]
    """Answer to the request of a missing item, by MAV_MISSION_TYPE, its number, the plan's length; or None."""
    item_float_text: StatusText | None
    request_float_text: StatusText | None
    refuse_item: Callable[[int, MissionItem, bool], MissionResult | None]
    """Why an item is not taken: MAV_MISSION_TYPE, item, whether it came as MISSION_ITEM with floats."""
    checks_jumps: bool
    refuse_plan: Callable[
        [int, tuple[MissionItem, ...]], tuple[MissionResult, tuple[StatusText, ...]] | None
    ] = lambda kind, items: None
    """Why a whole plan is not taken."""
    stored: Callable[[MissionItem], MissionItem] = lambda item: item
    """An item of a mission as it is kept."""
    has_degrees: Callable[[int, int], bool] = lambda command, frame: frame not in PLACELESS
    """Whether x and y of a MISSION_ITEM are degrees, by its command and frame; else they are plain numbers."""
    shown_frame: Callable[[MissionItem, bool], int]
    """The frame of an item in a download, and in one with floats."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionPolicy:
    """The flight of missions; `transfer` is the protocol that brings them."""

    transfer: TransferPolicy
    home_first: bool
    guided_items: bool
    total_without_mission: int
    waits_for_start: bool
    restarts_when_disarmed: bool
    reached_repeat_s: float | None
    reached_counts_next: bool
    begin_text: StatusText | None
    climb_text: StatusText | None
    end_text: StatusText | None
    no_such_item_text: StatusText | None
    outside_fence_text: StatusText | None
    far_event: StatusText | None
    actions: frozenset[int] = frozenset()
    """Items that are carried out beside those of every autopilot: conditions and commands of its own."""
    idle_text: Callable[[MissionItem], StatusText | None] = lambda item: None
    """Sent in place of an effect, when the turn of an item comes."""
    item_text: Callable[[MissionItem], StatusText | None] = lambda item: None
    """Sent as an item begins; {} stands for its number."""
    acceptance_radius_m: Callable[[MissionItem, ParameterStore], float]
    """How close to a waypoint the vehicle has reached it."""
    acceptance_height_m: float
    items_have_heading: bool
    return_changes_mode: bool
    arms_at_start: bool
    set_current_command: bool
    starts_without_mission: bool
    start_refused_text: StatusText | None
    no_landing_texts: tuple[StatusText, ...]
