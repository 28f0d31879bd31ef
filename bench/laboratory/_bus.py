"""The bench's end of the bus: a thread that sends what it is given, and never slows or fails a run."""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import socket
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import aiomqtt

from bench.brokers import check_topic
from bench.campaign import (
    CampaignEvent,
    CampaignPaused,
    CampaignPlanned,
    MissingRunsRetried,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    SessionProgressed,
)
from bench.visible_text import visible

from ._broker import Broker
from ._documents import CampaignMessage, CampaignStatus, StandMessage, State, message_of

MAX_WAITING_MESSAGES = 10_000
"""Messages that wait for a broker that is away: some 3 MB. Older ones are dropped, and counted."""
CLOSING_S = 5.0
"""Host seconds in which the last messages must be gone after a campaign. Chosen: a person waits for them."""
RECONNECT_S = 2.0
"""Host seconds between two attempts to reach the broker. Chosen."""
_QOS = 1
# Without it a message of QoS 1 takes 44 ms a hop, by Nagle's algorithm and delayed acknowledgements (measured).
_SOCKET_OPTIONS = [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)]


@dataclass(frozen=True, slots=True)
class Stand:
    """A test stand, by the topics of its own that it shares with the bench.

    `announce` gets a message before each session and `release` one after it. A session starts once a message comes
    on `ready`; None starts it at once.
    """

    ready: str | None = None
    announce: str | None = None
    release: str | None = None


@dataclass(frozen=True, slots=True)
class _Sending:
    topic: str
    payload: str


