"""PX4's way with missions, fences and rally points."""

from __future__ import annotations

from ..missions._policy import MissionPolicy, Text, Verdict
from ..missions._store import ABOVE_HOME, ABOVE_SEA, FENCE, MISSION, PLACELESS, RALLY, Item
from ..parameters._store import ParameterStore
from ..telemetry._texts import CRITICAL, ERROR, INFO

# Waypoint, loiter unlimited and for a time, land, takeoff, loiter to altitude, ROI, VTOL takeoff and landing, gate,
# fence points, rally point, arm, autotune.
_WITH_PLACE = {16, 17, 19, 21, 22, 31, 80, 201, 195, 84, 85, 4501, 5000, 5001, 5002, 5003, 5004, 5100, 400, 212}
# Jump, ROI, winch, gripper, speed, home, landing start, triggers and cameras and gimbals, delay, return, conditions.
_WITHOUT = {177, 80, 201, 42600, 211, 178, 179, 189, 2003, 203, 204, 205, 1000, 1001, 532, 2000, 2001, 2500, 2501}
_WITHOUT |= {200, 206, 260, 214, 530, 534, 3000, 93, 20, 196, 197, 112, 114, 187, 212, 400}
_POLYGONS, _FENCES = (5001, 5002), (5000, 5001, 5002, 5003, 5004)


class Px4Missions(MissionPolicy):
    mode = "AUTO_MISSION"
    request = "MISSION_REQUEST_INT"
    repeat_s, give_up_s = 0.26, 5.1
    gives_up_with = None
    gives_up_text = (CRITICAL, "Operation timeout")
    clears_first = False
    limits = {MISSION: 65534, FENCE: 64, RALLY: 32}
    too_many_text = None
    taken_texts = {}
    bad_item_text = (CRITICAL, "IGN MISSION_ITEM: Invalid item")
    wrong_sequence_ends = False
    no_upload_text = (CRITICAL, "IGN MISSION_ITEM: No transfer")
    bad_type = Verdict.NO_SPACE
    clears_all_types = True
    one_at_a_time = True
    client_cancels = True
    partial = False
    past_the_end = None
    home_first = False
    item_float_text = request_float_text = None
    waits_for_start = False
    forgets_when_disarmed = False
    reached_again_s = 1.0
    reached_counts_next = False
    begin_text = (INFO, "Executing Mission")
    climb_text = (INFO, "Climb to {:.1f} meters above home")
    end_text = (INFO, "Mission finished, {}")
    no_such_item_text = (CRITICAL, "WPM: WP CURR CMD: Not in list")
    outside_text = (CRITICAL, "Geofence violation for waypoint {}")
    far_note = (ERROR, "First waypoint too far away")
    alt_reached_m = 0.8
    item_yaw = True
    return_is_a_mode = True
    arms_at_start = True
    set_current_command = False
    tells_speed = True
    starts_anywhere = False
    start_text = (CRITICAL, "Mission start denied! No valid mission")
    no_landing_texts = ()

    def fault(self, kind: int, item: Item, as_float: bool) -> Verdict | None:
        if item.frame in PLACELESS:
            if item.command not in _WITHOUT:
                return Verdict.UNSUPPORTED
        elif item.frame in ABOVE_SEA | ABOVE_HOME and not (as_float and item.frame in (5, 6)):
            if item.command not in _WITH_PLACE:
                return Verdict.UNSUPPORTED
        else:
            return Verdict.UNSUPPORTED_FRAME
        if item.command in (80, 201) and item.params[0] not in ((0.0, 3.0) if item.frame not in PLACELESS else (0.0, 1.0, 2.0)):
            return Verdict.INVALID_PARAM1
        if kind == MISSION:
            return Verdict.ERROR if item.command in (*_FENCES[1:], 5100) else None
        if kind == FENCE and item.command in _POLYGONS and not item.params[0] > 2.4:
            return Verdict.ERROR
        return None

    def shown_frame(self, item: Item, as_float: bool) -> int:
        if item.frame in PLACELESS:
            return item.frame
        sea, home = (0, 3) if as_float else (5, 6)
        return sea if item.frame in ABOVE_SEA else home

    def radius_m(self, item: Item, p: ParameterStore) -> float:
        """The item's own radius, where it has one."""
        own = item.params[1]
        return min(own, 1000.0) if item.command == 16 and own > 0.001 else max(p["NAV_ACC_RAD"], 0.1)

    def name(self, item: Item) -> Text | None:
        return None
