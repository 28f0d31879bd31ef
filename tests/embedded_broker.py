"""An MQTT broker in a thread of the test, and a client that keeps what it hears."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, TypeVar

import aiomqtt
from amqtt.broker import Broker as EmbeddedBroker
from ports import free_port

PATIENCE_S = 60.0
"""Host seconds until a test gives up; a busy machine may take many of them."""
T = TypeVar("T")


def until(is_so: Callable[[], bool]) -> None:
    """Wait until something is so; fails after a long while."""
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline, "it never came to be"
        time.sleep(0.01)


@dataclass(frozen=True)
class Heard:
    """A message as a subscriber got it."""

    topic: str
    payload: dict[str, Any]
    retained: bool
    text: str = ""


@dataclass
class Laboratory:
    """A broker and a subscriber to everything, in one thread."""

    port: int
    plugins: dict[str, Any]
    listener: dict[str, Any] = field(default_factory=dict)
    heard: list[Heard] = field(default_factory=list)
    host: str = "127.0.0.1"

    def __post_init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._broker: EmbeddedBroker | None = None
        self._listeners: list[asyncio.Task[None]] = []

    def start(self) -> None:
        """Start a broker that knows nothing of an earlier one."""
        bind = {"type": "tcp", "bind": f"127.0.0.1:{self.port}", **self.listener}
        # Its configuration reads file names, and its tasks belong to the loop that makes it.
        self._broker = self.call(self._started({"listeners": {"default": bind}, "plugins": self.plugins}))

    async def _started(self, configuration: dict[str, Any]) -> EmbeddedBroker:
        broker = EmbeddedBroker(configuration)
        await broker.start()
        return broker

    def stop(self) -> None:
        """Stop the broker: its clients lose their connections."""
        broker, self._broker = self._broker, None
        if broker is not None:
            self.call(self._stopped(broker))

    async def _stopped(self, broker: EmbeddedBroker) -> None:
        # It may wait for ever for the receipt of a message whose client has gone, before it stops listening: the next
        # broker wants the port.
        for server in broker._servers.values():
            server.instance.close()
        with suppress(TimeoutError):
            await asyncio.wait_for(broker.shutdown(), 2.0)

    def close(self) -> None:
        """Stop all, the listeners first: they would see the broker go."""
        self.call(self._cancel(self._listeners))
        self.stop()
        self.call(self._cancel([]))
        self.call(self._disconnect())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _cancel(self, tasks: list[asyncio.Task[None]]) -> None:
        """End tasks of the loop; all of them where none is named."""
        ended = tasks or [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in ended:
            task.cancel()
        await asyncio.gather(*ended, return_exceptions=True)

    async def _disconnect(self) -> None:
        """Close what the broker left open, as where it was too slow to shut down: a closed loop cannot."""
        for transport in [*self._loop._transports.values()]:  # type: ignore[attr-defined]
            transport.abort()
        # A connection is closed in the round after the one in which it was aborted.
        await asyncio.sleep(0)
        await asyncio.sleep(0)

    def call(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in the thread, and wait for it."""
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(PATIENCE_S)

    def listen(self, **access: Any) -> None:
        """Subscribe to everything; `heard` grows from then on."""
        listening = threading.Event()
        self.call(self._begin_to_listen(listening, access))
        assert listening.wait(PATIENCE_S)

    async def _begin_to_listen(self, listening: threading.Event, access: dict[str, Any]) -> None:
        self._listeners.append(asyncio.create_task(self._listen(listening, access)))

    async def _listen(self, listening: threading.Event, access: dict[str, Any]) -> None:
        async with aiomqtt.Client(self.host, self.port, **access) as client:
            await client.subscribe("#", qos=1)
            listening.set()
            async for message in client.messages:
                payload = (
                    json.loads(bytes(message.payload))
                    if message.payload not in (b"", b"of yesterday")
                    else {}
                )
                text = bytes(message.payload).decode()
                self.heard.append(Heard(str(message.topic), payload, message.retain, text))

    def say(self, topic: str, text: str, *, retain: bool = False, **access: Any) -> None:
        """Publish as a stranger."""

        async def publish() -> None:
            async with aiomqtt.Client(self.host, self.port, **access) as client:
                await client.publish(topic, text, qos=1, retain=retain)

        self.call(publish())

    def topics(self) -> list[str]:
        """The topics of what was heard, in order."""
        return [message.topic for message in self.heard]

    def payloads(self, topic: str) -> list[dict[str, Any]]:
        """What was heard on a topic, in order."""
        return [message.payload for message in self.heard if message.topic == topic]


ANONYMOUS = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}


@contextmanager
def open_laboratory(
    plugins: dict[str, Any] | None = None, listener: dict[str, Any] | None = None, *, started: bool = True
) -> Iterator[Laboratory]:
    """Yield a laboratory; its broker runs unless `started` is False."""
    laboratory = Laboratory(free_port(), plugins or ANONYMOUS, listener or {})
    try:
        if started:
            laboratory.start()
        yield laboratory
    finally:
        laboratory.close()
