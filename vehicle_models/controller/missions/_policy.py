"""What an autopilot's personality has to say about plans: the habits of its protocol, and what it takes and flies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import IntEnum
from typing import ClassVar, Literal

from ..parameters._store import ParameterStore
from ._store import Item


class Verdict(IntEnum):
    """Values of MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID_PARAM1 = 6
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


Text = tuple[int, str]  # severity, words


class MissionPolicy(ABC):
    """One autopilot's way with plans. Class attributes are data; methods change nothing."""

    mode: ClassVar[str]  # that flies missions
    # The protocol.
    request: ClassVar[Literal["MISSION_REQUEST", "MISSION_REQUEST_INT"]]
    repeat_s: ClassVar[float]  # the same request again
    give_up_s: ClassVar[float]
    gives_up_with: ClassVar[Verdict | None]
    gives_up_text: ClassVar[Text]
    clears_first: ClassVar[bool]  # the old plan goes as an upload begins, not when it ends
    limits: ClassVar[Mapping[int, int]]  # most items by type
    too_many_text: ClassVar[Text | None]
    taken_texts: ClassVar[Mapping[int, Text]]  # by type, when an upload has been taken
    bad_item_text: ClassVar[Text | None]
    wrong_sequence_ends: ClassVar[bool]  # else it is not heard
    no_upload_text: ClassVar[Text | None]
    bad_type: ClassVar[Verdict]
    clears_all_types: ClassVar[bool]
    one_at_a_time: ClassVar[bool]  # what comes while a transfer goes on is turned away, else it starts anew
    client_cancels: ClassVar[bool]
    partial: ClassVar[bool]  # MISSION_WRITE_PARTIAL_LIST
    past_the_end: ClassVar[Verdict | None]  # a request of an item that is not there
    guided_items: ClassVar[bool] = False  # a MISSION_ITEM whose `current` is 2 is no item: go there, in the guided mode
    home_first: ClassVar[bool]  # item 0 is home, whatever was uploaded
    item_float_text: ClassVar[Text | None]
    request_float_text: ClassVar[Text | None]
    # The flight.
    waits_for_start: ClassVar[bool]  # on the ground, until MISSION_START
    forgets_when_disarmed: ClassVar[bool]  # begins anew, else where it was
    reached_again_s: ClassVar[float | None]
    reached_counts_next: ClassVar[bool]  # reports the DO item that follows instead
    begin_text: ClassVar[Text | None]
    climb_text: ClassVar[Text | None]  # with the height
    end_text: ClassVar[Text | None]  # loitering or landed goes into the braces
    no_such_item_text: ClassVar[Text | None]
    outside_text: ClassVar[Text | None]  # with the number of the item: a mission that leaves the fence is none
    far_note: ClassVar[Text | None] = None  # an event that is no text, for a plan with an item too far away
    alt_reached_m: ClassVar[float]
    item_yaw: ClassVar[bool]  # waypoints carry a heading
    return_is_a_mode: ClassVar[bool]  # the item changes the mode
    arms_at_start: ClassVar[bool]
    set_current_command: ClassVar[bool]
    tells_speed: ClassVar[bool]  # sends the speed command of an item to its own system
    starts_anywhere: ClassVar[bool]  # MISSION_START without a mission is granted while disarmed
    start_text: ClassVar[Text | None]  # MISSION_START without a mission
    no_landing_texts: ClassVar[tuple[Text, ...]]

    @abstractmethod
    def fault(self, kind: int, item: Item, as_float: bool) -> Verdict | None:
        """Why an item is not taken."""

    def plan_fault(self, kind: int, items: tuple[Item, ...]) -> tuple[Verdict, tuple[Text, ...]] | None:
        """Why a whole plan is not taken."""
        return None

    def shown_frame(self, item: Item, as_float: bool) -> int:
        """The frame that a download gives."""
        return item.frame

    def name(self, item: Item) -> Text | None:
        """What is said as an item begins; its number goes into the braces."""
        return None

    @abstractmethod
    def radius_m(self, item: Item, p: ParameterStore) -> float:
        """How near to a waypoint is there."""
