"""How ArduCopter transfers plans and flies missions."""

from __future__ import annotations

import math
from dataclasses import replace

from ..links._enums import MAV_CMD, MAV_FRAME
from ..policies._choices import choices
from ..policies._missions import MissionPolicy, MissionResult, TransferPolicy
from ..policies._tables import cells_by_command, commands_with, parameter_indices
from ..state._parameter_store import ParameterStore
from ..state._plan_store import (
    ABOVE_GROUND,
    ABOVE_HOME,
    ABOVE_SEA,
    FENCE,
    MISSION,
    PLACELESS,
    RALLY,
    MissionItem,
)
from ..state._texts import DEBUG, INFO, WARNING, StatusText

_NAMES = cells_by_command("ardupilot_item")
_WITH_PLACE = commands_with("ardupilot_place", "place")
_PLAIN_NUMBERS = commands_with("ardupilot_place", "numbers")
_NAN_TAKEN = parameter_indices("ardupilot_nan")
_KEPT = parameter_indices("ardupilot_keeps")
_SKIPPED = commands_with("ardupilot_turn", "skipped")
# Such numbers mark commands beyond a byte in the store.
_RESERVED = (0, 1)
_POLYGONS = (MAV_CMD.NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD.NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
_AREA_COMMANDS: dict[int, frozenset[int]] = {
    FENCE: frozenset(
        {
            MAV_CMD.NAV_FENCE_RETURN_POINT,
            *_POLYGONS,
            MAV_CMD.NAV_FENCE_CIRCLE_INCLUSION,
            MAV_CMD.NAV_FENCE_CIRCLE_EXCLUSION,
        }
    ),
    RALLY: frozenset({MAV_CMD.NAV_RALLY_POINT}),
}
_FRAMES = ABOVE_SEA | ABOVE_HOME | ABOVE_GROUND | PLACELESS
# Source: the SITL says so each time that it has written a fence, also one without items.
_FENCE_INDEXED: StatusText = (DEBUG, "Fence Indexed OK")
# What fits into the store, in centimetres of 24 bits (source: LOCATION_ALT_MAX_M).
_MAX_HEIGHT_M = 83_000.0


def _refuse_item(kind: int, item: MissionItem, as_float: bool) -> MissionResult | None:
    """In the order of AP_Mission's own checks (source), which decides for an item with several faults."""
    if kind != MISSION:
        return _refuse_area_item(kind, item)
    converted = as_float and item.command not in _PLAIN_NUMBERS
    fault = (converted and _refuse_degrees(item)) or _refuse_number(item)
    if fault:
        return fault
    if item.command not in _NAMES:
        return MissionResult.INVALID if item.command in _RESERVED else MissionResult.UNSUPPORTED
    if item.command not in _WITH_PLACE:
        return None
    fault = _refuse_place(item)
    return fault if fault or item.frame in _FRAMES else MissionResult.UNSUPPORTED_FRAME


def _refuse_area_item(kind: int, item: MissionItem) -> MissionResult | None:
    """Items of fences and rally points."""
    if item.command not in _AREA_COMMANDS[kind]:
        return MissionResult.UNSUPPORTED
    if item.frame not in _FRAMES:
        return MissionResult.UNSUPPORTED_FRAME
    if not math.isfinite(item.params[0]):
        return MissionResult.INVALID_PARAM1
    return None if item.frame in PLACELESS else _refuse_place(item)


def _refuse_number(item: MissionItem) -> MissionResult | None:
    nan_taken = _NAN_TAKEN.get(item.command, ())
    for index, value in enumerate(item.params):
        if math.isinf(value) or (math.isnan(value) and index not in nan_taken):
            return MissionResult(MissionResult.INVALID_PARAM1 + index)
    return None


def _refuse_place(item: MissionItem) -> MissionResult | None:
    return _refuse_degrees(item) or (None if abs(item.z) < _MAX_HEIGHT_M else MissionResult.INVALID_PARAM7)


def _refuse_degrees(item: MissionItem) -> MissionResult | None:
    if abs(item.x) > 900_000_000:
        return MissionResult.INVALID_PARAM5_X
    return MissionResult.INVALID_PARAM6_Y if abs(item.y) > 1_800_000_000 else None


def _stored(item: MissionItem) -> MissionItem:
    """What AP_Mission's store keeps of an item (source). A place without a frame of its own is one above the sea; of
    turns and landings that have a sense alone, this is 1 or -1.
    """
    command, params = item.command, list(item.params)
    kept = _KEPT.get(command, range(4))
    if command == MAV_CMD.NAV_LOITER_TIME:
        params[2] = -1.0 if params[2] < 0.0 else 1.0
    if command == MAV_CMD.NAV_LAND:
        params[3] = -1.0 if params[3] < 0.0 else 1.0
    elif command in (MAV_CMD.NAV_LOITER_TURNS, MAV_CMD.NAV_LOITER_TIME, MAV_CMD.NAV_LOITER_TO_ALT):
        params[3] = float(params[3] > 0.0)
    first, second, third, fourth = (param if index in kept else 0.0 for index, param in enumerate(params))
    placeless = command not in _WITH_PLACE and command not in _PLAIN_NUMBERS
    return replace(
        item,
        params=(first, second, third, fourth),
        frame=MAV_FRAME.GLOBAL if item.frame in PLACELESS and command in _WITH_PLACE else item.frame,
        x=0 if placeless else item.x,
        y=0 if placeless else item.y,
        autocontinue=1,
    )


def _has_degrees(command: int, frame: int) -> bool:
    return command not in _PLAIN_NUMBERS


def _refuse_plan(
    kind: int, items: tuple[MissionItem, ...]
) -> tuple[MissionResult, tuple[StatusText, ...]] | None:
    """Refuse a polygon of less than three vertices or with some missing."""
    index = 0
    while kind == FENCE and index < len(items):
        if items[index].command not in _POLYGONS:
            index += 1
            continue
        count = items[index].params[0]
        alike = all(
            item.command == items[index].command for item in items[index : index + int(min(count, 1e4))]
        )
        if not 3 <= count <= len(items) - index or not alike:
            invalid = f"Invalid vertex count ({int(min(max(count, -1e4), 1e4))})"
            return MissionResult.ERROR, ((WARNING, invalid), (WARNING, "Fence validation failed"))
        index += int(count)
    return None


def _past_the_end(kind: int, number: int, length: int) -> MissionResult | None:
    """Observed of missions; of fences and rally points by the source."""
    if kind == MISSION or (kind == FENCE and number == length):
        return MissionResult.ERROR
    return MissionResult.INVALID_SEQUENCE


def _shown_frame(item: MissionItem, as_float: bool) -> int:
    placeless = item.command in _NAMES and item.command not in _WITH_PLACE
    if placeless or item.frame in ABOVE_SEA | PLACELESS:
        return int(MAV_FRAME.GLOBAL)
    return int(MAV_FRAME.GLOBAL_RELATIVE_ALT if item.frame in ABOVE_HOME else MAV_FRAME.GLOBAL_TERRAIN_ALT)


def _item_text(item: MissionItem) -> StatusText | None:
    return INFO, f"Mission: {{}} {_NAMES.get(item.command, 'Cmd')}"


def _idle_text(item: MissionItem) -> StatusText | None:
    """Source."""
    if item.command == MAV_CMD.DO_SET_RESUME_REPEAT_DIST:
        return INFO, f"Resume repeat dist set to {min(max(item.params[0], 0.0), 65535.0):.0f} m"
    if item.command in _SKIPPED:
        return WARNING, f"Skipping invalid cmd #{item.command}"
    return None


def _acceptance_radius_m(item: MissionItem, p: ParameterStore) -> float:
    return max(p["WPNAV_RADIUS"], 5.0) / 100.0


MISSIONS = MissionPolicy(
    **choices(MissionPolicy, "ardupilot"),
    transfer=TransferPolicy(
        **choices(TransferPolicy, "ardupilot"),
        timeout_texts={
            kind: (WARNING, f"{name} upload timeout")
            for kind, name in ((MISSION, "Mission"), (FENCE, "Fence"), (RALLY, "Rally"))
        },
        max_items={MISSION: 650, FENCE: 256, RALLY: 64},
        uploaded_texts={MISSION: (INFO, "Flight plan received"), FENCE: _FENCE_INDEXED},
        cleared_texts={FENCE: _FENCE_INDEXED},
        past_the_end=_past_the_end,
        refuse_item=_refuse_item,
        refuse_plan=_refuse_plan,
        stored=_stored,
        has_degrees=_has_degrees,
        shown_frame=_shown_frame,
    ),
    actions=frozenset(
        {
            MAV_CMD.CONDITION_DELAY,
            MAV_CMD.CONDITION_DISTANCE,
            MAV_CMD.DO_SET_HOME,
            MAV_CMD.DO_FENCE_ENABLE,
            MAV_CMD.DO_AUX_FUNCTION,
        }
    ),
    idle_text=_idle_text,
    item_text=_item_text,
    acceptance_radius_m=_acceptance_radius_m,
    no_landing_texts=(
        (WARNING, "No landing sequence found"),
        (WARNING, "Mode change to AUTO RTL failed: init failed"),
    ),
)
