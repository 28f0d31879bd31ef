"""Flying: along paths where the rules allow it, waiting where something asks for it, home and down."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from bench.contracts import AgentPhase, MissionOrder

from .._log import Log
from .._orders import Orders
from .._settings import Settings
from .._steps import Steps, T
from .._watch import Watch
from ..mission._planner import Planner
from ..perception._perception import ObjectPerception
from ..perception._pose import VehiclePose
from ..perception._tracks import Track
from ._airspace import Airspace, Airspaces
from ._caution import Caution
from ._control import Control, TurnBack
from ._landing import LandingPlace
from ._limits import MissionLimits
from ._paths import Place, Walk, bearing_rad
from ._piloted_vehicle import PilotedVehicle, PositionSetpoint
from ._reserve import Reserve

# Reached by the takeoff command; the rest is climbed on the way, which saves time. Chosen, not measured.
FIRST_HEIGHT_M = 6.0
# An autopilot that cannot be armed by then stays on the ground. Chosen, not measured.
READY_BY_S = 60.0
# How far ahead on its path it aims. Chosen, not measured.
LEAD_S = 0.6
# Share of the speed that the lead alone brings about: the feed-forward adds only the rest near people.
LEAD_SHARE = 0.57
# How much farther it looks, so that the camera turns before a corner. Chosen, not measured.
LOOK_M = 12.0
# How far progress along the path may jump: a path that crosses itself must not be cut short.
WINDOW_M = 25.0
# Left of a path that counts as flown. Chosen, not measured.
ARRIVED_M = 3.0
# From its path, after which it flies back to it round what is forbidden. Chosen, not measured.
ASTRAY_M = 35.0
# Near enough to begin coming down. Chosen, not measured.
OVER_HOME_M = 8.0
# Below this it counts as stopped. Chosen, not measured.
SLOW_MPS = 1.0
# A search waits this long for a silent detector. Chosen, not measured.
BLIND_WAIT_S = 45.0
# How old the knowledge of where people are may be. Chosen, not measured.
PEOPLE_S = 0.3


def never() -> bool:
    return False


class Pilot:
    """One vehicle under one mission order."""

    planner_type, reserve_type, caution_type = Planner, Reserve, Caution

    def __init__(
        self,
        order: MissionOrder,
        vehicle: PilotedVehicle,
        eyes: ObjectPerception,
        log: Log,
        watch: Watch,
        orders: Orders,
        settings: Settings,
        *,
        careful: bool,
    ) -> None:
        self._order = order
        self._vehicle = vehicle
        self._eyes = eyes
        self._log = log
        self._watch = watch
        self._orders = orders
        self._settings = settings
        self._airspaces = Airspaces.of(order)
        caution = self.caution_type
        margin_m, classes = settings.standoff_margin_m, order.bystander_classes
        self._caution = caution.of(order, margin_m, classes) if careful else caution()
        self._looks_before_landing = careful and settings.landing_wait_s > 0.0
        self._people: tuple[float, list[Place]] = (-math.inf, [])
        self._blind_waited_s = 0.0
        limits = MissionLimits.of(order, order, self._caution, settings.speed_share)
        self.height_m, self.speed_mps = limits.height_m, limits.speed_mps
        safe_m = min(settings.safe_height_m, self.height_m)
        self.planner = self.planner_type(
            order,
            limits.pace_mps,
            self.height_m,
            safe_m,
            settings.reserve_s,
            self.way_m,
            self._sinks_on_the_way,
        )
        self._control = Control(
            vehicle, log, orders, settings, self.height_m, self._step_aside, self._failsafe_cause
        )
        self._reserve = self.reserve_type(order, vehicle, watch, settings, self.planner)

    # What it knows.

    @property
    def pose(self) -> VehiclePose:
        """Raises TurnBack where the autopilot does not say."""
        return self._control.pose

    @property
    def place(self) -> Place:
        pose = self.pose
        return pose.east_m, pose.north_m

    @property
    def home(self) -> Place:
        return self._order.home.east_m, self._order.home.north_m

    @property
    def airspace(self) -> Airspace:
        return self._airspaces.at(self._vehicle.now_s)

    def way_m(self, a: Place, b: Place) -> float:
        """Length of the way between two places as it may be flown now."""
        return self.airspace.length_m(a, b)

    def homeward(self) -> str:
        """Why it must go home now: the battery or the time; empty when it need not."""
        return self._reserve.homeward(self.place, routed=bool(self.airspace.blocks))

    def people(self) -> list[Place]:
        """Where bystanders are known, for a careful pilot under rules about them; else nowhere."""
        if not self._caution.watches:
            return []
        if self._vehicle.now_s - self._people[0] >= PEOPLE_S:
            self._people = (self._vehicle.now_s, self._caution.people(self._eyes.tracks, self._vehicle.now_s))
        return self._people[1]

    # Up.

    def take_off(self, grounded: Callable[[], bool]) -> Steps[None]:
        """From the ground to mission control in the air, once `grounded` is over.

        Raises TurnBack when that fails, Ordered when it is ended.
        """
        vehicle = self._vehicle
        yield from vehicle.limit_speed(self.speed_mps)
        self._log.enter("starting", "waiting until the autopilot is ready")
        if not self._reserve.allows_takeoff():
            raise TurnBack(
                f"the battery holds {vehicle.battery_fraction:.0%}: too little to fly and keep the reserve"
            )
        yield from self._attentive(self._wait_while(lambda: not vehicle.ready and vehicle.now_s < READY_BY_S))
        while grounded() or not vehicle.armed:
            yield from self._attentive(self._wait_while(grounded))
            if not (yield from self._attentive(vehicle.arm(vehicle.now_s + READY_BY_S))):
                raise TurnBack(
                    f"the autopilot could not be armed: {'; '.join(vehicle.texts) or 'it gives no reason'}"
                )
        self._reserve.took_off()
        yield from self._lift_off()
        yield from vehicle.silence_the_rest()
        if self._order.min_altitude_m is not None:
            while self.pose.height_m < self._order.min_altitude_m:
                yield from self._control.check()
                yield

    def _lift_off(self) -> Steps[None]:
        """From standing armed to the setpoints in control. Raises TurnBack when that fails, Ordered."""
        vehicle = self._vehicle
        self._log.enter("taking_off", f"climbing to {FIRST_HEIGHT_M:g} m")
        first_m = min(FIRST_HEIGHT_M, self.height_m)
        if not (yield from self._attentive(vehicle.take_off(first_m, vehicle.now_s + 60.0))):
            raise TurnBack(
                f"the takeoff failed: {'; '.join(vehicle.texts) or 'the autopilot gives no reason'}"
            )
        aim = PositionSetpoint(*self.place, self.height_m, self.pose.yaw_rad)
        if not (yield from vehicle.go_offboard(aim)):
            raise TurnBack("the autopilot does not give control to the setpoint stream")

    def _wait_while(self, condition: Callable[[], bool]) -> Steps[None]:
        while condition():
            yield

    def _attentive(self, steps: Steps[T]) -> Steps[T]:
        """Do something that takes a while, and heed orders meanwhile."""
        while True:
            self._orders.heed()
            try:
                next(steps)
            except StopIteration as done:
                result: T = done.value
                return result
            yield

    # Along.

    def follow(
        self,
        path: Sequence[Place],
        speed_mps: float,
        *,
        facing: Track | None = None,
        until: Callable[[], bool] = never,
        leave: Callable[[], bool] = never,
        looking: bool = False,
        home_bound: bool = False,
    ) -> Steps[bool]:
        """Fly along a path at mission height, round what is forbidden; False when `leave` came true
        meanwhile.

        `looking`: the flight is there to see something, and waits while the detector is silent. Raises
        TurnBack and Ordered.
        """
        space = self.airspace
        walk = Walk(space.path([self.place, *path]) if space.blocks else path)
        while not until():
            yield from self.keep_control(looking=looking, home_bound=home_bound)
            if leave():
                return False
            if self.airspace is not space:
                space = self.airspace
                walk = Walk(space.path([self.place, *walk.rest()]))
            astray = math.dist(self.place, back := walk.at(walk.done_m)) > ASTRAY_M
            if astray and not (
                yield from self.follow([self.place, back], speed_mps, leave=leave, home_bound=home_bound)
            ):
                return False
            walk.go(self.place, WINDOW_M)
            if walk.left_m < ARRIVED_M:
                return True
            self._aim_along(walk, speed_mps, facing)
            yield
        return True

    def _aim_along(self, walk: Walk, speed_mps: float, facing: Track | None) -> None:
        """A point a little ahead on the path, with the speed along it fed forward so that no way is lost."""
        people = self.people()
        limit_mps = self._caution.speed_mps(speed_mps, self.place, people)
        feed = 1.0 if limit_mps >= speed_mps else 1.0 - LEAD_SHARE
        speed_mps = walk.speed_mps(limit_mps)
        ahead_m = walk.done_m + LEAD_S * speed_mps
        at, (east, north) = walk.at(ahead_m), walk.direction(ahead_m)
        if people:
            at = self._caution.aside(at, self.height_m, people)
        far = walk.at(ahead_m + LOOK_M)
        look_at = far if facing is None else facing.place
        velocity = east * speed_mps * feed, north * speed_mps * feed
        self._vehicle.setpoint = PositionSetpoint(*at, self.height_m, self._yaw_to(look_at), velocity)

    def _yaw_to(self, look_at: Place) -> float:
        """Direction to a place; the present one when it is right below."""
        return bearing_rad(self.place, look_at) if math.dist(self.place, look_at) > 4.0 else self.pose.yaw_rad

    # Control.

    def keep_control(self, *, looking: bool = False, home_bound: bool = False) -> Steps[None]:
        """Return when the flight can go on, after whatever has to be waited for.

        Raises TurnBack and Ordered.
        """
        yield from self._control.check()
        while True:
            if not home_bound and (reason := self.homeward()):
                raise TurnBack(reason)
            if not home_bound and self._link_lost("return"):
                yield from self._homeward_while_link_is_down()
            elif why := self._must_stand(looking=looking, home_bound=home_bound):
                yield from self._stand(*why, looking=looking, home_bound=home_bound)
            else:
                return

    # Waiting.

    def _link_lost(self, rule: str) -> bool:
        """Whether the operator has been out of reach for so long that this rule holds."""
        order = self._order
        return (
            order.link_lost == rule
            and self._watch.link_down_for_s(self._vehicle.now_s) > order.link_lost_after_s
        )

    @property
    def _link_down_text(self) -> str:
        return f"the operator's link is down for more than {self._order.link_lost_after_s:g} s"

    def _must_stand(self, *, looking: bool, home_bound: bool) -> tuple[str, str] | None:
        """What to wait for, by its name, and why; None when nothing asks for it."""
        if self._orders.held_by:
            return self._orders.held_by, "ordered to hold"
        if home_bound and self.homeward():
            return None
        if self._link_lost("hold"):
            return "operator_link", self._link_down_text
        if home_bound:
            return None
        if self._vehicle.gps_ok is False:
            return "gps", "no GPS: it stays where it is until places are sure again"
        if looking and self._watch.blind and self._blind_waited_s < BLIND_WAIT_S:
            return "detections", "no search without detections"
        return None

    def _stand(self, cause: str, why: str, *, looking: bool, home_bound: bool) -> Steps[None]:
        """Brake and stay until nothing asks for it any more. Raises TurnBack when it has to go home."""
        for _ in self._step_aside():
            yield
            yield from self._control.check()
        vehicle, before = self._vehicle, (self._log.phase, self._log.text)
        self._log.decide("hold", cause, why)
        self._log.enter("holding", why)
        stand, yaw_rad = self.place, self.pose.yaw_rad
        braking, since_s = True, vehicle.now_s
        while (must := self._must_stand(looking=looking, home_bound=home_bound)) and must[0] == cause:
            if self._link_lost("return") and not home_bound:
                break
            if reason := self.homeward():
                self._orders.held_by = ""
                self._log.decide("go_on", cause, f"it cannot wait any longer: {reason}")
                if not home_bound:
                    raise TurnBack(reason)
                break
            span_s = vehicle.now_s - since_s
            if cause == "detections":
                self._blind_waited_s += span_s
            since_s = vehicle.now_s
            if braking:  # where it is, as long as that moves: the autopilot brakes as hard as it may
                stand, braking = self.place, math.hypot(*vehicle.poses.velocity_en_mps) > SLOW_MPS
            else:
                stand = self._caution.drifted(stand, self.people(), span_s)
            vehicle.setpoint = PositionSetpoint(*stand, self.height_m, yaw_rad)
            yield
            yield from self._control.check()
        self._log.decide("go_on", cause, "nothing asks to wait any more")
        self._log.enter(*before)

    def _failsafe_cause(self) -> str:
        """The fault that the autopilot acts on."""
        if self._vehicle.gps_ok is False:
            return "gps"
        return "battery" if any("batter" in text.lower() for text in self._vehicle.texts[-3:]) else "link"

    def _step_aside(self) -> Steps[None]:
        """To where it may stand; the reference agent stands where it is."""
        yield from ()

    def _homeward_while_link_is_down(self) -> Steps[None]:
        """Towards home as long as the operator cannot be reached.

        Raises TurnBack when it is over home by then.
        """
        before = (self._log.phase, self._log.text)
        why = self._link_down_text
        self._log.decide("return", "operator_link", why)
        self._log.enter("returning", why)
        if not self._order.return_home:
            raise TurnBack(why)
        back = lambda: self._watch.link_up  # noqa: E731
        yield from self.follow([self.place, self.home], self.speed_mps, until=back, home_bound=True)
        if not self._watch.link_up:
            raise TurnBack(why)
        self._log.decide("go_on", "operator_link", "the operator can be reached again")
        self._log.enter(*before)

    # Down.

    def _sinks_on_the_way(self, place: Place) -> bool:
        """Whether it may come down while it flies from a place to the one where it lands: no rule keeps it high,
        and nothing closed lies between.
        """
        goal = self.home if self._order.return_home else place
        ruled = self._order.min_altitude_m is not None or self._caution.watches
        return not ruled and self.airspace.clear(place, goal)

    def come_down(self, reason: str) -> Steps[AgentPhase]:
        """End early, by the means left: `complete` when flown as far as time allowed. Raises Ordered."""
        vehicle = self._vehicle
        if not vehicle.armed and not vehicle.silent:
            self._log.decide("abort", "", reason)
            return "aborted"
        if vehicle.is_offboard and not vehicle.silent:
            try:
                yield from self.go_home(reason)
                return "complete"
            except TurnBack as cause:
                reason = f"{reason}; {cause}"
        self._log.decide("abort", "", reason)
        self._log.enter("returning", reason)
        vehicle.setpoint = None
        if not vehicle.failsafe:
            yield from vehicle.change_mode(vehicle.kind.rtl)
        yield from self.wait_until_down()
        return "aborted"

    def go_home(self, reason: str, unless: Callable[[], bool] = never) -> Steps[bool]:
        """Fly home and land, or land where it is; False when `unless` came true first."""
        vehicle = self._vehicle
        self._log.decide("return", "", reason)
        self._log.enter("returning", reason)
        safe_m = min(self._settings.safe_height_m, self.height_m)
        goal = self.home if self._order.return_home else self.place
        if not self._sinks_on_the_way(self.place):
            over_home = lambda: math.dist(self.place, goal) < OVER_HOME_M  # noqa: E731
            if not (
                yield from self.follow(
                    [self.place, goal], self.speed_mps, until=over_home, leave=unless, home_bound=True
                )
            ):
                return False
        landing = None
        if self._looks_before_landing:
            classes, wait_s = self._order.bystander_classes, self._settings.landing_wait_s
            landing = LandingPlace(goal, classes, self._eyes, self._log, wait_s)
        while True:
            yield from self.keep_control(home_bound=True)
            if unless():
                return False
            aim, low = goal, self.pose.height_m <= safe_m + 2.0
            if landing is not None:
                hurry = self._watch.blind or bool(self.homeward())
                aim = landing.aim(self.place, self.pose.height_m, low=low, hurry=hurry)
                goal = landing.goal
            if aim == goal and low and math.dist(self.place, goal) <= 1.5:
                break
            vehicle.setpoint = PositionSetpoint(*aim, safe_m, self._yaw_to(goal))
            yield
        where = "over home" if self._order.return_home else "where it is"
        yield from self._control.land(f"coming down {where}")
        return True

    def land_here(self, reason: str) -> Steps[None]:
        """Land where it is, now."""
        if self._vehicle.armed:
            yield from self._control.land(reason)

    def wait_until_down(self) -> Steps[None]:
        """Until the autopilot has disarmed. Raises Ordered."""
        return self._control.wait_until_down()

    @property
    def landing(self) -> bool:
        """Whether a landing has begun."""
        return self._control.landing
