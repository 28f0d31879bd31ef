"""How PX4 transfers plans and flies missions."""

from __future__ import annotations

from ..links._enums import MAV_CMD, MAV_FRAME
from ..policies._choices import choices
from ..policies._missions import MissionPolicy, MissionResult, TransferPolicy
from ..policies._tables import commands_with
from ..state._parameter_store import ParameterStore
from ..state._plan_store import ABOVE_HOME, ABOVE_SEA, FENCE, MISSION, PLACELESS, RALLY, MissionItem
from ..state._texts import CRITICAL

_POLYGONS = (MAV_CMD.NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD.NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
_FENCE_AREAS = (*_POLYGONS, MAV_CMD.NAV_FENCE_CIRCLE_INCLUSION, MAV_CMD.NAV_FENCE_CIRCLE_EXCLUSION)
_ROI = (MAV_CMD.NAV_ROI, MAV_CMD.DO_SET_ROI)
_WITH_PLACE = commands_with("px4_item", "place", "either")
_WITHOUT_PLACE = commands_with("px4_item", "placeless", "either")
# The kinds of DO_SET_ROI (MAV_ROI) that are taken in a frame with a place and in one without.
_ROI_KINDS_WITH_PLACE, _ROI_KINDS_WITHOUT_PLACE = (0.0, 3.0), (0.0, 1.0, 2.0)
# MISSION_ITEM carries degrees as floats, for which PX4 does not know the _INT frames.
_INT_FRAMES = (MAV_FRAME.GLOBAL_INT, MAV_FRAME.GLOBAL_RELATIVE_ALT_INT)


def _refuse_item(kind: int, item: MissionItem, as_float: bool) -> MissionResult | None:
    placeless = item.frame in PLACELESS
    known = item.frame in ABOVE_SEA | ABOVE_HOME and not (as_float and item.frame in _INT_FRAMES)
    if not placeless and not known:
        return MissionResult.UNSUPPORTED_FRAME
    if item.command not in (_WITHOUT_PLACE if placeless else _WITH_PLACE):
        return MissionResult.UNSUPPORTED
    roi_kinds = _ROI_KINDS_WITHOUT_PLACE if placeless else _ROI_KINDS_WITH_PLACE
    if item.command in _ROI and item.params[0] not in roi_kinds:
        return MissionResult.INVALID_PARAM1
    if kind == MISSION:
        return MissionResult.ERROR if item.command in (*_FENCE_AREAS, MAV_CMD.NAV_RALLY_POINT) else None
    if kind == FENCE and item.command in _POLYGONS and not item.params[0] > 2.4:
        return MissionResult.ERROR
    return None


def _shown_frame(item: MissionItem, as_float: bool) -> int:
    if item.frame in PLACELESS:
        return item.frame
    if item.frame in ABOVE_SEA:
        return int(MAV_FRAME.GLOBAL if as_float else MAV_FRAME.GLOBAL_INT)
    return int(MAV_FRAME.GLOBAL_RELATIVE_ALT if as_float else MAV_FRAME.GLOBAL_RELATIVE_ALT_INT)


def _acceptance_radius_m(item: MissionItem, p: ParameterStore) -> float:
    """The item's own radius, where it has one."""
    radius = item.params[1]
    own = item.command == MAV_CMD.NAV_WAYPOINT and radius > 0.001
    return min(radius, 1000.0) if own else max(p["NAV_ACC_RAD"], 0.1)


MISSIONS = MissionPolicy(
    **choices(MissionPolicy, "px4"),
    transfer=TransferPolicy(
        **choices(TransferPolicy, "px4"),
        timeout_texts=dict.fromkeys((MISSION, FENCE, RALLY), (CRITICAL, "Operation timeout")),
        max_items={MISSION: 65534, FENCE: 64, RALLY: 32},
        uploaded_texts={},
        past_the_end=lambda kind, number, length: None,
        refuse_item=_refuse_item,
        shown_frame=_shown_frame,
    ),
    acceptance_radius_m=_acceptance_radius_m,
    no_landing_texts=(),
)
