"""Items of a mission that are carried out on the way: regions of interest, speeds, conditions, gimbal, camera."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from ..guidance._fence_boundary import FenceBoundary
from ..guidance._guidance import Guidance
from ..guidance._legs import bearing
from ..guidance._manoeuvres import Hold
from ..links._enums import MAV_CMD, MAV_MOUNT_MODE
from ..payload._camera import CameraComponent
from ..payload._gimbal import KNOWN_FLAGS, NEUTRAL, Gimbal
from ..policies._missions import MissionPolicy
from ..services._home import HomeKeeper
from ..services._modes import Modes
from ..services._own_commands import OwnCommands
from ..state._flight_state import Behaviour, FlightState, NorthEast
from ..state._plan_store import PLACELESS, MissionItem
from ..state._service_context import ServiceContext
from ._mission_plan import FLOWN, JUMPS, MissionPlan, is_ground_speed, speed_of

_ROI = (MAV_CMD.NAV_ROI, MAV_CMD.DO_SET_ROI_LOCATION, MAV_CMD.DO_SET_ROI)
# Places in a mission, for a jump or for DO_LAND_START.
_MARKS = (MAV_CMD.JUMP_TAG, MAV_CMD.DO_LAND_START)
_CARRIED_OUT = {*_ROI, *JUMPS, MAV_CMD.DO_SET_ROI_NONE, MAV_CMD.DO_CHANGE_SPEED, MAV_CMD.CONDITION_YAW}
_PAYLOAD_ITEMS: dict[int, str] = {
    MAV_CMD.DO_GIMBAL_MANAGER_PITCHYAW: "carried out with a gimbal",
    MAV_CMD.DO_MOUNT_CONTROL: "carried out with a gimbal",
    MAV_CMD.IMAGE_START_CAPTURE: "carried out with a camera",
    MAV_CMD.IMAGE_STOP_CAPTURE: "carried out with a camera",
    MAV_CMD.DO_DIGICAM_CONTROL: "carried out with a camera",
    MAV_CMD.DO_SET_CAM_TRIGG_DIST: "carried out with a camera",
}
"""What each of these items does, in words of docs/flight-controller.md."""
_ACTIONS_PER_STEP = 20


@dataclass(eq=False)
class ItemActions:
    """The DO and CONDITION items that are due, and what they have set: speed, heading, region of interest.

    A mission turns the gimbal regardless of who has control of it.
    """

    _context: ServiceContext
    _policy: MissionPolicy
    _plan: MissionPlan
    _modes: Modes
    _guidance: Guidance
    _fence: FenceBoundary
    _home: HomeKeeper
    _gimbal: Gimbal | None
    _camera: CameraComponent | None
    _own_commands: OwnCommands | None
    speed_mps: float | None = None
    yaw_rad: float | None = None
    _roi: NorthEast | None = None
    _due: deque[tuple[int, MissionItem]] = field(default_factory=deque)
    _wait_ns: int = 0
    _within_m: float | None = None  # of the item that is flown, before the actions go on

    def reset(self) -> None:
        self.speed_mps = self._roi = self.yaw_rad = None
        self._due.clear()

    def begin(self, actions: Iterable[tuple[int, MissionItem]] = ()) -> None:
        """These are due from now on, and no others."""
        self._due = deque(actions)
        self._wait_ns, self._within_m, self.yaw_rad = 0, None, None

    def drop(self) -> None:
        """Nothing is due any more."""
        self._due.clear()

    def heading_towards(self, flight: FlightState, place: NorthEast) -> float | None:
        if self._roi:
            return bearing(flight, self._roi)
        return self.yaw_rad if self.yaw_rad is not None else bearing(flight, place)

    def run(self, flight: FlightState, flown: MissionItem | None) -> Iterator[int]:
        """Carry out what is due on the way to the item that is flown; yields the number of each item that was."""
        remaining = _ACTIONS_PER_STEP
        while self._due and remaining and not self._waits(flight, flown):
            remaining -= 1
            number, item = self._due.popleft()
            self._context.texts.report(self._policy.item_text(item), number)
            self._run(flight, item)
            if flight.mode.behaviour is not Behaviour.MISSION:
                return
            yield number

    def _run(self, flight: FlightState, item: MissionItem) -> None:
        first, second = item.params[:2]
        if item.command == MAV_CMD.DO_CHANGE_SPEED:
            self._change_speed(item, first, second)
        elif item.command == MAV_CMD.CONDITION_YAW and math.isfinite(first):
            turn = math.radians(first)
            relative = item.params[3] == 1.0
            self.yaw_rad = flight.yaw_rad + math.copysign(turn, item.params[2] or 1.0) if relative else turn
        elif item.command == MAV_CMD.DO_SET_ROI_NONE:
            self._look_at(None, flight.down_m)
        elif item.command in _ROI:
            place = None if item.frame in PLACELESS else self._plan.place(item)
            self._look_at(place, self._plan.down_m(item))
        elif item.command in self._policy.actions:
            self._run_own(flight, item)
        elif text := self._policy.idle_text(item):
            self._context.texts.report(text)
        else:
            if self._gimbal:
                _turn_gimbal(self._gimbal, item)
            if self._camera:
                _command_camera(self._camera, item)

    def _run_own(self, flight: FlightState, item: MissionItem) -> None:
        first, second = item.params[:2]
        match item.command:
            case MAV_CMD.CONDITION_DELAY if math.isfinite(first):
                self._wait_ns = flight.time_ns + round(min(max(first, 0.0), 1e6) * 1e9)
            case MAV_CMD.CONDITION_DISTANCE:
                self._within_m = max(first, 0.0)
            case MAV_CMD.DO_FENCE_ENABLE if first in (0.0, 1.0):
                self._fence.enable(first == 1.0)
            case MAV_CMD.DO_AUX_FUNCTION:
                self._modes.run_auxiliary(first, second)
            case MAV_CMD.DO_SET_HOME:
                place = None if first == 1.0 or item.nowhere else item.place_deg
                if place is None or (*place, item.z) == (0.0, 0.0, 0.0):
                    self._home.set_here()
                else:
                    self._home.set_at(place, flight.origin.altitude_m - self._plan.down_m(item))

    def _waits(self, flight: FlightState, flown: MissionItem | None) -> bool:
        """Whether a condition keeps the actions behind it back."""
        if flight.time_ns < self._wait_ns:
            return True
        if self._within_m is None:
            return False
        place = self._plan.place(flown) if flown else None
        away_m = 0.0 if place is None else math.hypot(place[0] - flight.north_m, place[1] - flight.east_m)
        if away_m >= self._within_m:
            return True
        self._within_m = None
        return False

    def _look_at(self, place: NorthEast | None, down_m: float) -> None:
        """Point the gimbal at a region of interest, or the nose where there is no gimbal; None ends it."""
        if self._gimbal is None:
            self._roi = place
        elif place is None:
            self._gimbal.release()
        else:
            self._gimbal.look_at(*place, down_m)

    def _change_speed(self, item: MissionItem, kind: float, speed: float) -> None:
        guidance = self._guidance
        if is_ground_speed(kind, speed):
            guidance.speed_mps = self.speed_mps = speed_of(speed, guidance.limits)
            if self.speed_mps and isinstance(guidance.manoeuvre, Hold):
                guidance.manoeuvre.change_speed(self.speed_mps)
        if self._own_commands:
            self._own_commands.send(MAV_CMD.DO_CHANGE_SPEED, item.params)


def effect_of(command: int, policy: MissionPolicy) -> str:
    """What an item does when its turn comes, in a word of docs/flight-controller.md."""
    if command in FLOWN:
        return "flown"
    if command in _CARRIED_OUT or command in policy.actions:
        return "carried out"
    if command in _MARKS:
        return "a mark"
    return _PAYLOAD_ITEMS.get(command, "no effect")


def _turn_gimbal(gimbal: Gimbal, item: MissionItem) -> None:
    if item.command == MAV_CMD.DO_GIMBAL_MANAGER_PITCHYAW:
        flags = item.x if 0 <= item.x <= KNOWN_FLAGS else 0
        pitch, yaw, pitch_rate, yaw_rate = (math.radians(angle) for angle in item.params)
        gimbal.turn(flags, pitch, yaw, pitch_rate, yaw_rate)
    elif item.command == MAV_CMD.DO_MOUNT_CONTROL:
        pitch, _, yaw, _ = (math.radians(angle) for angle in item.params)
        gimbal.turn(NEUTRAL if item.z == MAV_MOUNT_MODE.NEUTRAL else 0, pitch, yaw, math.nan, math.nan)


def _command_camera(camera: CameraComponent, item: MissionItem) -> None:
    first, second, third, fourth = item.params
    if item.command == MAV_CMD.IMAGE_START_CAPTURE:
        camera.start(second, third, fourth)
    elif item.command == MAV_CMD.IMAGE_STOP_CAPTURE:
        camera.stop()
    elif item.command == MAV_CMD.DO_DIGICAM_CONTROL and item.x:  # its fifth parameter: shoot
        camera.shoot()
    elif item.command == MAV_CMD.DO_SET_CAM_TRIGG_DIST:
        camera.every(first)
        if third == 1.0:
            camera.shoot()
