"""The way of received messages: to the services that take them, and between the clients of several links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from .links._frames import KINDS, Decoder, message_id, sender
from .links._radio import Channel, Radio
from .payload._camera import CameraComponent
from .state._service import MessageHandler, MessageSender

# MAV_COMP_ID_AUTOPILOT1
COMPONENT = 1


class MessageRouter:
    """Hands each frame on. `unheard` counts those that no service takes, `malformed` those that make no sense.

    With `any_component`, messages to components that do not exist are taken too.
    """

    def __init__(
        self,
        radio: Radio,
        system: int,
        any_component: bool,
        handlers: Iterable[Mapping[str, MessageHandler]],
        camera: CameraComponent | None,
    ) -> None:
        self._radio, self._system, self._any_component = radio, system, any_component
        self._camera = camera
        self._decoder = Decoder()
        self._handlers: dict[int, list[MessageHandler]] = {}
        for of_service in handlers:
            for name, handler in of_service.items():
                self._handlers.setdefault(KINDS[name].id, []).append(handler)
        self.unheard = 0

    @property
    def malformed(self) -> int:
        return self._decoder.malformed

    def handle(self) -> None:
        """Handle what this step takes from the inboxes."""
        for channel in self._radio.channels:
            if channel.link.inbox:
                for frame in self._radio.take(channel):
                    if channel.admits(frame):
                        self._handle_frame(channel, frame)

    def _handle_frame(self, channel: Channel, frame: bytes) -> None:
        handlers = self._handlers.get(message_id(frame))
        message = self._decoder.decode(frame) if handlers else None
        if self._camera and message is not None and self._camera.is_addressed(message, self._system):
            self._camera.handle(message, MessageSender(*sender(frame), channel))
            return
        for_us = message is None or self._is_addressed(message)
        for_us_alone = message is not None and for_us and _target(message) == self._system
        # Like an autopilot with several links, the controller routes messages between its clients.
        if not for_us_alone:
            for other in self._radio.channels:
                if other is not channel:
                    other.forward(frame)
        if message is None or not handlers:
            self.unheard += 1
            return
        if for_us:
            message_sender = MessageSender(*sender(frame), channel)
            for handler in handlers:
                handler(message, message_sender)

    def _is_addressed(self, message: Any) -> bool:
        """Whether a message is for this vehicle: its system, or every system; its autopilot, or every component."""
        system, component = _target(message), getattr(message, "target_component", 0)
        ours = self._any_component or component in (0, COMPONENT)
        return system == 0 or (system == self._system and ours)


def _target(message: Any) -> int:
    """The system that a message is for; 0 for every system, also where the message names none."""
    system: int = getattr(message, "target_system", 0) or getattr(message, "target", 0)
    return system
