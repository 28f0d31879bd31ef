"""Streams: which message goes out how often on which channel, and requests for a single message."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench.errors import SetupError

from ..links._enums import MAV_CMD, MAV_DATA_STREAM
from ..links._frames import KINDS, MESSAGE_NAMES
from ..links._radio import Channel
from ..policies._tables import SENDING_ORDER
from ..policies._telemetry import TelemetryPolicy
from ..state._service import (
    AnyStream,
    ChannelStream,
    Command,
    CommandHandler,
    CommandResult,
    Fields,
    HalfwayStream,
    MessageAnswer,
    MessageHandler,
    MessageSender,
    Stream,
)
from ..state._service_context import ServiceContext

_HEARTBEAT = KINDS["HEARTBEAT"].id
_SECOND_NS = 1_000_000_000

_ORDER = {KINDS[name].id: position for position, name in enumerate(SENDING_ORDER)}
# Known to every autopilot whose vehicle carries the equipment.
_EQUIPMENT_MESSAGES = frozenset(
    {"GIMBAL_DEVICE_ATTITUDE_STATUS", "GIMBAL_MANAGER_STATUS", "HIL_STATE_QUATERNION"}
)


@dataclass(slots=True)
class _MessageStream:
    number: int
    values: Stream
    interval_ns: int
    due_ns: int
    halfway: Stream | None  # sent before it with every step


class Streams:
    """The schedule of every channel. A message goes out once a step at most, so no rate exceeds the controller's own;
    but for the attitude, which goes out twice.

    `streams` and `answers` are what all services declare: messages to stream, and messages that come on
    request only.
    """

    def __init__(
        self,
        context: ServiceContext,
        policy: TelemetryPolicy,
        streams: Mapping[str, AnyStream],
        answers: Mapping[str, MessageAnswer],
    ) -> None:
        self._context = context
        self._policy = policy
        self._values = {KINDS[name].id: values for name, values in streams.items()}
        self._supported = {
            KINDS[name].id for name in streams if name in policy.messages | _EQUIPMENT_MESSAGES
        }
        self._silent = {KINDS[name].id for name in policy.silent_messages if name in KINDS} - self._supported
        self._silent_intervals_us: dict[tuple[str, int], int] = {}  # by channel and message
        self._answers = {KINDS[name].id: (name, answer) for name, answer in answers.items()}
        self._half_step_ns = round(0.5e9 * context.flight.step_s)
        self._schedules: dict[str, list[_MessageStream]] = {}  # by channel, in sending order
        for channel in context.radio.channels:
            self._schedules[channel.name] = []
            self._start(channel)
        self._group_rates: dict[tuple[int, int], float] = {}  # by channel index and group
        self._parameters_changed()
        context.parameters.on_change(self._parameters_changed)
        self._requested: list[tuple[Channel, int]] = []
        self._late_answers: list[tuple[Channel, str, Fields]] = []  # sent behind their acknowledgements

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"REQUEST_DATA_STREAM": self._request_group}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {
            MAV_CMD.SET_MESSAGE_INTERVAL: self._set_interval,
            MAV_CMD.GET_MESSAGE_INTERVAL: self._get_interval,
            MAV_CMD.REQUEST_MESSAGE: self._request_message,
        }

    def send_due(self) -> None:
        """Queue everything that is due, channel by channel."""
        now_ns = self._context.flight.time_ns
        for channel in self._context.radio.channels:
            if not channel.connected:
                continue
            for stream in self._schedules[channel.name]:
                if stream.due_ns <= now_ns:
                    stream.due_ns += stream.interval_ns
                    # Too fast for the controller, or no client was there: a backlog is dropped.
                    if stream.due_ns <= now_ns:
                        stream.due_ns = now_ns + 1
                    if stream.halfway and (values := stream.halfway()) is not None:
                        channel.send(stream.number, values)
                    values = stream.values()
                    if values is not None:
                        channel.send(stream.number, values)
        for channel, number in self._requested:
            values = self._values_of(channel, number)()
            if values is not None:
                channel.send(number, values)
        self._requested.clear()
        for channel, name, fields in self._late_answers:
            channel.send_message(name, **fields)
        self._late_answers.clear()

    def send_heartbeat(self) -> None:
        """Send a heartbeat with this step, behind the answers and beside those that are due."""
        # Behind the acknowledgement of the command that changed the mode, as on ArduPilot.
        self._requested += [(channel, _HEARTBEAT) for channel in self._context.radio.channels]

    def _start(self, channel: Channel) -> None:
        sets, name = self._policy.stream_sets, channel.link.spec.streams
        if name not in sets:
            raise SetupError(
                f"link {channel.name}", f"there is no stream set {name!r}", f"there are {', '.join(sets)}"
            )
        rates = {"HEARTBEAT": 1.0, **sets[name]}
        # A link without streams gets none of the gimbal either.
        if sets[name]:
            gimbal = self._policy.gimbal_rates_hz.items()
            rates |= {message: hz for message, hz in gimbal if KINDS[message].id in self._values}
        for message, hz in rates.items():
            self._schedule(channel, KINDS[message].id, round(1e9 / hz))

    def _default_interval_ns(self, channel: Channel, number: int) -> int | None:
        hz = self._policy.stream_sets[channel.link.spec.streams].get(MESSAGE_NAMES[number])
        if hz is None:
            index = self._context.radio.channels.index(channel)
            for group, names in self._policy.stream_groups.items():
                if MESSAGE_NAMES[number] in names:
                    hz = self._group_rates.get((index, group))
        return round(1e9 / hz) if hz else _SECOND_NS if number == _HEARTBEAT else None

    def _parameters_changed(self) -> None:
        """Follow the parameters that hold the rates of groups, where there are such parameters."""
        for suffix, group in self._policy.stream_parameters.items():
            for index, channel in enumerate(self._context.radio.channels):
                name = f"SR{index}_{suffix}"
                if name not in self._context.parameters.kinds:
                    continue
                hz = max(self._context.parameters[name], 0.0)
                if self._group_rates.get((index, group), 0.0) != hz:
                    self._group_rates[index, group] = hz
                    self._schedule_group(channel, group, hz)

    def _schedule_group(self, channel: Channel, group: int, hz: float) -> None:
        for name in self._policy.stream_groups.get(group, ()):
            self._schedule(channel, KINDS[name].id, round(1e9 / hz) if hz > 0.0 else None)

    def _schedule(self, channel: Channel, number: int, interval_ns: int | None) -> None:
        """Change the interval of one message; None stops it."""
        streams = [stream for stream in self._schedules[channel.name] if stream.number != number]
        if interval_ns is not None:
            max_hz = self._policy.max_rates_hz.get(MESSAGE_NAMES[number])
            interval_ns = max(interval_ns, round(1e9 / max_hz)) if max_hz else interval_ns
            due_ns = self._context.flight.time_ns + min(interval_ns, _SECOND_NS)
            values = self._values[number]
            twice = isinstance(values, HalfwayStream) and interval_ns <= self._half_step_ns
            halfway = values.halfway if isinstance(values, HalfwayStream) and twice else None
            streams.append(
                _MessageStream(number, self._values_of(channel, number), interval_ns, due_ns, halfway)
            )
        streams.sort(key=lambda stream: _ORDER[stream.number])
        self._schedules[channel.name] = streams

    def _values_of(self, channel: Channel, number: int) -> Stream:
        values = self._values[number]
        if isinstance(values, ChannelStream):
            return functools.partial(values.values, channel)
        return values.values if isinstance(values, HalfwayStream) else values

    def _set_interval(self, command: Command) -> CommandResult | None:
        number, interval_us = _message_id(command.params[0]), command.params[1]
        if number not in self._supported | self._silent or interval_us != interval_us:
            return self._refuse_interval(number)
        if 0 < interval_us < self._policy.min_interval_us:
            return CommandResult.DENIED
        channel = command.sender.channel
        if number in self._silent:
            # 0 and -1 alike end a stream that has no interval of its own.
            shown_us = round(min(interval_us, 1e9)) if interval_us > 0 else -1
            self._silent_intervals_us[channel.name, number] = shown_us
            return CommandResult.ACCEPTED
        if interval_us < 0:
            self._schedule(channel, number, None)
        elif interval_us == 0:
            self._schedule(channel, number, self._default_interval_ns(channel, number))
        else:
            self._schedule(channel, number, round(min(interval_us, 1e9) * 1000.0))
        return CommandResult.ACCEPTED

    def _refuse_interval(self, number: int) -> CommandResult:
        self._context.texts.report(self._policy.unknown_interval_text, number)
        return self._policy.unknown_interval

    def _get_interval(self, command: Command) -> CommandResult | None:
        number, channel = _message_id(command.params[0]), command.sender.channel
        known = number in self._supported | self._silent
        # As MESSAGE_INTERVAL defines it.
        not_streamed_us = self._silent_intervals_us.get((channel.name, number), -1) if known else 0
        intervals_us = [
            stream.interval_ns // 1000 for stream in self._schedules[channel.name] if stream.number == number
        ]
        interval_us = intervals_us[0] if intervals_us else not_streamed_us
        channel.send_message(
            "MESSAGE_INTERVAL", message_id=min(max(number, 0), 65535), interval_us=interval_us
        )
        return CommandResult.ACCEPTED if known else self._policy.unknown_get_interval

    def _request_message(self, command: Command) -> CommandResult | None:
        number, channel = _message_id(command.params[0]), command.sender.channel
        if number in self._answers:
            name, answer = self._answers[number]
            fields = answer(command)
            if fields is None:
                return self._policy.unknown_request
            for message in fields if isinstance(fields, list) else [fields]:
                if self._policy.answers_after_acknowledgement:
                    self._late_answers.append((channel, name, message))
                else:
                    channel.send_message(name, **message)
            return CommandResult.ACCEPTED
        if number in self._supported:
            self._requested.append((channel, number))
            return CommandResult.ACCEPTED
        # ArduPilot accepts requests for messages of devices that are not there.
        if number in self._policy.promised_messages:
            return CommandResult.ACCEPTED
        return self._policy.unknown_request

    def _request_group(self, message: Any, sender: MessageSender) -> None:
        """REQUEST_DATA_STREAM. An autopilot without groups ignores it."""
        policy, parameters, channel = self._policy, self._context.parameters, sender.channel
        index = self._context.radio.channels.index(channel)
        hz = float(message.req_message_rate) if message.start_stop else 0.0
        all_groups = message.req_stream_id == MAV_DATA_STREAM.ALL
        for group in policy.stream_groups if all_groups else (message.req_stream_id,):
            self._schedule_group(channel, group, hz)
            self._group_rates[index, group] = hz
            for suffix, parameter_group in policy.stream_parameters.items():
                name = f"SR{index}_{suffix}"
                if parameter_group == group and name in parameters.kinds:
                    parameters.put(name, hz, saves=False)


def _message_id(value: float) -> int:
    """A message id from a float; -1 for a value that is none."""
    return int(value) if value == value and 0 <= value < 2**24 else -1
