"""Takes the samples and notes of flight logs."""

from __future__ import annotations

from typing import Protocol

from ..policies._identity import IdentityPolicy
from ..policies._logs import LogPolicy
from ..state._flight_state import GpsQuality, ReferencePoint
from ..state._log_records import LoggedHome, LoggedParameter, LoggedText, LogOpening, Note, pack_sample
from ..state._service_context import ServiceContext
from ..telemetry._battery_monitor import BatteryMonitor
from ._storage import FlightLog, LogStorage

# Ten samples a second; PX4 logs positions as often by default.
_PERIOD_NS = 100_000_000
# How much is recorded between two looks at the room that is left.
_ROOM_CHECK_BYTES = 1 << 20


class LogSink(Protocol):
    """What records go to: a log, or a stream."""

    def add_sample(self, packed: bytes, time_us: int) -> None: ...

    def add_note(self, note: Note) -> None: ...


class FlightRecorder:
    """Records a flight log whenever the policy wants one, and feeds streams.

    Nothing is written until a client asks for it, because most sessions never do. A sample takes 2.4 us of CPU time,
    so a second of flight 33 us with the ticks between: 1 % of a vehicle that streams nothing, 0.5 % of one with PX4's
    onboard streams (3.1 and 6.2 ms a second on the same core).
    """

    def __init__(
        self,
        context: ServiceContext,
        policy: LogPolicy,
        identity: IdentityPolicy,
        gps: GpsQuality,
        battery: BatteryMonitor,
        storage: LogStorage,
    ) -> None:
        self._flight = context.flight
        self._parameters = context.parameters
        self._policy = policy
        self._vehicle_type = identity.vehicle_type
        self._gps = gps
        self._battery = battery
        self._storage = storage
        self._definitions = tuple(context.parameters.definitions.values())
        self._values = self._current_values()
        self._log: FlightLog | None = None
        self._sinks: list[LogSink] = []
        self._wanted = self._armed = self._flown = False
        # The first tick decides whether the start is logged.
        self._unsettled = self._parameters_changed = True
        self._home: ReferencePoint | None = None
        self._due_ns = 0
        self._room_check_bytes = _ROOM_CHECK_BYTES
        # Of this step: the text about arming comes before the log that arming begins.
        self._texts: list[LoggedText] = []
        context.parameters.on_change(self._note_parameters)
        context.texts.text_listeners.append(self._note_text)

    def tick(self) -> None:
        flight = self._flight
        if flight.armed is not self._armed or self._unsettled:
            self._update()
        if self._sinks and flight.time_ns >= self._due_ns:
            self._take_sample()
        if self._texts:
            self._texts.clear()

    def erase(self) -> None:
        """Forget all logs. One that is being recorded goes too, and the policy says whether another begins."""
        self._storage.erase()
        self._detach()
        self._log = None
        self._wanted = self._wanted and not self._policy.new_after_erase
        self._unsettled = True

    def opening(self) -> LogOpening:
        """What holds now, for a log that begins."""
        flight = self._flight
        # What has changed since the last sample still belongs to a log that is being recorded.
        self._compare_parameters()
        return LogOpening(
            time_us=flight.time_us,
            boot_utc_us=flight.unix_start_us,
            origin=flight.origin,
            vehicle_type=self._vehicle_type,
            gps=self._gps,
            parameters=self._definitions,
            values=self._values,
        )

    def attach(self, sink: LogSink) -> None:
        """Feed `sink` from now on."""
        if not self._sinks:
            self._due_ns, self._home = self._flight.time_ns, self._flight.home
        self._sinks.append(sink)
        if self._flight.home:
            sink.add_note(LoggedHome(self._flight.time_us, self._flight.home))

    def detach(self, sink: LogSink) -> None:
        if sink in self._sinks:
            self._sinks.remove(sink)

    def _update(self) -> None:
        flight = self._flight
        self._unsettled, self._armed = False, flight.armed
        self._flown = self._flown or flight.armed
        wanted = self._policy.records(flight, self._parameters, self._flown)
        if wanted == self._wanted:
            return
        self._wanted = wanted
        if wanted:
            self._begin()
        else:
            if self._log:
                # The last moment is the one at which the vehicle was disarmed.
                self._take_sample()
            self._detach()
            if self._policy.new_for_each_flight(self._parameters):
                self._log = None

    def _begin(self) -> None:
        if self._log is None:
            self._log = FlightLog(self.opening(), self._policy.encoder)
            self._storage.begin(self._log)
            self._storage.make_room()
            self._room_check_bytes = _ROOM_CHECK_BYTES
        self.attach(self._log)
        for text in self._texts:
            self._log.add_note(text)

    def _detach(self) -> None:
        if self._log:
            self.detach(self._log)

    def _take_sample(self) -> None:
        flight = self._flight
        self._due_ns = flight.time_ns + _PERIOD_NS
        if self._parameters_changed:
            self._compare_parameters()
        if flight.home is not self._home:
            self._home = flight.home
            if flight.home:
                self._add_note(LoggedHome(flight.time_us, flight.home))
        packed = pack_sample(flight, self._battery.volts(), self._battery.used_mah())
        for sink in self._sinks:
            sink.add_sample(packed, flight.time_us)
        if self._log and self._log.recorded_bytes > self._room_check_bytes:
            self._room_check_bytes += _ROOM_CHECK_BYTES
            if not self._storage.make_room():
                # The memory card is full.
                self._detach()

    def _add_note(self, note: Note) -> None:
        for sink in self._sinks:
            sink.add_note(note)

    def _note_text(self, severity: int, text: str) -> None:
        note = LoggedText(self._flight.time_us, severity, text)
        self._texts.append(note)
        self._add_note(note)

    def _note_parameters(self) -> None:
        # Compared once a sample: a client that writes a thousand parameters must not cost a thousand comparisons.
        self._parameters_changed = self._unsettled = True

    def _compare_parameters(self) -> None:
        self._parameters_changed = False
        previous, self._values = self._values, self._current_values()
        for parameter, old, new in zip(self._definitions, previous, self._values, strict=True):
            if old != new:
                self._add_note(LoggedParameter(self._flight.time_us, parameter, new))

    def _current_values(self) -> tuple[float, ...]:
        return tuple(self._parameters.values())
