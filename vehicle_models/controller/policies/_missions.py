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


def accept_plan(
    kind: int, items: tuple[MissionItem, ...]
) -> tuple[MissionResult, tuple[StatusText, ...]] | None:
    return None


def stored_as_it_came(item: MissionItem) -> MissionItem:
    return item


def has_degrees_by_frame(command: int, frame: int) -> bool:
    return frame not in PLACELESS


def no_item_text(item: MissionItem) -> StatusText | None:
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferPolicy:
    """The mission protocol: uploads, downloads and clearing of missions, fences and rally points."""

    request: Literal["MISSION_REQUEST", "MISSION_REQUEST_INT"]
    repeat_s: float
    """Time after which the same item is requested again."""
    timeout_s: float
    timeout_result: MissionResult | None
    timeout_texts: Mapping[int, StatusText]
    """By MAV_MISSION_TYPE."""
    clears_at_start: bool
    """Whether the old plan is deleted as an upload begins, not as it ends."""
    max_items: Mapping[int, int]
    """By MAV_MISSION_TYPE."""
    too_many_text: StatusText | None
    """{} stands for the limit."""
    uploaded_texts: Mapping[int, StatusText]
    """By MAV_MISSION_TYPE."""
    bad_item_text: StatusText | None
    wrong_sequence_ends: bool
    """Whether an item out of sequence ends the upload; else it is ignored."""
    no_upload_text: StatusText | None
    bad_type: MissionResult
    clears_all_types: bool
    """Whether MAV_MISSION_TYPE_ALL is known."""
    clears_flown_mission: bool = True
    cleared_texts: Mapping[int, StatusText] = field(default_factory=dict)
    """By MAV_MISSION_TYPE."""
    one_at_a_time: bool
    """Whether a request is refused while another transfer runs. Plans have ids then.

    Else each plan has an upload of its own, whose client may begin it anew.
    """

    client_cancels: bool
    """Whether a MISSION_ACK of the client ends its upload."""
    partial_lists: bool
    """Whether MISSION_WRITE_PARTIAL_LIST is taken."""
    partial_refused_text: StatusText | None = None
    past_the_end: Callable[[int, int, int], MissionResult | None]
    """Answer to the request of an item that does not exist: MAV_MISSION_TYPE, number of the item, length of the
    plan; None: silence. That of a mission follows its length.
    """
    item_float_text: StatusText | None
    request_float_text: StatusText | None
    refuse_item: Callable[[int, MissionItem, bool], MissionResult | None]
    """Why an item is not taken: MAV_MISSION_TYPE, item, whether it came as MISSION_ITEM with floats."""
    checks_jumps: bool = False
    """Whether a jump to an item that does not exist is refused."""
    refuse_plan: Callable[
        [int, tuple[MissionItem, ...]], tuple[MissionResult, tuple[StatusText, ...]] | None
    ] = accept_plan
    """Why a whole plan is not taken."""
    stored: Callable[[MissionItem], MissionItem] = stored_as_it_came
    """An item of a mission as it is kept."""
    has_degrees: Callable[[int, int], bool] = has_degrees_by_frame
    """Whether x and y of a MISSION_ITEM are degrees, by its command and frame; else they are plain numbers."""
    shown_frame: Callable[[MissionItem, bool], int]
    """The frame of an item in a download, and in one with floats."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionPolicy:
    """The flight of missions; `transfer` is the protocol that brings them."""

    transfer: TransferPolicy
    home_first: bool
    """Whether item 0 is home, whatever was uploaded."""
    guided_items: bool = False
    """Whether a MISSION_ITEM whose `current` is 2 is an order to go there in the offboard mode, and no
    item.
    """

    total_without_mission: int
    """MISSION_CURRENT.total without a mission."""
    waits_for_start: bool
    """Whether a vehicle on the ground waits for MISSION_START."""
    restarts_when_disarmed: bool
    """Whether the mission begins anew after disarming; else where it was."""
    reached_repeat_s: float | None
    """Time after which MISSION_ITEM_REACHED is sent again."""
    reached_counts_next: bool
    """Whether MISSION_ITEM_REACHED gives the number of the DO item that follows."""
    begin_text: StatusText | None
    climb_text: StatusText | None
    """{} stands for the height above home."""
    end_text: StatusText | None
    """{} stands for "loitering" or "landed"."""
    no_such_item_text: StatusText | None
    outside_fence_text: StatusText | None
    """{} stands for the number of the item; None: a mission may leave the fence."""
    far_event: StatusText | None = None
    """An event without a text, for a plan with an item too far away."""
    actions: frozenset[int] = frozenset()
    """Items that are carried out beside those of every autopilot: conditions and commands of its own."""
    idle_text: Callable[[MissionItem], StatusText | None] = no_item_text
    """Sent in place of an effect, when the turn of an item comes."""
    item_text: Callable[[MissionItem], StatusText | None] = no_item_text
    """Sent as an item begins; {} stands for its number."""
    acceptance_radius_m: Callable[[MissionItem, ParameterStore], float]
    """How close to a waypoint the vehicle has reached it."""
    acceptance_height_m: float
    items_have_heading: bool
    return_changes_mode: bool
    """Whether the item NAV_RETURN_TO_LAUNCH changes the mode."""
    arms_at_start: bool
    set_current_command: bool
    """Whether there is DO_SET_MISSION_CURRENT."""
    starts_without_mission: bool
    """Whether MISSION_START without a mission is accepted while disarmed."""
    start_refused_text: StatusText | None
    no_landing_texts: tuple[StatusText, ...]
