"""Who flies: the agent keeps control of the autopilot, waits for a silent one, and respects failsafes."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import AutopilotKind, Mode
from bench.contracts import AgentPhase

from .._log import Log
from .._orders import Orders
from .._settings import Settings
from .._steps import Steps
from ..perception._pose import VehiclePose
from ._piloted_vehicle import PilotedVehicle, PositionSetpoint


def _failsafe_phase(kind: AutopilotKind, mode: Mode) -> AgentPhase:
    phases: dict[Mode, AgentPhase] = {kind.land: "landing", kind.rtl: "returning"}
    return phases.get(mode, "holding")


class TurnBack(Exception):
    """Raised inside a behaviour when the mission must end now; says why."""


class Control:
    """Offboard control of one vehicle at one height."""

    def __init__(
        self,
        vehicle: PilotedVehicle,
        log: Log,
        orders: Orders,
        settings: Settings,
        height_m: float,
        step_aside: Callable[[], Steps[None]],
        failsafe_cause: Callable[[], str],
    ) -> None:
        """`step_aside` is flown before it lets go of the vehicle; `failsafe_cause` names the fault that the autopilot acts on, or ""."""
        self._vehicle = vehicle
        self._log = log
        self._orders = orders
        self._min_battery = settings.min_battery
        self._height_m = height_m
        self._step_aside = step_aside
        self._failsafe_cause = failsafe_cause
        self.landing = False

    @property
    def pose(self) -> VehiclePose:
        """Raises TurnBack where the autopilot does not say."""
        pose = self._vehicle.pose
        if pose is None:
            raise TurnBack("the autopilot does not say where it is")
        return pose

    def check(self) -> Steps[None]:
        """Return when the autopilot flies what it is told.

        Raises TurnBack when it does not any more, and Ordered.
        """
        vehicle = self._vehicle
        self._orders.heed()
        while self._orders.handed_over_by or vehicle.silent or not vehicle.is_offboard or not vehicle.armed:
            if self._orders.handed_over_by:
                yield from self._hand_over()
            elif vehicle.silent:
                yield from self._wait_for_the_autopilot()
            elif not vehicle.armed:
                raise TurnBack("the autopilot disarmed by itself")
            elif vehicle.failsafe:
                yield from self._yield_to_failsafe()
            else:
                yield from self._retake()

    def _hand_over(self) -> Steps[None]:
        """Leave the vehicle to the operator, and take it back when told so.

        Raises TurnBack where it is down by then.
        """
        vehicle, order = self._vehicle, self._orders.handed_over_by
        before = (self._log.phase, self._log.text)
        self._log.decide("hand_over", order, "the operator takes the vehicle: it stops and lets go")
        self._log.enter("holding", f"handed over by {order}")
        # Hold brakes and stays without setpoints; they go on until it is in force, or a failsafe would act.
        if vehicle.is_offboard and not vehicle.silent:
            yield from self._step_aside()
            yield from vehicle.change_mode(vehicle.kind.hold)
        vehicle.setpoint = None
        mode: Mode | None = None
        while self._orders.handed_over_by:
            if vehicle.failsafe and vehicle.mode != mode:
                mode = vehicle.mode
                phase = _failsafe_phase(vehicle.kind, mode)
                self._log.enter(phase, f"the autopilot's failsafe flies: {vehicle.reason}")
            yield
        if not vehicle.armed:
            raise TurnBack("the vehicle came down while the operator had it")
        self._log.decide("take_back", order, "the operator gives the vehicle back")
        self._log.enter(*before)

    def _wait_for_the_autopilot(self) -> Steps[None]:
        """It flies home by itself when it hears nothing; a late setpoint would not fit where it is then."""
        vehicle = self._vehicle
        vehicle.setpoint = None
        self._log.enter(self._log.phase, "waiting for the autopilot to be heard again")
        while vehicle.silent:
            self._orders.heed()
            yield
        asked_s = vehicle.mode_heard_s
        # Until the autopilot has said what it does now: the mode from before the silence may be stale.
        while vehicle.mode_heard_s <= asked_s and not vehicle.silent:
            yield
        self.aim_here()

    def _yield_to_failsafe(self) -> Steps[None]:
        """Leave the autopilot to its failsafe; the setpoints go on, so that it can give control back."""
        vehicle, before = self._vehicle, (self._log.phase, self._log.text)
        cause = self._failsafe_cause()
        words = vehicle.reason
        self._log.decide("yield", cause, f"the autopilot's failsafe flies: {words}")
        mode: Mode | None = None
        while vehicle.failsafe and vehicle.armed and not vehicle.is_offboard:
            self._orders.heed()
            if vehicle.mode != mode:
                mode = vehicle.mode
                self._log.enter(
                    _failsafe_phase(vehicle.kind, mode), f"the autopilot's failsafe flies: {words}"
                )
            if vehicle.silent:
                vehicle.setpoint = None
            else:
                self.aim_here()
            yield
        if not vehicle.armed:
            raise TurnBack(f"the autopilot's failsafe ended the flight: {words}")
        self._log.decide("go_on", cause, "the autopilot's failsafe is over")
        self._log.enter(*before)

    def _retake(self) -> Steps[None]:
        """Control was taken without need: ask for it back. Raises TurnBack when it is not given."""
        vehicle = self._vehicle
        self._log.decide("retake", "", f"the autopilot left offboard control: {vehicle.reason}")
        # With a low battery the autopilot may have good reason to fly home, even if it does not name a
        # failsafe.
        if vehicle.battery_fraction <= self._min_battery:
            raise TurnBack("the autopilot took control and keeps it")
        if vehicle.setpoint is None:
            self.aim_here()
        # PX4 accepts offboard mode only while setpoints are arriving.
        yield from vehicle.pause(0.6)
        if not (yield from vehicle.change_mode(vehicle.kind.offboard)):
            raise TurnBack("the autopilot took control and keeps it")

    def aim_here(self) -> None:
        pose = self.pose
        self._vehicle.setpoint = PositionSetpoint(pose.east_m, pose.north_m, self._height_m, pose.yaw_rad)

    # Down.

    def land(self, text: str) -> Steps[None]:
        """Land where it is, until the autopilot has disarmed. Raises Ordered."""
        self.landing = True
        self._log.enter("landing", text)
        if not (yield from self._vehicle.change_mode(self._vehicle.kind.land)):
            self._log.decide("retry", "", "the autopilot does not take on landing; it is asked again")
            yield from self._vehicle.command(mavlink.MAV_CMD_NAV_LAND)
        self._vehicle.setpoint = None
        yield from self.wait_until_down()

    def wait_until_down(self) -> Steps[None]:
        """Until the autopilot has disarmed; a landing that does not come is asked for again.

        Raises Ordered.
        """
        vehicle = self._vehicle
        asked_s = vehicle.now_s
        while vehicle.armed:
            self._orders.heed()
            if vehicle.now_s - asked_s > 90.0 and not vehicle.silent and not vehicle.failsafe:
                asked_s = vehicle.now_s
                yield from vehicle.command(mavlink.MAV_CMD_NAV_LAND)
            yield
