"""STATUSTEXT: what the autopilot reports in words, and the events of PX4 that go with the words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from ..links._enums import MAV_TYPE
from ..links._radio import Channel, Radio
from ._flight_state import FlightState
from ._service import CommandResult, MessageHandler, MessageSender, Refusal

StatusText = tuple[int, str]
"""A text with its MAV_SEVERITY."""

SEVERITIES = ("EMERGENCY", "ALERT", "CRITICAL", "ERROR", "WARNING", "NOTICE", "INFO", "DEBUG")
EMERGENCY, _ALERT, CRITICAL, ERROR, WARNING, NOTICE, INFO, DEBUG = range(len(SEVERITIES))
_CHUNK_BYTES = 50
# In the numbers of PX4's events.
_EVENT_COMPONENT = 1


class FlightEvent(Enum):
    """Moments at which an autopilot may send a text."""

    ARMED = auto()
    DISARMED = auto()
    DISARMED_BY_LANDING = auto()
    DISARMED_IDLE = auto()
    TAKEOFF_DEFAULT = auto()
    TAKEOFF_RAISED = auto()
    TAKEOFF_BELOW = auto()
    TAKEOFF_DETECTED = auto()
    LANDING_DETECTED = auto()
    LANDING = auto()
    RETURNING = auto()
    RETURN_BEGINS = auto()
    RETURN_LANDS = auto()
    TERMINATED = auto()
    PILOT_TOOK_OVER = auto()
    CRASHED = auto()


@dataclass(frozen=True, slots=True)
class EventName:
    """An event that goes with every text beginning with `text`."""

    text: str
    name: str

    @property
    def number(self) -> int:
        """The component, and the low 24 bits of the FNV-1a hash of the name."""
        digest = 0x811C9DC5
        for byte in self.name.encode():
            digest = (digest ^ byte) * 0x01000193 & 0xFFFFFFFF
        return _EVENT_COMPONENT << 24 | digest & 0xFFFFFF


@dataclass(eq=False)
class Texts:
    """Sends texts; long ones in chunks with one id, as the specification asks.

    `by_event` are the autopilot's texts for moments of the flight. `ending` is put behind every text: PX4
    ends a text that is an event as well with a tab. `for_stations_s` sends them only over channels on which a heartbeat
    of a ground station was heard within that time; None over all.
    """

    _radio: Radio
    _flight: FlightState
    _by_event: Mapping[FlightEvent, StatusText]
    _ending: str
    _for_stations_s: float | None = None
    _stations_s: dict[str, float] = field(default_factory=dict)  # when a channel's station was heard last
    _id: int = 0
    _kept: list[StatusText] | None = None  # while they are kept back
    listeners: list[Callable[[int, str], None]] = field(default_factory=list)

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {} if self._for_stations_s is None else {"HEARTBEAT": self._take_heartbeat}

    def _take_heartbeat(self, m: Any, sender: MessageSender) -> None:
        if m.type == MAV_TYPE.GCS:
            self._stations_s[sender.channel.name] = self._flight.time_s

    def _is_read(self, channel: Channel) -> bool:
        # Nobody can say anything on a link that is not heard, and whoever looks on there is to see something.
        if self._for_stations_s is None or not channel.link.spec.heard:
            return True
        heard_s = self._stations_s.get(channel.name)
        return heard_s is not None and self._flight.time_s - heard_s <= self._for_stations_s

    def notify(self, severity: int, text: str) -> None:
        """Tell the listeners of an event that has no text on the links."""
        for listener in self.listeners:
            listener(severity, text)

    def announce(self, event: FlightEvent, *values: float) -> None:
        """Send the text of an event, with `values` in its braces; nothing where there is none."""
        self.report(self._by_event.get(event), *values)

    def report(self, status_text: StatusText | None, *values: float | str) -> None:
        """Send a text with `values` in its braces; nothing where the autopilot has no such text."""
        if status_text:
            severity, text = status_text
            self.send(severity, text.format(*values) if values else text)

    def send_all(self, texts: Iterable[StatusText]) -> None:
        for severity, text in texts:
            self.send(severity, text)

    def refuse(self, refusal: Refusal) -> CommandResult | None:
        """Send the texts of a refusal; returns its result."""
        self.send_all(refusal.texts)
        return refusal.result

    def send(self, severity: int, text: str) -> None:
        self.notify(severity, text)
        if self._kept is None:
            self._broadcast(severity, text)
        else:
            self._kept.append((severity, text))

    def keep(self) -> None:
        """Keep texts back until they are released."""
        self._kept = []

    def release(self) -> None:
        """Send the texts that were kept back, and further ones at once."""
        kept, self._kept = self._kept or [], None
        for severity, text in kept:
            self._broadcast(severity, text)

    def _broadcast(self, severity: int, text: str) -> None:
        data = (text + self._ending).encode("ascii", "replace")
        chunks = [data[start : start + _CHUNK_BYTES] for start in range(0, len(data), _CHUNK_BYTES)]
        text_id = 0
        if len(chunks) > 1:
            self._id = text_id = self._id % 0xFFFF + 1
        for number, chunk in enumerate(chunks):
            self._radio.broadcast(
                "STATUSTEXT", self._is_read, severity=severity, text=chunk, id=text_id, chunk_seq=number
            )
