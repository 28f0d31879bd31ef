"""One connection to the broker: what it publishes goes out at once, and what comes waits in an inbox."""

from __future__ import annotations

import socket
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from bench.errors import LinkLost

from ._broker import BrokerAddress

# Host seconds for the broker to take the connection and the subscriptions; and, in real time, to come back. Chosen.
PATIENCE_S = 10.0
# While a connection stands TCP loses nothing, and in lockstep the counts show what a broker dropped all the same. With
# acknowledgements each message costs twice the packets.
_QOS = 0


class Arrival(NamedTuple):
    """A message as it came; `topic` is without the prefix."""

    topic: str
    payload: bytes


class BrokerConnection:
    """Made by `open_connection`. `lost` says why the broker is gone, and is empty while it is there."""

    def __init__(self, address: BrokerAddress, subscriptions: Sequence[str], patience_s: float) -> None:
        self.lost = ""
        self.unsent = 0
        self._patience_s = patience_s
        self._name = f"MQTT broker {address.host}:{address.port}"
        self._prefix = address.prefix
        self._subscriptions = [(f"{address.prefix}/{topic}", _QOS) for topic in subscriptions]
        self._change = threading.Condition()
        self._inbox: deque[Arrival] = deque()
        self._is_subscribed = False
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_disconnect = self._on_disconnect
        self._client.on_message = self._on_message
        self._client.on_socket_open = _send_at_once
        if address.bridge.user:
            self._client.username_pw_set(address.bridge.user, address.bridge.password)
        if address.tls is not None:
            self._client.tls_set_context(address.tls)
        self._client.reconnect_delay_set(1, 2)

    def connect(self, host: str, port: int) -> None:
        """Return once the broker has taken the connection and the subscriptions. Raises LinkLost."""
        try:
            self._client.connect(host, port)
        except (OSError, ValueError) as error:
            raise LinkLost(f"{self._name} does not answer: {error}") from error
        self._client.loop_start()
        with self._change:
            if not self._change.wait_for(lambda: self._is_subscribed or self.lost, self._patience_s):
                self.lost = f"it took the connection, and did not answer within {self._patience_s:g} s"
        self.check()

    def close(self) -> None:
        """Say goodbye, so that the broker keeps nothing."""
        self._client.on_disconnect = None
        self._client.disconnect()
        self._client.loop_stop()

    def check(self) -> None:
        """Raise LinkLost when the broker is gone."""
        if self.lost:
            raise LinkLost(f"{self._name}: {self.lost}")

    def wait_for_return(self) -> None:
        """Wait for a broker that is gone, for its patience. Raises LinkLost."""
        with self._change:
            self._change.wait_for(lambda: not self.lost, self._patience_s)
        if self.lost:
            raise LinkLost(f"{self._name}: {self.lost}; it did not come back within {self._patience_s:g} s")

    def publish(self, topic: str, payload: str) -> bool:
        """Send a message; False, and counted, while the broker is away."""
        if self.lost:
            # paho would keep it for later, and the agent would get a burst of the past.
            self.unsent += 1
            return False
        self._client.publish(f"{self._prefix}/{topic}", payload, _QOS)
        return True

    def take(self, timeout_s: float) -> list[Arrival]:
        """What has come; waits until something does, the broker goes, or `timeout_s` is over."""
        with self._change:
            self._change.wait_for(lambda: self._inbox or self.lost, timeout_s)
            taken = list(self._inbox)
            self._inbox.clear()
        return taken

    # What follows is called by paho's thread.

    def _on_connect(self, client: paho.Client, _: Any, __: Any, reason: Any, ___: Any) -> None:
        if reason.is_failure:
            self._set_lost(f"it refuses the bridge: {reason}")
            return
        client.subscribe(self._subscriptions)

    def _on_subscribe(self, _: paho.Client, __: Any, ___: int, reasons: Any, ____: Any) -> None:
        if refused := [reason for reason in reasons if reason.is_failure]:
            self._set_lost(f"it refuses a subscription under {self._prefix}/: {refused[0]}")
            return
        with self._change:
            self._is_subscribed, self.lost = True, ""
            self._change.notify_all()

    def _on_disconnect(self, _: paho.Client, __: Any, ___: Any, reason: Any, ____: Any) -> None:
        # The first reason says more than those of later attempts.
        self._set_lost(self.lost or f"the connection is lost: {reason}")

    def _on_message(self, _: paho.Client, __: Any, message: paho.MQTTMessage) -> None:
        arrival = Arrival(message.topic.removeprefix(f"{self._prefix}/"), bytes(message.payload))
        with self._change:
            self._inbox.append(arrival)
            self._change.notify_all()

    def _set_lost(self, reason: str) -> None:
        with self._change:
            self.lost = reason
            self._change.notify_all()


def _send_at_once(_: paho.Client, __: Any, opened: Any) -> None:
    # Nagle's algorithm with delayed acknowledgements costs 40 ms a message.
    if isinstance(opened, socket.socket):
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


@contextmanager
def open_connection(
    address: BrokerAddress, subscriptions: Sequence[str], patience_s: float = PATIENCE_S
) -> Iterator[BrokerConnection]:
    """Connect to a broker as the bridge and subscribe. Raises LinkLost with what the broker did instead.

    `patience_s`: host seconds for the broker to answer, and to come back.
    """
    connection = BrokerConnection(address, subscriptions, patience_s)
    try:
        connection.connect(address.host, address.port)
        yield connection
    finally:
        connection.close()
