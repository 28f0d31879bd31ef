"""The flight controller: takes the messages of a step, runs every service, flies, and sends what is due."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from bench.contracts import MavlinkTap
from bench.simspec import Camera

from .._geodesy import LocalFrame
from ._message_router import COMPONENT, MessageRouter
from .ardupilot._topics import ApTopics
from .files._ftp import FileTransfer
from .files._served_files import ServedFiles
from .guidance._fence_boundary import FenceBoundary
from .guidance._guidance import Guidance, Manoeuvres
from .links._enums import MAV_AUTOPILOT
from .links._frames import Packer
from .links._link import Link
from .links._links import link_counters
from .links._radio import Channel, Radio
from .links._signing import open_signing
from .missions._item_actions import ItemActions
from .missions._mission_flight import MissionFlight
from .missions._mission_plan import MissionPlan
from .missions._protocol import MissionProtocol
from .payload._camera import CameraComponent
from .payload._gimbal import Gimbal
from .policies import Autopilot
from .policies._identity import CalibrationProtocol
from .px4._topics import Px4Topics
from .safety._failsafe import Failsafe
from .safety._failure_injection import BreakPart, FailureInjection
from .safety._fence import Fence
from .safety._health import Health
from .safety._rally import Rally
from .services._accelerometer_calibration import AccelerometerCalibration
from .services._arming import Arming
from .services._calibration import Calibration
from .services._clock import ClockService, SigningKeys
from .services._commands import Commands
from .services._compass_calibration import CompassCalibration
from .services._follow_target import FollowTargetService
from .services._home import HomeKeeper
from .services._identity import Identity
from .services._liftoff import LiftoffAndLanding
from .services._manual_control import ManualControl
from .services._modes import Modes
from .services._motor_test import MotorTest
from .services._navigator import Navigator
from .services._own_commands import OwnCommands
from .services._parameters import Parameters
from .services._restart import PersistentState, Restart
from .services._setpoints import Setpoints
from .services._shell import Shell
from .state._flight_state import Airframe, Behaviour, FlightState
from .state._parameter_store import ParameterStore
from .state._plan_store import StoredPlans
from .state._service import AnyStream, MessageAnswer, Service, Stream
from .state._service_context import ServiceContext
from .state._texts import FlightEvent, Texts
from .telemetry._attitude import AttitudeCache
from .telemetry._battery_monitor import BatteryMonitor
from .telemetry._events import EventService
from .telemetry._ground_texts import GroundTexts
from .telemetry._motion import MotionTelemetry
from .telemetry._power import PowerTelemetry
from .telemetry._remote_identification import RemoteIdentification
from .telemetry._sensors import SensorTelemetry
from .telemetry._streams import Streams
from .telemetry._system import SystemTelemetry
from .telemetry._targets import TargetTelemetry
from .telemetry._terrain import Terrain

R = TypeVar("R")

# Looked up once, because every step compares with it.
_TERMINATE = Behaviour.TERMINATE


@dataclass(frozen=True, slots=True)
class Equipment:
    """The camera, whose `gimbal` and `mavlink` define what of it is on the links, and what the bench offers.

    `truth` gives HIL_STATE_QUATERNION in wire order; None keeps the true motion from the links. `break_part`
    serves INJECT_FAILURE. Without `simulation_control` clients may neither inject failures nor set the parameters
    of the simulation: an agent would choose the situation in which it is tested. `companion_topics`: a companion sees
    the autopilot's topics beside the links.
    """

    camera: Camera | None = None
    truth: Callable[[], tuple[Any, ...]] | None = None
    break_part: BreakPart | None = None
    simulation_control: bool = True
    companion_topics: bool = False


class Controller:
    """One flight controller on its links. `receive`, then `control`, then (after the physics) `report`, once
    a step.

    `initial_parameters` differ from the autopilot's defaults. `persistent` is what the previous controller of
    the same vehicle left, and takes their place. `topics` are there where the equipment asks for those of an
    autopilot.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        flight: FlightState,
        airframe: Airframe,
        frame: LocalFrame,
        links: Sequence[Link],
        initial_parameters: Mapping[str, float],
        tap: MavlinkTap | None = None,
        manoeuvres: Manoeuvres | None = None,
        equipment: Equipment | None = None,
        persistent: PersistentState | None = None,
    ) -> None:
        self._autopilot = autopilot
        self._flight = flight
        parameters = ParameterStore(
            autopilot.parameters.definitions, persistent.parameters if persistent else initial_parameters
        )
        # The parameter is a float of any value; MAVLink system ids are 1 to 255.
        self._system = min(max(int(parameters[autopilot.parameters.system_id]), 1), 255)
        self._signing = (
            persistent.signing
            if persistent
            else open_signing([link.spec for link in links], flight.unix_start_us)
        )
        packer = Packer(self._system, COMPONENT)
        self.channels = [Channel(link, packer, self._signing, number) for number, link in enumerate(links)]
        # Everything below shares one radio, so that messages leave in the order in which services queue them.
        radio = Radio(self.channels, tap, autopilot.telemetry.waits_for_client)
        identity = autopilot.identity
        texts = Texts(radio, flight, identity.texts, identity.text_ending, identity.texts_for_stations_s)
        self._context = ServiceContext(flight, airframe, frame, radio, texts, parameters)
        self._plans = StoredPlans()
        self._camera: CameraComponent | None = None
        self._failure_injection: FailureInjection | None = None
        self._build_flight_services(manoeuvres)
        self._build_safety_services()
        equipment = equipment or Equipment()
        self._join(self._build_services(equipment), equipment.truth)
        self.topics: Px4Topics | ApTopics | None = None
        if equipment.companion_topics:
            self.topics = self._open_topics()
        if persistent:
            for kind, items in persistent.plans.items():
                self._plans.by_type[kind].put(items)
        # Of a start that lies before the session nobody heard anything: neither its texts nor the first home.
        self._boot_texts = [
            text for text in autopilot.identity.boot_texts(flight) if text.at_s >= flight.time_s
        ]
        self._home.tick()
        self._previous_counts = persistent.counts if persistent else {}

    def _open_topics(self) -> Px4Topics | ApTopics:
        services = (self._modes, self._setpoints, self._commands, self._battery)
        shared = (self._context, self._autopilot, self._system, *services)
        if self._autopilot.identity.autopilot == MAV_AUTOPILOT.ARDUPILOTMEGA:
            return ApTopics(*shared, self._sticks)
        return Px4Topics(*shared, self._failsafe.charge_state)

    def _build_flight_services(self, manoeuvres: Manoeuvres | None) -> None:
        """What flies the vehicle, from the fence's boundary to arming; everything else builds on these."""
        context, autopilot, plans = self._context, self._autopilot, self._plans
        flight, frame, parameters = context.flight, context.frame, context.parameters
        # In this order: the boundary follows a new fence before the mission is judged by it.
        self._boundary = boundary = FenceBoundary(
            autopilot.safety.fence, flight, frame, parameters, plans.fence
        )
        rally = Rally(autopilot.safety.fence, frame, parameters, plans.rally)
        limits = autopilot.parameters.limits(parameters)
        self._guidance = guidance = Guidance(flight, limits, rally.return_point, manoeuvres)
        parameters.on_change(self._update_limits)
        self._setpoints = setpoints = Setpoints(context, autopilot.setpoints, guidance, boundary)
        self._modes = modes = Modes(context, autopilot.modes, guidance, setpoints.fresh)
        self._home = HomeKeeper(context, autopilot.commands, autopilot.modes.knows_position)
        self._arming = Arming(context, autopilot.modes, modes, guidance, self._home, setpoints.fresh)
        self._liftoff = LiftoffAndLanding(context, autopilot.modes, guidance, self._arming)

    def _build_safety_services(self) -> None:
        context, autopilot, modes = self._context, self._autopilot, self._modes
        self._battery = battery = BatteryMonitor(context, autopilot.safety)
        termination = autopilot.modes.termination
        self._failsafe = Failsafe(
            context, autopilot.safety, modes, self._setpoints, battery, termination, self._disarm
        )
        self._fence = Fence(context, self._boundary, modes, self._failsafe)

    def _build_services(self, equipment: Equipment) -> list[object]:
        """Every service, in the order in which they tick."""
        context, autopilot, modes, guidance = self._context, self._autopilot, self._modes, self._guidance
        self._commands = Commands(context, autopilot.commands)
        self._restart = Restart(context, autopilot.commands)
        self._parameters = Parameters(context, autopilot.parameters, equipment.simulation_control)
        gimbal = self._build_camera(equipment)
        own_commands = (
            OwnCommands(context, modes, self._system) if autopilot.commands.commands_devices else None
        )
        self._sticks = ManualControl(
            context, autopilot.setpoints, autopilot.modes, guidance, modes, self._is_ground_station
        )
        # A failsafe has the last word on the mode, so it ticks behind all that change it.
        services: list[object] = [
            context.texts,
            self._commands,
            self._parameters,
            ClockService(context, autopilot.commands.answers_ping),
            SigningKeys(self._signing),
            self._restart,
            Identity(context, autopilot.identity, autopilot.modes),
            Shell(context, autopilot.identity),
            EventService(context, autopilot.identity.event_names),
            self._build_file_transfer(),
            MissionProtocol(context, autopilot.missions, self._plans),
            self._home,
            self._setpoints,
            self._arming,
            self._sticks,
            FollowTargetService(context, guidance),
            Navigator(
                context,
                autopilot.commands,
                autopilot.modes,
                modes,
                guidance,
                self._boundary,
                autopilot.missions.guided_items,
            ),
            modes,
            self._build_mission_flight(gimbal, own_commands),
            self._fence,
            Health(context, autopilot.modes),
            MotorTest(context, autopilot.commands.motor_test_order),
            GroundTexts(context, autopilot.identity),
            self._battery,
            self._failsafe,
        ]
        services += self._build_calibration()
        services += [service for service in (gimbal, own_commands) if service]
        if equipment.break_part:
            failure_parameter = autopilot.safety.failure_parameter
            self._failure_injection = FailureInjection(
                context.parameters, failure_parameter, equipment.break_part, equipment.simulation_control
            )
            services.append(self._failure_injection)
        return [*services, *self._build_telemetry()]

    def _build_file_transfer(self) -> FileTransfer:
        identity = self._autopilot.identity
        metadata = identity.metadata.contents() if identity.metadata else {}
        files = ServedFiles(
            {**metadata, **identity.files(self._context.parameters)},
            identity.files_writable,
            identity.folders,
            identity.memory_card,
        )
        return FileTransfer(self._context, files, identity.file_sessions)

    def _build_calibration(self) -> list[object]:
        context = self._context
        if self._autopilot.identity.calibration is CalibrationProtocol.TEXTS:
            return [Calibration(context)]
        return [AccelerometerCalibration(context, self._commands), CompassCalibration(context)]

    def _build_mission_flight(self, gimbal: Gimbal | None, own_commands: OwnCommands | None) -> MissionFlight:
        context, policy, boundary = self._context, self._autopilot.missions, self._boundary
        modes, guidance = self._modes, self._guidance
        plan = MissionPlan(context, policy, boundary, self._plans)
        actions = ItemActions(
            context, policy, plan, modes, guidance, boundary, self._home, gimbal, self._camera, own_commands
        )
        mission_mode = self._autopilot.modes.mission
        return MissionFlight(context, policy, mission_mode, modes, guidance, plan, actions, self._arming.arm)

    def _build_camera(self, equipment: Equipment) -> Gimbal | None:
        """Add the camera where it is on the links; return its gimbal where it has one."""
        camera = equipment.camera
        if camera and camera.mavlink:
            self._camera = CameraComponent(self._context, camera, self._system)
        if camera and camera.gimbal:
            return Gimbal(self._context, self._autopilot.commands, math.radians(camera.tilt_deg))
        return None

    def _build_telemetry(self) -> list[object]:
        context, autopilot, battery = self._context, self._autopilot, self._battery
        attitude = AttitudeCache(context.flight)
        return [
            SystemTelemetry(
                context,
                autopilot.telemetry,
                autopilot.identity,
                autopilot.modes,
                battery,
                self._setpoints.fresh,
            ),
            MotionTelemetry(context, autopilot.telemetry, attitude),
            TargetTelemetry(context, autopilot.setpoints),
            SensorTelemetry(context, autopilot.telemetry, attitude),
            PowerTelemetry(context, autopilot.telemetry, battery, self._failsafe.charge_state),
            RemoteIdentification(context),
            Terrain(context),
        ]

    def _join(self, services: Sequence[object], truth: Stream | None) -> None:
        """Collect what the services tick, take, carry out, stream and answer."""
        # The truth is streamed only where the bench allows it: agents must not learn it otherwise.
        streams: dict[str, AnyStream] = {"HIL_STATE_QUATERNION": truth} if truth else {}
        answers: dict[str, MessageAnswer] = {}
        for service_streams in _methods(services, Service.streams):
            streams.update(service_streams())
        for service_answers in _methods(services, Service.answers):
            answers.update(service_answers())
        self._streams = Streams(self._context, self._autopilot.telemetry, streams, answers)
        services = [*services, self._streams]
        for method in _methods(services, Service.commands):
            self._commands.add(method())
        self._ticks = _methods(services, Service.tick)
        handlers = [method() for method in _methods(services, Service.handlers)]
        any_component = self._autopilot.commands.any_component
        self._router = MessageRouter(self._context.radio, self._system, any_component, handlers, self._camera)
        if self._autopilot.modes.heartbeat_on_change:
            self._modes.on_change.append(self._streams.send_heartbeat)

    def record_exposure(self, frame: int) -> None:
        """The scene has exposed a frame of the vehicle's camera."""
        if self._camera:
            self._camera.record_exposure(frame)

    def control(self) -> None:
        """Run messages, services and guidance of one step, and steer."""
        self._signing.follow(self._flight.unix_start_us + self._flight.time_ns // 1000)
        self._context.radio.begin()
        if self._autopilot.identity.texts_follow_answers:
            self._context.texts.keep()
        self._router.handle()
        if self.topics:
            self.topics.handle()
        self._context.texts.release()
        for tick in self._ticks:
            tick()
        if self._camera:
            self._camera.tick()
        while self._boot_texts and self._boot_texts[0].at_s <= self._flight.time_s:
            boot_text = self._boot_texts.pop(0)
            self._context.texts.send(boot_text.severity, boot_text.text)
        self._fly()

    def report(self) -> None:
        """Send everything that is due now, and everything that was queued during the step."""
        self._streams.send_due()
        self._context.radio.flush()
        if self.topics:
            self.topics.publish()

    def crash(self) -> None:
        """The vehicle has hit something: the rotors stop for good."""
        flight = self._flight
        if not flight.crashed:
            flight.crashed = True
            if flight.mode.behaviour is Behaviour.TERMINATE:
                # Stays armed, with rotors that do not turn.
                return
            self._arming.disarm(FlightEvent.CRASHED)

    def commands(self) -> frozenset[int]:
        """Numbers of the commands that a service carries out; the policy answers all others."""
        return self._commands.carried_out()

    def changed_parameters(self) -> dict[str, float]:
        """Parameters that differ from their defaults."""
        return self._context.parameters.changed()

    @property
    def restart_requested(self) -> bool:
        """Whether a restart was accepted; it is due at the end of the step."""
        return self._restart.requested

    def persistent_state(self) -> PersistentState:
        """What the next controller of the same vehicle starts with."""
        plans = {kind: plan.items for kind, plan in self._plans.by_type.items()}
        return PersistentState(self.changed_parameters(), plans, self._signing, self._counts())

    def continue_from(self, previous: Controller) -> None:
        """Answer what a companion has asked the previous controller of the same vehicle."""
        if isinstance(self.topics, ApTopics) and isinstance(previous.topics, ApTopics):
            self.topics.continue_from(previous.topics)

    def counters(self) -> dict[str, int]:
        """Messages that were dropped or made no sense, by name; since the first start."""
        links = [channel.link for channel in self.channels]
        return {
            **link_counters(links),
            **self._counts(),
            **{f"mavlink_{name}": self._signing.rejected[name] for name in sorted(self._signing.rejected)},
        }

    def _counts(self) -> dict[str, int]:
        counts = {
            "mavlink_malformed": self._router.malformed,
            "mavlink_unheard": self._router.unheard,
            "setpoints_ignored": self._setpoints.ignored,
            "simulation_refused": self._parameters.refused
            + (self._failure_injection.refused if self._failure_injection else 0),
        }
        return {name: count + self._previous_counts.get(name, 0) for name, count in counts.items()}

    def _update_limits(self) -> None:
        self._guidance.limits = self._autopilot.parameters.limits(self._context.parameters)

    def _is_ground_station(self, system: int) -> bool:
        return self._autopilot.safety.is_ground_station(system, self._context.parameters)

    def _disarm(self) -> None:
        self._arming.disarm(FlightEvent.DISARMED)

    def _fly(self) -> None:
        flight, airframe = self._flight, self._context.airframe
        if not flight.armed:
            self._liftoff.rest_disarmed()
        elif flight.mode.behaviour is _TERMINATE:
            airframe.disarm()
        else:
            target = self._fence.constrained(flight, self._guidance.target(flight))
            if self._liftoff.update(target):
                flight.target = target
                airframe.fly(target)
            else:
                airframe.rest()


def _methods(services: Sequence[object], method: Callable[[Any], R]) -> list[Callable[[], R]]:
    """A method of those services that have it."""
    # By its name: Python 3.11 takes 0.1 ms to tell whether a service fulfils a protocol, in 180 questions.
    bound_methods = (getattr(service, method.__name__, None) for service in services)
    return [bound_method for bound_method in bound_methods if bound_method is not None]