class LaboratoryBus:
    """Sends the events of one campaign, keeps its status retained, and asks the test stand before each session.

    All methods return at once and may be called while the broker is away.
    """

    def __init__(
        self,
        broker: Broker,
        campaign: str,
        stand: Stand,
        warn: Callable[[str], None],
    ) -> None:
        self._broker, self._campaign, self._stand, self._warn = broker, campaign, stand, warn
        self._topics = f"{broker.prefix}/{campaign}"
        self._sendings: deque[_Sending] = deque()
        # The newest progress of each session. Apart from the messages: it must never push out one of them.
        self._progress: dict[str, SessionProgressed] = {}
        self._lock = threading.Lock()
        self._number = self._dropped = 0
        self._status = CampaignStatus(campaign=campaign, state="running")
        self._status_sent: CampaignStatus | None = None
        self._outcomes: dict[str, str] = {}
        self._outcome_counts: Counter[str] = Counter()
        self._running: dict[str, None] = {}
        self._announced: str | None = None
        self._opened: str | None = None
        self._closing = False
        self._warned = False
        self._loop = asyncio.new_event_loop()
        self._wake = asyncio.Event()
        self._thread = threading.Thread(target=self._serve, name="laboratory-bus", daemon=True)
        self._thread.start()

    def notify(self, event: CampaignEvent) -> None:
        """Send an event, and the status that follows from it."""
        with self._lock:
            if isinstance(event, SessionProgressed):
                self._progress[event.realization] = event
                self._awaken()
                return
            self._put(self._event_sending(event))
            match event:
                case CampaignPlanned(total, done):
                    self._change(total=total, done=done)
                case CampaignPaused(goes_on):
                    self._change(state="running" if goes_on else "paused")
                case RealizationStarted(realization):
                    self._running[realization] = None
                    self._change(state="running")
                case RealizationRetried(realization, outcome):
                    self._release(realization, outcome)
                case RealizationFinished(realization, outcome):
                    self._forget_outcome(realization)
                    self._outcomes[realization] = str(outcome)
                    self._outcome_counts[str(outcome)] += 1
                    self._release(realization, outcome)
                    self._change(done=event.done, total=event.total)
                case MissingRunsRetried(realizations, done, total):
                    for realization in realizations:
                        self._forget_outcome(realization)
                    self._change(done=done, total=total)
                case _:
                    pass

    def is_open(self, realization: str) -> bool:
        """Whether the stand is ready for a session. The first call for a realization announces it."""
        if self._stand.ready is None and self._stand.announce is None:
            return True
        with self._lock:
            if self._announced != realization:
                self._announced, self._opened = realization, None
                if self._stand.announce is not None:
                    self._send_to_stand(self._stand.announce, realization, ended=None)
                if self._stand.ready is not None:
                    self._number += 1
                    waiting = CampaignMessage(
                        campaign=self._campaign,
                        event="waiting",
                        number=self._number,
                        sent_utc=dt.datetime.now(dt.UTC),
                        realization=realization,
                    )
                    self._put(self._sending_of(waiting))
                    self._change(state="waiting")
            if self._stand.ready is not None and self._opened != realization:
                return False
            self._announced = None
            return True

    def send_scores(self, report_json: str) -> None:
        """Send a score report, retained, in the form of `rebar run --json`."""
        with self._lock:
            self._put(_Sending(f"{self._topics}/scores", report_json))

    def end(self, state: State) -> None:
        """Send the last status."""
        with self._lock:
            self._running.clear()
            self._change(state=state)

    def close(self, timeout_s: float = CLOSING_S) -> int:
        """Send what waits, for `timeout_s` host seconds at most. Returns how many messages never went."""
        with self._lock:
            self._closing = True
        self._awaken()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._abandon)
            self._thread.join(1.0)
        return len(self._sendings) + self._dropped

    def _abandon(self) -> None:
        for task in asyncio.all_tasks(self._loop):
            task.cancel()

    # What follows up to `_serve` is called with the lock held.

    def _forget_outcome(self, realization: str) -> None:
        # A run whose result was set aside, or whose design point was reopened, is flown again and counted then.
        if (outcome := self._outcomes.pop(realization, None)) is not None:
            self._outcome_counts[outcome] -= 1

    def _release(self, realization: str, outcome: object) -> None:
        self._progress.pop(realization, None)
        flew = self._running.pop(realization, 0) is None
        if flew and self._stand.release is not None:
            self._send_to_stand(self._stand.release, realization, ended=outcome)
        self._change()

    def _send_to_stand(self, topic: str, realization: str, ended: object) -> None:
        message = StandMessage.model_validate(
            {
                "campaign": self._campaign,
                "session": "next" if ended is None else "ended",
                "realization": realization,
                "outcome": ended,
            }
        )
        self._put(_Sending(topic, message.model_dump_json(exclude_none=True)))

    def _event_sending(self, event: CampaignEvent) -> _Sending:
        self._number += 1
        return self._sending_of(message_of(event, self._campaign, self._number, dt.datetime.now(dt.UTC)))

    def _sending_of(self, message: CampaignMessage) -> _Sending:
        return _Sending(f"{self._topics}/event/{message.event}", message.model_dump_json(exclude_none=True))

    def _change(self, **fields: object) -> None:
        # Unary plus leaves out the outcomes that no run has any more.
        known = {"running": tuple(self._running), "outcomes": dict(+self._outcome_counts)}
        self._status = self._status.model_copy(update={**known, **fields})
        self._awaken()

    def _put(self, sending: _Sending) -> None:
        if len(self._sendings) >= MAX_WAITING_MESSAGES:
            self._sendings.popleft()
            self._dropped += 1
        self._sendings.append(sending)
        self._awaken()

    def _awaken(self) -> None:
        # The loop is gone once everything was sent after `close`.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._wake.set)

    # The thread of the bus.

    def _serve(self) -> None:
        with suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._keep_connected())
        self._loop.close()

    async def _keep_connected(self) -> None:
        while True:
            try:
                async with self._client() as client:
                    self._warned = False
                    await self._talk(client)
                return
            except (aiomqtt.MqttError, OSError) as error:
                self._tell(f"MQTT broker {self._broker.host}:{self._broker.port}: {error}; it is tried again")
            if self._closing:
                return
            with suppress(TimeoutError):
                await asyncio.wait_for(self._until_closing(), RECONNECT_S)

    def _tell(self, warning: str) -> None:
        # Once for each loss: a broker that is away for hours must not fill the terminal.
        if not self._warned:
            self._warned = True
            self._warn(warning)

    def _client(self) -> aiomqtt.Client:
        lost = self._status.model_copy(update={"state": "lost"})
        return aiomqtt.Client(
            self._broker.host,
            self._broker.port,
            username=self._broker.user,
            password=self._broker.password,
            tls_context=self._broker.tls,
            will=aiomqtt.Will(
                self._status_topic, visible(lost.model_dump_json(exclude_none=True)), _QOS, retain=True
            ),
            socket_options=_SOCKET_OPTIONS,
            timeout=CLOSING_S,
        )

    @property
    def _status_topic(self) -> str:
        return f"{self._topics}/status"

    async def _talk(self, client: aiomqtt.Client) -> None:
        """Send until the bus is closed and nothing waits."""
        # A broker that comes back may have forgotten everything, and has sent the will.
        self._status_sent = None
        if self._stand.ready is not None:
            await client.subscribe(self._stand.ready, qos=_QOS)
        # Without a topic as well: listening is what notices that the broker has gone.
        listening = asyncio.create_task(self._listen(client))
        try:
            while not await self._send_all(client):
                if listening.done():
                    await listening
                await self._wake.wait()
        finally:
            listening.cancel()
            with suppress(asyncio.CancelledError, aiomqtt.MqttError):
                await listening

    async def _send_all(self, client: aiomqtt.Client) -> bool:
        """Send all that waits, and the status; whether the bus is closed."""
        self._wake.clear()
        while (sending := self._next_sending()) is not None:
            retained = sending.topic == f"{self._topics}/scores"
            await client.publish(sending.topic, visible(sending.payload), qos=_QOS, retain=retained)
            with self._lock:
                # Only now: what was not acknowledged is sent again. A newer message may have pushed it out.
                if self._sendings and self._sendings[0] is sending:
                    self._sendings.popleft()
        with self._lock:
            status, closing = (
                self._status.model_copy(update={"messages_dropped": self._dropped}),
                self._closing,
            )
        if status != self._status_sent:
            sent = status.model_copy(update={"sent_utc": dt.datetime.now(dt.UTC)})
            await client.publish(
                self._status_topic, visible(sent.model_dump_json(exclude_none=True)), qos=_QOS, retain=True
            )
            self._status_sent = status
        return closing and not self._sendings

    def _next_sending(self) -> _Sending | None:
        """The next message that waits; the progress of a session when no other does."""
        with self._lock:
            if self._sendings:
                return self._sendings[0]
            if self._closing or not self._progress:
                return None
            # Numbered only now: what a newer one replaced leaves no gap.
            return self._event_sending(self._progress.pop(next(iter(self._progress))))

    async def _listen(self, client: aiomqtt.Client) -> None:
        try:
            async for message in client.messages:
                # A retained word is from another session, if not from another day.
                if not message.retain:
                    self._hear(message.payload)
        finally:
            self._wake.set()

    def _hear(self, payload: object) -> None:
        with self._lock:
            named = _realization_in(payload)
            if self._announced is not None and named in (None, self._announced):
                self._opened = self._announced

    async def _until_closing(self) -> None:
        while not self._closing:
            await self._wake.wait()
            self._wake.clear()


def _realization_in(payload: object) -> str | None:
    """The realization that a message of a stand names; None where it names none."""
    with suppress(ValueError, UnicodeDecodeError):
        if isinstance(payload, bytes | bytearray | str):
            document = json.loads(payload)
            if isinstance(document, dict) and isinstance(document.get("realization"), str):
                return str(document["realization"])
    return None


@contextmanager
def open_bus(
    broker: Broker,
    campaign: str,
    *,
    stand: Stand | None = None,
    warn: Callable[[str], None],
) -> Iterator[LaboratoryBus]:
    """Yield a bus for one campaign. Leaving the block sends what waits, within five host seconds.

    `warn` is told, from another thread, of a broker that cannot be reached; the bus goes on trying. Raises SetupError
    for a topic of the stand that cannot be one.
    """
    stand = stand or Stand()
    for option, topic in (
        ("--stand-ready", stand.ready),
        ("--stand-announce", stand.announce),
        ("--stand-release", stand.release),
    ):
        if topic is not None:
            check_topic(option, topic)
    bus = LaboratoryBus(broker, campaign, stand, warn)
    try:
        yield bus
    finally:
        if unsent := bus.close():
            warn(f"MQTT broker {broker.host}:{broker.port}: {unsent} messages were not delivered")
