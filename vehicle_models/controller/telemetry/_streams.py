"""Streams: which message goes out how often on which channel, and asking for one message once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bench.errors import Fault, SetupError

from .._service import Command, CommandHandler, Handler, Result, Sender
from .._service_context import ServiceContext
from ..links._frames import KINDS
from ..links._radio import Channel
from ._telemetry import Telemetry, Values

SET_INTERVAL, GET_INTERVAL, REQUEST_MESSAGE = 511, 510, 512
_NAMES = {kind.id: name for name, kind in KINDS.items()}
_HEARTBEAT = KINDS["HEARTBEAT"].id


@dataclass(slots=True)
class _Stream:
    number: int
    values: Callable[[], Values | None]
    interval_ns: int
    due_ns: int


class Streams:
    """The schedule of every channel. No rate exceeds the controller's own: a message goes out once a step at most."""

    def __init__(self, board: ServiceContext, telemetry: Telemetry) -> None:
        self._board = board
        self._telemetry = telemetry
        self._supported = {KINDS[name].id for name in board.personality.messages}
        self._order = {number: place for place, number in enumerate(telemetry.say)}
        self._streams: dict[str, list[_Stream]] = {}
        for channel in board.radio.channels:
            self._streams[channel.name] = []
            self._reset(channel)
        self._rates: dict[tuple[int, int], float] = {}  # of a channel's place and a group, as parameters have them
        self._rates_changed()
        board.parameters.on_change(self._rates_changed)
        self._extra: dict[int, Any] = {}
        self._after: list[tuple[Channel, int]] = []
        self._answers: list[tuple[Channel, str, dict[str, Any]]] = []  # said behind their acknowledgements

    def handlers(self) -> Mapping[str, Handler]:
        return {"REQUEST_DATA_STREAM": self._request_group}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {SET_INTERVAL: self._set, GET_INTERVAL: self._get, REQUEST_MESSAGE: self._request}

    def add_answers(self, answers: Mapping[str, Any]) -> None:
        """Messages that are said only on request: name -> function of the command that gives the fields, or None."""
        self._extra.update({KINDS[name].id: (name, fields) for name, fields in answers.items()})

    def add(self, name: str, values: Callable[[], Values | None], hz: float | None = None) -> None:
        """A message beside the personality's own; streamed at once where `hz` is given, but for links that want nothing."""
        number = KINDS[name].id
        self._telemetry.say[number] = values
        self._order[number] = len(self._order)
        self._supported.add(number)
        for channel in self._board.radio.channels:
            if hz and self._board.personality.stream_sets[channel.link.spec.streams]:
                self._put(channel, number, round(1e9 / hz))

    def say_due(self) -> None:
        """Queue everything that is due, channel by channel, in one fixed order of messages."""
        now = self._board.flight.time_ns
        for channel in self._board.radio.channels:
            if not channel.connected:
                continue
            for stream in self._streams[channel.name]:
                if stream.due_ns <= now:
                    stream.due_ns += stream.interval_ns
                    if stream.due_ns <= now:  # asked for more than the controller's rate, or nobody was there
                        stream.due_ns = now + 1
                    values = stream.values()
                    if values is not None:
                        channel.say(stream.number, values)
        for channel, number in self._after:
            values = self._telemetry.say[number]()
            if values is not None:
                channel.say(number, values)
        self._after.clear()
        for channel, name, fields in self._answers:
            channel.tell(name, **fields)
        self._answers.clear()

    def heartbeat_now(self) -> None:
        """Send a heartbeat with this step, behind what is being answered, beside those that are due."""
        self._after += [(channel, _HEARTBEAT) for channel in self._board.radio.channels]

    def _reset(self, channel: Channel) -> None:
        sets, wanted = self._board.personality.stream_sets, channel.link.spec.streams
        if wanted not in sets:
            raise SetupError(Fault(f"link {channel.name}", f"there is no stream set {wanted!r}", f"there are {', '.join(sets)}"))
        rates = {"HEARTBEAT": 1.0, **sets[wanted]}
        for name, hz in rates.items():
            self._put(channel, KINDS[name].id, round(1e9 / hz))

    def _default_ns(self, channel: Channel, number: int) -> int | None:
        hz = self._board.personality.stream_sets[channel.link.spec.streams].get(_NAMES[number])
        if hz is None:
            place = self._board.radio.channels.index(channel)
            for group, names in self._board.personality.stream_groups.items():
                if _NAMES[number] in names:
                    hz = self._rates.get((place, group))
        return round(1e9 / hz) if hz else 1_000_000_000 if number == _HEARTBEAT else None

    def _rates_changed(self) -> None:
        """Follow the parameters that hold the rates of groups, where there are such."""
        for suffix, group in self._board.personality.stream_parameters.items():
            for place, channel in enumerate(self._board.radio.channels):
                name = f"SR{place}_{suffix}"
                if name not in self._board.parameters.kinds:
                    continue
                hz = max(self._board.parameters[name], 0.0)
                if self._rates.get((place, group), 0.0) != hz:
                    self._rates[place, group] = hz
                    self._put_group(channel, group, hz)

    def _put_group(self, channel: Channel, group: int, hz: float) -> None:
        for name in self._board.personality.stream_groups.get(group, ()):
            self._put(channel, KINDS[name].id, round(1e9 / hz) if hz > 0.0 else None)

    def _put(self, channel: Channel, number: int, interval_ns: int | None) -> None:
        """Change one rate; None stops it."""
        streams = [one for one in self._streams[channel.name] if one.number != number]
        if interval_ns is not None:
            most_hz = self._board.personality.slowest_hz.get(_NAMES[number])
            interval_ns = max(interval_ns, round(1e9 / most_hz)) if most_hz else interval_ns
            due_ns = self._board.flight.time_ns + min(interval_ns, 1_000_000_000)
            streams.append(_Stream(number, self._telemetry.say[number], interval_ns, due_ns))
        streams.sort(key=lambda one: self._order[one.number])
        self._streams[channel.name] = streams

    def _set(self, command: Command) -> Result | None:
        number, interval_us = _whole(command.params[0]), command.params[1]
        personality = self._board.personality
        if number not in self._supported or interval_us != interval_us:
            return self._not_known(number)
        if 0 < interval_us < personality.bad_interval_us:
            return Result.DENIED
        channel = command.sender.channel
        if interval_us < 0:
            self._put(channel, number, None)
        elif interval_us == 0:
            self._put(channel, number, self._default_ns(channel, number))
        else:
            self._put(channel, number, round(min(interval_us, 1e9) * 1000.0))
        return Result.ACCEPTED

    def _not_known(self, number: int) -> Result:
        personality = self._board.personality
        if personality.unknown_interval_text:
            severity, text = personality.unknown_interval_text
            self._board.texts.say(severity, text.format(number))
        return personality.unknown_interval

    def _get(self, command: Command) -> Result | None:
        number = _whole(command.params[0])
        found = [one for one in self._streams[command.sender.channel.name] if one.number == number]
        known = number in self._supported
        interval_us = found[0].interval_ns // 1000 if found else -1 if known else 0
        command.sender.channel.tell("MESSAGE_INTERVAL", message_id=min(max(number, 0), 65535), interval_us=interval_us)
        return Result.ACCEPTED if known else self._board.personality.unknown_get_interval

    def _request(self, command: Command) -> Result | None:
        number, channel = _whole(command.params[0]), command.sender.channel
        if number in self._extra:
            name, fields_of = self._extra[number]
            fields = fields_of(command)
            if fields is None:
                return self._board.personality.unknown_request
            for one in fields if isinstance(fields, list) else [fields]:
                if self._board.personality.answers_after_ack:
                    self._answers.append((channel, name, one))
                else:
                    channel.tell(name, **one)
            return Result.ACCEPTED
        if number in self._supported:
            self._after.append((channel, number))
            return Result.ACCEPTED
        if number in self._board.personality.promised_messages:
            return Result.ACCEPTED
        return self._board.personality.unknown_request

    def _request_group(self, message: Any, sender: Sender) -> None:
        """REQUEST_DATA_STREAM: group 0 is all of them. Personalities without groups do not hear it."""
        personality, channel = self._board.personality, sender.channel
        place = self._board.radio.channels.index(channel)
        hz = float(message.req_message_rate) if message.start_stop else 0.0
        for group in personality.stream_groups if message.req_stream_id == 0 else (message.req_stream_id,):
            self._put_group(channel, group, hz)
            self._rates[place, group] = hz
            for suffix, its in personality.stream_parameters.items():
                name = f"SR{place}_{suffix}"
                if its == group and name in self._board.parameters.kinds:
                    self._board.parameters.put(name, hz, saves=False)


def _whole(value: float) -> int:
    """A message id out of a float; -1 for what is none."""
    return int(value) if value == value and 0 <= value < 2**24 else -1
