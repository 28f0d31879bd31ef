"""ArduCopter's way with missions, fences and rally points."""

from __future__ import annotations

import math

from ..missions._policy import MissionPolicy, Text, Verdict
from ..missions._store import ABOVE_GROUND, ABOVE_HOME, ABOVE_SEA, FENCE, MISSION, PLACELESS, RALLY, Item
from ..parameters._store import ParameterStore
from ..telemetry._texts import DEBUG, INFO, WARNING

_NAMES = {
    16: "WP",
    17: "LoitUnlim",
    18: "LoitTurns",
    19: "LoitTime",
    20: "RTL",
    21: "Land",
    22: "Takeoff",
    31: "LoitAltitude",
    82: "SplineWP",
    84: "VTOLTakeoff",
    85: "VTOLLand",
    92: "GuidedEnable",
    93: "Delay",
    94: "PayloadPlace",
    112: "CondDelay",
    114: "CondDist",
    115: "CondYaw",
    177: "Jump",
    178: "ChangeSpeed",
    179: "SetHome",
    181: "SetRelay",
    182: "RepeatRelay",
    183: "SetServo",
    184: "RepeatServo",
    189: "LandStart",
    201: "SetROI",
    195: "SetROI",
    197: "SetROI",
    203: "DigiCamCtrl",
    206: "SetCamTrigDst",
    207: "FenceEnable",
    208: "Parachute",
    211: "Gripper",
    222: "GuidedLimits",
    1000: "GimbalPitchYaw",
    2000: "ImageStartCapture",
    2001: "ImageStopCapture",
    2500: "VideoStartCapture",
    2501: "VideoStopCapture",
    3000: "VTOLTransition",
    205: "MountControl",
    42600: "Winch",
}
_FENCE_KINDS = {5000, 5001, 5002, 5003, 5004}
_FRAMES = ABOVE_SEA | ABOVE_HOME | ABOVE_GROUND | PLACELESS
_FAR_M = 1e6


class ArduPilotMissions(MissionPolicy):
    mode = "AUTO"
    request = "MISSION_REQUEST"
    repeat_s, give_up_s = 1.0, 8.0
    gives_up_with = Verdict.OPERATION_CANCELLED
    gives_up_text = (WARNING, "Mission upload timeout")
    clears_first = True
    limits = {MISSION: 650, FENCE: 256, RALLY: 64}
    too_many_text = (WARNING, "Only {} items are supported")
    taken_texts = {MISSION: (INFO, "Flight plan received"), FENCE: (DEBUG, "Fence Indexed OK")}
    bad_item_text = None
    wrong_sequence_ends = True
    no_upload_text = None
    bad_type = Verdict.UNSUPPORTED
    clears_all_types = False
    one_at_a_time = False
    client_cancels = False
    partial = True
    past_the_end = Verdict.ERROR
    guided_items = True
    home_first = True
    item_float_text = (WARNING, "got MISSION_ITEM; GCS should send MISSION_ITEM_INT")
    request_float_text = (WARNING, "got MISSION_REQUEST; use MISSION_REQUEST_INT!")
    waits_for_start = True
    forgets_when_disarmed = True
    reached_again_s = None
    reached_counts_next = True
    begin_text = climb_text = end_text = None
    no_such_item_text = outside_text = None
    alt_reached_m = 2.0
    item_yaw = False
    return_is_a_mode = False
    arms_at_start = False
    set_current_command = True
    tells_speed = False
    starts_anywhere = True
    start_text = None
    no_landing_texts = ((WARNING, "No landing sequence found"), (WARNING, "Mode change to AUTO RTL failed: init failed"))

    def fault(self, kind: int, item: Item, as_float: bool) -> Verdict | None:
        known = {MISSION: _NAMES.keys(), FENCE: _FENCE_KINDS, RALLY: {5100}}[kind]
        if item.command not in known:
            return Verdict.UNSUPPORTED
        if item.frame not in _FRAMES:
            return Verdict.UNSUPPORTED_FRAME
        if any(math.isnan(one) or math.isinf(one) for one in item.params[:1]):
            return Verdict.INVALID_PARAM1
        if item.frame not in PLACELESS:
            if abs(item.x) > 900_000_000:
                return Verdict.INVALID_PARAM5_X
            if abs(item.y) > 1_800_000_000:
                return Verdict.INVALID_PARAM6_Y
        return None if abs(item.z) < _FAR_M else Verdict.INVALID_PARAM7

    def plan_fault(self, kind: int, items: tuple[Item, ...]) -> tuple[Verdict, tuple[Text, ...]] | None:
        """Jumps lead somewhere; polygons have three vertices or more, all of which are there."""
        if kind == MISSION:
            for item in items[1:]:
                if item.command == 177 and not 1.0 <= item.params[0] < len(items):
                    return Verdict.ERROR, ()
        at = 0
        while kind == FENCE and at < len(items):
            if items[at].command not in (5001, 5002):
                at += 1
                continue
            count = items[at].params[0]
            alike = all(one.command == items[at].command for one in items[at : at + int(min(count, 1e4))])
            if not 3 <= count <= len(items) - at or not alike:
                invalid = f"Invalid vertex count ({int(min(max(count, -1e4), 1e4))})"
                return Verdict.ERROR, ((WARNING, invalid), (WARNING, "Fence validation failed"))
            at += int(count)
        return None

    def shown_frame(self, item: Item, as_float: bool) -> int:
        return 0 if item.frame in ABOVE_SEA | PLACELESS else 3 if item.frame in ABOVE_HOME else 10

    def radius_m(self, item: Item, p: ParameterStore) -> float:
        return max(p["WPNAV_RADIUS"], 5.0) / 100.0

    def name(self, item: Item) -> Text | None:
        return INFO, f"Mission: {{}} {_NAMES.get(item.command, 'Cmd')}"
