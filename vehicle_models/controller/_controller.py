"""The flight controller: takes what came in, lets every service do its work, flies, and says what is due."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from bench.contracts import MavlinkTap

from ._flight import Airframe, Behaviour, Flight, Landed, Target
from ._personality import Event, Personality
from ._service import Handler, Sender, Service, Ticking
from ._service_context import ServiceContext
from .files._files import Files
from .files._ftp import FileTransfer
from .guidance._guidance import Guidance
from .guidance._land_detector import LandDetector
from .guidance._manoeuvres import Manoeuvres, Takeoff
from .links._frames import KINDS, Decoder, Packer, message_id, sender
from .links._links import Link
from .links._radio import Channel, Radio
from .links._signing import open_signing
from .missions._mission_flight import MissionFlight
from .missions._protocol import MissionProtocol
from .missions._store import Plans
from .parameters._parameters import Parameters
from .parameters._store import ParameterStore
from .payload._camera import CameraComponent
from .payload._equipment import Equipment
from .payload._gimbal import Gimbal
from .safety._failsafe import Failsafe
from .safety._failure_injection import FailureInjection
from .safety._fence import Fence, Rally
from .safety._health import Health
from .safety._simulated_battery import SimulatedBattery
from .services._arming import Arming
from .services._clock import Clock
from .services._commands import Commands
from .services._follow_me import FollowMe
from .services._home import HomeKeeper
from .services._identity import Identity
from .services._manual import Manual
from .services._modes import Modes
from .services._motor_test import MotorTest
from .services._navigator import Navigator
from .services._restart import Kept, Restart
from .services._setpoints import Setpoints
from .services._signing_keys import SigningKeys
from .telemetry._events import Events
from .telemetry._ground_texts import GroundTexts
from .telemetry._streams import Streams
from .telemetry._telemetry import Telemetry
from .telemetry._texts import Texts

COMPONENT = 1


class Controller:
    """One flight controller on its links. `receive`, then `control`, then (after the physics) `report`, once a step."""

    def __init__(
        self,
        personality: Personality,
        flight: Flight,
        airframe: Airframe,
        links: Sequence[Link],
        given: Mapping[str, float],
        tap: MavlinkTap | None = None,
        manoeuvres: Manoeuvres | None = None,
        payload: Equipment | None = None,
        kept: Kept | None = None,
    ) -> None:
        parameters = ParameterStore(personality.parameters, kept.parameters if kept else given)
        self._system = min(max(int(parameters[personality.system_parameter]), 1), 255)
        packer = Packer(self._system, COMPONENT)
        self._signing = kept.signing if kept else open_signing([link.spec for link in links], flight.unix_start_us)
        self._earlier = kept.counts if kept else {}
        self._flight = flight
        self._tap = tap
        self.channels = [Channel(link, packer, self._signing, number) for number, link in enumerate(links)]
        radio = Radio(self.channels, tap, personality.speaks_when_spoken_to)
        texts = Texts(radio, personality.text_ending)
        self._board = board = ServiceContext(flight, airframe, personality, radio, texts, parameters)
        self._guidance = Guidance(flight, personality.limits(parameters), manoeuvres)
        parameters.on_change(self._limits_changed)
        self._setpoints = Setpoints(board, self._guidance)
        modes = Modes(board, self._guidance, self._setpoints.fresh)
        home = HomeKeeper(board)
        self._arming = Arming(board, modes, self._guidance, home, self._setpoints.fresh)
        telemetry = Telemetry(board)
        telemetry.has_setpoints = self._setpoints.fresh
        self._streams = Streams(board, telemetry)
        if personality.heartbeat_on_mode_change:
            modes.on_change.append(self._streams.heartbeat_now)
        identity = Identity(board)
        self._streams.add_answers(identity.answers())
        events = Events(board, personality.event_names)
        telemetry.event_sequence = lambda: events.sequence
        files = FileTransfer(board, Files(personality.files(parameters), personality.files_writable), personality.file_sessions)
        commands = Commands(board)
        navigator = Navigator(board, modes, self._guidance)
        telemetry.orbit = navigator.orbit_status
        failsafe = Failsafe(board, modes, self._setpoints, lambda: self._arming.disarm(Event.DISARMED))
        telemetry.charge_state = failsafe.charge_state
        plans = Plans()
        restart = Restart(board)
        self._fence = fence = Fence(board, modes, failsafe, plans)
        self._guidance.refuge = Rally(board, plans).refuge
        camera = payload.camera if payload else None
        gimbal = Gimbal(board, math.radians(camera.tilt_deg)) if camera and camera.gimbal else None
        self._camera = CameraComponent(board, camera, self._system) if camera and camera.mavlink else None
        missions = MissionFlight(board, modes, self._guidance, plans, self._arming.arm, gimbal, self._camera)
        telemetry.mission_current, telemetry.fence_status = missions.current, fence.status
        self._plans, self._restart = plans, restart
        # The order of this list is the order in which services work; a failsafe has the last word.
        self._services: list[Service] = [
            commands,
            Parameters(board),
            Clock(board),
            SigningKeys(self._signing),
            restart,
            identity,
            events,
            files,
            MissionProtocol(board, plans),
            home,
            self._setpoints,
            self._arming,
            Manual(board, self._guidance, modes),
            FollowMe(board, self._guidance),
            navigator,
            modes,
            missions,
            self._streams,
            fence,
            Health(board),
            MotorTest(board),
            GroundTexts(board),
            SimulatedBattery(board),
            failsafe,
        ]
        if payload:
            self._carry(payload, gimbal)
        self._ticks = [service.tick for service in self._services if isinstance(service, Ticking)]
        self._handlers: dict[int, list[Handler]] = {}
        for service in self._services:
            commands.add(service.commands())
            for name, handler in service.handlers().items():
                self._handlers.setdefault(KINDS[name].id, []).append(handler)
        if kept:
            for kind, items in kept.plans.items():
                plans.by_type[kind].put(items)
        self._boot = list(personality.boot_texts(flight))
        self._decoder = Decoder()
        self._detector = LandDetector()
        self._unheard = 0

    def _carry(self, payload: Equipment, gimbal: Gimbal | None) -> None:
        """Services of what the vehicle carries, and of what the bench allows."""
        board = self._board
        if gimbal:
            self._services.append(gimbal)
            self._streams.add_answers(gimbal.answers())
            for name, values in gimbal.streams().items():
                self._streams.add(name, values, board.personality.gimbal_streams.get(name))
        if payload.truth:
            self._streams.add("HIL_STATE_QUATERNION", payload.truth)
        if payload.break_part:
            self._services.append(FailureInjection(board, payload.break_part))

    def record_exposure(self, frame: int) -> None:
        """The scene has made a frame of the vehicle's camera."""
        if self._camera:
            self._camera.record_exposure(frame)

    def receive(self) -> None:
        """Move what waits in the sockets to the inboxes."""
        for channel in self.channels:
            channel.link.poll()

    def control(self) -> Target | None:
        """Messages, services and guidance of one step; the target flown, or None on the ground."""
        self._signing.follow(self._flight.unix_start_us + self._flight.time_ns // 1000)
        self._board.radio.begin()
        for channel in self.channels:
            if channel.link.inbox:
                self._hear(channel)
        for tick in self._ticks:
            tick()
        if self._camera:
            self._camera.tick()
        while self._boot and self._boot[0][0] <= self._flight.time_s:
            _, severity, text = self._boot.pop(0)
            self._board.texts.say(severity, text)
        return self._fly()

    def report(self) -> None:
        """Everything that is due at the present moment, and everything said during the step, out to the links."""
        self._streams.say_due()
        self._board.radio.flush()

    def crash(self) -> None:
        """The vehicle has hit something: the rotors stop for good."""
        flight = self._flight
        if not flight.crashed:
            flight.crashed = True
            if flight.mode.behaviour is Behaviour.TERMINATE:
                return  # stays armed, with rotors that do not turn
            self._arming.disarm(Event.CRASHED)

    def changed_parameters(self) -> dict[str, float]:
        """Parameters that differ from their defaults."""
        return self._board.parameters.changed()

    @property
    def wants_restart(self) -> bool:
        """Whether a restart was accepted; it is due when the acknowledgement has gone out."""
        return self._restart.wanted

    def kept(self) -> Kept:
        """What the controller that begins after this one starts with."""
        plans = {kind: plan.items for kind, plan in self._plans.by_type.items()}
        return Kept(self.changed_parameters(), plans, self._signing, self._counts())

    def counters(self) -> dict[str, int]:
        """What was dropped or had no sense, by name; since the first start."""
        links = [channel.link for channel in self.channels]
        return {
            "mavlink_garbage_bytes": sum(link.garbage_bytes for link in links),
            "mavlink_dropped": sum(link.dropped for link in links),
            **self._counts(),
            **{f"mavlink_{name}": self._signing.rejected[name] for name in sorted(self._signing.rejected)},
        }

    def _counts(self) -> dict[str, int]:
        own = {
            "mavlink_malformed": self._decoder.malformed,
            "mavlink_unheard": self._unheard,
            "setpoints_ignored": self._setpoints.ignored,
        }
        return {name: count + self._earlier.get(name, 0) for name, count in own.items()}

    def _limits_changed(self) -> None:
        self._guidance.limits = self._board.personality.limits(self._board.parameters)

    def _hear(self, channel: Channel) -> None:
        frames = channel.take()
        if self._tap and frames:
            self._tap(channel.name, "from_agent", b"".join(frames))
        for frame in frames:
            if channel.admits(frame):
                self._hear_frame(channel, frame)

    def _hear_frame(self, channel: Channel, frame: bytes) -> None:
        handlers = self._handlers.get(message_id(frame))
        message = self._decoder.decode(frame) if handlers else None
        if self._camera and message is not None and self._camera.takes(message, self._system):
            self._camera.hear(message, Sender(*sender(frame), channel))
            return
        for_us = message is None or _addressed(message, self._system, self._board.personality.any_component)
        for_us_alone = message is not None and for_us and message_target(message) == self._system
        if not for_us_alone:
            for other in self.channels:
                if other is not channel:
                    other.forward(frame)
        if message is None or not handlers:
            self._unheard += 1
            return
        if for_us:
            said_by = Sender(*sender(frame), channel)
            for handler in handlers:
                handler(message, said_by)

    def _fly(self) -> Target | None:
        flight, airframe = self._flight, self._board.airframe
        if not flight.armed:
            if flight.on_ground:
                flight.landed = Landed.ON_GROUND  # disarmed by force just above it, say
            return None
        if flight.mode.behaviour is Behaviour.TERMINATE:
            airframe.disarm()
            return None
        target = self._fence.held(flight, self._guidance.target(flight))
        if not self._off_the_ground(target):
            airframe.rest()
            return None
        flight.target = target
        airframe.fly(target)
        return target

    def _off_the_ground(self, target: Target) -> bool:
        """Keep account of lifting off and coming down; whether the vehicle flies during the next step."""
        if self._flight.flying:
            self._watch_ground(target)
        elif self._detector.wants_off(self._flight, target):
            self._lift_off()
        return self._flight.flying

    def _lift_off(self) -> None:
        flight, personality = self._flight, self._board.personality
        flight.landed = Landed.TAKING_OFF
        self._detector = LandDetector()
        self._arming.lifted()
        if Event.TAKEOFF_DETECTED in personality.texts:
            self._board.texts.say(*personality.texts[Event.TAKEOFF_DETECTED])

    def _watch_ground(self, target: Target) -> None:
        """Follow the way from lifting off to having landed."""
        flight, manoeuvre = self._flight, self._guidance.manoeuvre
        if self._detector.landed(flight, target):
            flight.landed = Landed.ON_GROUND
            if Event.LANDING_DETECTED in self._board.personality.texts:
                self._board.texts.say(*self._board.personality.texts[Event.LANDING_DETECTED])
            self._arming.landed()
        elif self._guidance.landing:
            flight.landed = Landed.LANDING
        elif flight.landed is Landed.TAKING_OFF:
            rising = isinstance(manoeuvre, Takeoff)
            if manoeuvre.done(flight) if rising else flight.height_m > 0.5:
                flight.landed = Landed.IN_AIR
                if rising and flight.mode.behaviour is Behaviour.FOLLOW and not self._board.personality.takeoff_mode:
                    self._guidance.begin(Behaviour.FOLLOW, flight)
        elif flight.landed is Landed.LANDING:
            flight.landed = Landed.IN_AIR


def message_target(message: Any) -> int:
    """The system that a message is for; 0 for everybody, also where the message names nobody."""
    system: int = getattr(message, "target_system", 0) or getattr(message, "target", 0)
    return system


def _addressed(message: Any, own: int, any_component: bool) -> bool:
    """Whether a message is for this vehicle: its system, or every system; its autopilot, or every component."""
    system = message_target(message)
    component = getattr(message, "target_component", 0)
    return system in (0, own) and (system == 0 or any_component or component in (0, COMPONENT))
