"""A campaign's events on an MQTT broker, and a test stand that is waited for."""

from __future__ import annotations

import gc
import socket
import ssl
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import aiomqtt
import pytest
from embedded_broker import Laboratory, open_laboratory, until
from mosquitto import certificate, needs_mosquitto, open_mosquitto
from pwdlib import PasswordHash
from pwdlib.hashers.argon2 import Argon2Hasher

from bench.campaign import (
    CampaignEvent,
    CampaignPlanned,
    CampaignStopping,
    MissingRunsRetried,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    ResultLost,
    SessionProgressed,
)
from bench.contracts import Outcome, ProgressUpdate
from bench.errors import SetupError
from bench.laboratory import (
    Broker,
    CampaignMessage,
    CampaignStatus,
    Stand,
    StandMessage,
    open_bus,
    parse_broker,
)
from bench.laboratory import _bus as bus_module

EVENTS: list[CampaignEvent] = [
    ResultLost("b"),
    CampaignPlanned(3, 1),
    RealizationStarted("a", "w1", 1),
    RealizationStarted("b", "w2", 1),
    RealizationRetried("a", Outcome.BENCH_ERROR, "a made-up fault", 2.0),
    RealizationFinished("b", Outcome.AGENT_CRASHED, "it\u202e ended\x9b", 3.5, 2, 3),
    RealizationStarted("a", "w1", 2),
    RealizationFinished("a", Outcome.COMPLETED, "", 4.5, 3, 3),
    MissingRunsRetried(("b",), 2, 3),
    CampaignStopping("received SIGTERM"),
]
NAMES = ["result_lost", "planned", "started", "started", "retried", "finished", "started", "finished"]
NAMES += ["retrying", "stopping"]


@pytest.fixture
def laboratory() -> Iterator[Laboratory]:
    with open_laboratory() as open_one:
        yield open_one


def broker_of(laboratory: Laboratory) -> Broker:
    return parse_broker(f"mqtt://127.0.0.1:{laboratory.port}/bay-2")


def secured(port: int) -> str:
    return f"mqtts://rig@localhost:{port}/bay-2"


def access_by(authority: Path) -> dict[str, object]:
    """Of a listener beside the bus."""
    context = ssl.create_default_context(cafile=str(authority))
    return {"tls_context": context, "username": "rig", "password": "secret"}


def never(warning: str) -> None:
    raise AssertionError(warning)


def messages(laboratory: Laboratory, campaign: str) -> list[CampaignMessage]:
    """The messages of a campaign's events by their numbers, each checked against its form.

    A broker promises an order within one topic alone.
    """
    told = [
        CampaignMessage.model_validate(message.payload)
        for message in [*laboratory.heard]
        if message.topic.startswith(f"bay-2/{campaign}/event/")
    ]
    return sorted(told, key=lambda message: message.number)


def states(laboratory: Laboratory, campaign: str) -> list[str]:
    return [
        CampaignStatus.model_validate(payload).state
        for payload in laboratory.payloads(f"bay-2/{campaign}/status")
    ]


def test_two_campaigns_tell_their_events_in_order(laboratory: Laboratory) -> None:
    """Each on its own topics, numbered; the last status stays for whoever comes later."""
    laboratory.listen()
    with (
        open_bus(broker_of(laboratory), "first", warn=never) as first,
        open_bus(broker_of(laboratory), "second", warn=never) as second,
    ):
        for event in EVENTS:
            first.notify(event)
        for event in EVENTS[1:4]:
            second.notify(event)
        first.send_scores('{"format": "rebar.score-report/1", "source": "\u202e"}')
        first.end("complete")
        second.end("incomplete")
    until(lambda: "complete" in states(laboratory, "first") and "incomplete" in states(laboratory, "second"))
    until(lambda: len(messages(laboratory, "first")) == len(EVENTS))
    until(lambda: len(messages(laboratory, "second")) == 3)
    told = messages(laboratory, "first")
    assert [message.event for message in told] == NAMES
    assert [message.number for message in told] == list(range(1, 1 + len(EVENTS)))
    # The words of others are the same, and JSON's escapes show what is not seen in them.
    assert told[5].reason == "it\u202e ended\x9b"
    assert "".join(message.text for message in laboratory.heard).isprintable()
    retried, ended = told[4:6]
    assert (retried.outcome, retried.reason, retried.pause_s) == (Outcome.BENCH_ERROR, "a made-up fault", 2.0)
    assert (ended.outcome, ended.wall_s, ended.done, ended.total) == (Outcome.AGENT_CRASHED, 3.5, 2, 3)
    assert [message.event for message in messages(laboratory, "second")] == NAMES[1:4]

    laboratory.heard.clear()
    laboratory.listen()
    retained = {"bay-2/first/status", "bay-2/first/scores", "bay-2/second/status"}
    until(lambda: set(laboratory.topics()) >= retained)
    assert {message.topic for message in laboratory.heard if message.retained} == retained
    status = CampaignStatus.model_validate(laboratory.payloads("bay-2/first/status")[0])
    assert (status.done, status.total, status.running) == (2, 3, ())
    assert status.outcomes == {"completed": 1}
    assert {"format": "rebar.score-report/1", "source": "\u202e"} in laboratory.payloads("bay-2/first/scores")


def test_runs_that_are_flown_again_count_once(laboratory: Laboratory) -> None:
    """Also those that end otherwise the second time, and those of a design point that was reopened."""
    laboratory.listen()
    crashed, lost, settled = Outcome.AGENT_CRASHED, Outcome.WORKER_LOST, Outcome.SETTLED
    with open_bus(broker_of(laboratory), "demo", warn=never) as bus:
        bus.notify(CampaignPlanned(4, 0))
        for done, (realization, outcome) in enumerate(
            zip("abcd", (lost, lost, crashed, settled), strict=True), 1
        ):
            bus.notify(RealizationFinished(realization, outcome, "", 1.0, done, 4))
        bus.notify(MissingRunsRetried(("a", "b"), 2, 4))
        bus.notify(RealizationFinished("a", Outcome.COMPLETED, "", 1.0, 3, 4))
        bus.notify(RealizationFinished("b", lost, "again", 1.0, 4, 4))
        bus.notify(RealizationFinished("d", Outcome.COMPLETED, "", 1.0, 4, 4))
        bus.end("complete")
    until(lambda: "complete" in states(laboratory, "demo"))
    status = CampaignStatus.model_validate(laboratory.payloads("bay-2/demo/status")[-1])
    assert (status.done, status.outcomes) == (4, {"agent_crashed": 1, "completed": 2, "worker_lost": 1})


@pytest.fixture
def in_reach(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Whether the bus reaches its broker: set once the test's listener has subscribed, so that it misses nothing."""
    reached = threading.Event()

    class DistantClient(aiomqtt.Client):
        async def __aenter__(self) -> DistantClient:
            # The bus alone has a last will.
            if self._client._will and not reached.is_set():
                raise aiomqtt.MqttError("out of reach")
            await super().__aenter__()
            return self

    monkeypatch.setattr(aiomqtt, "Client", DistantClient)
    monkeypatch.setattr(bus_module, "RECONNECT_S", 0.01)
    return reached


def test_a_broker_that_comes_late_gets_every_event_and_the_newest_progress(in_reach: threading.Event) -> None:
    """The run goes on without it, with one warning. Of progress the newest of the sessions that still fly leaves no gap."""
    warnings: list[str] = []
    with open_laboratory() as laboratory:
        laboratory.listen()
        with open_bus(broker_of(laboratory), "demo", warn=warnings.append) as bus:
            for event in EVENTS[:4]:
                bus.notify(event)
            for number in range(1, 21):
                update = ProgressUpdate(3.0 * number, 600.0, float(number), 3.0, "transit")
                for name in "ab":
                    bus.notify(SessionProgressed(name, update))
            bus.notify(RealizationFinished("b", Outcome.COMPLETED, "", 20.5, 1, 3))
            until(lambda: bool(warnings))
            in_reach.set()
            until(lambda: len(messages(laboratory, "demo")) == 6)
            for event in EVENTS[5:]:
                bus.notify(event)
            until(lambda: len(messages(laboratory, "demo")) == 11)
            bus.end("incomplete")
        told = messages(laboratory, "demo")
    assert [message.event for message in told] == [*NAMES[:4], "finished", "progress", *NAMES[5:]]
    assert [message.number for message in told] == list(range(1, 12))
    progress = told[5]
    assert (progress.realization, progress.simulated_s, progress.time_limit_s) == ("a", 60.0, 600.0)
    assert (progress.wall_s, progress.speed, progress.phase) == (20.0, 3.0, "transit")
    assert len(warnings) == 1


def test_a_broker_that_restarts_gets_what_it_missed_and_the_status(in_reach: threading.Event) -> None:
    """A broker that forgot everything is told the status again, and hears every event at least once."""
    warnings: list[str] = []
    with (
        open_laboratory() as laboratory,
        open_bus(broker_of(laboratory), "demo", warn=warnings.append) as bus,
    ):
        laboratory.listen()
        in_reach.set()
        bus.notify(EVENTS[0])
        until(lambda: len(messages(laboratory, "demo")) == 1)
        in_reach.clear()
        laboratory.stop()
        until(lambda: bool(warnings))
        for event in EVENTS[1:]:
            bus.notify(event)
        laboratory.heard.clear()
        laboratory.start()
        laboratory.listen()
        in_reach.set()
        until(lambda: {message.number for message in messages(laboratory, "demo")} >= {2, 8, len(EVENTS)})
        until(lambda: "running" in states(laboratory, "demo"))


def test_without_a_broker_the_run_ends_and_says_what_was_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages that wait are bounded: of twelve, the ten newest are kept, and all are counted."""
    monkeypatch.setattr(bus_module, "MAX_WAITING_MESSAGES", 10)
    monkeypatch.setattr(bus_module, "RECONNECT_S", 0.01)
    warnings: list[str] = []
    with (
        open_laboratory(started=False) as laboratory,
        open_bus(broker_of(laboratory), "demo", warn=warnings.append) as bus,
    ):
        for number in range(12):
            bus.notify(RealizationStarted(f"r{number}", "w1", 1))
        assert bus.is_open("r12")
    assert "12 messages were not delivered" in warnings[-1]


def test_a_lost_bench_is_told_by_the_broker(laboratory: Laboratory, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last will: whoever watches learns that nobody sends any more, and that the bench is back."""
    clients: list[aiomqtt.Client] = []

    class KnownClient(aiomqtt.Client):
        async def __aenter__(self) -> KnownClient:
            clients.append(self)
            await super().__aenter__()
            return self

    monkeypatch.setattr(aiomqtt, "Client", KnownClient)
    monkeypatch.setattr(bus_module, "RECONNECT_S", 0.01)
    laboratory.listen()
    with open_bus(broker_of(laboratory), "demo", warn=lambda warning: None) as bus:
        bus.notify(CampaignPlanned(2, 0))
        until(lambda: states(laboratory, "demo")[-1:] == ["running"])
        begun = len(states(laboratory, "demo"))
        bus_clients = [client for client in clients if client._client._will]
        # As a power cut would: the connection goes without a goodbye.
        connection = bus_clients[0]._client.socket()
        assert isinstance(connection, socket.socket)
        connection.shutdown(socket.SHUT_RDWR)
        until(lambda: states(laboratory, "demo")[begun:] == ["lost", "running"])


def test_a_session_starts_when_its_stand_is_ready(laboratory: Laboratory) -> None:
    """Each session is announced once, and opened by a word that is fresh and meant for it; then it is released."""
    laboratory.listen()
    laboratory.say("stand/ready", "of yesterday", retain=True)
    stand = Stand(ready="stand/ready", announce="stand/next", release="stand/ended")
    with open_bus(broker_of(laboratory), "demo", stand=stand, warn=never) as bus:
        for name, word in (("a", ""), ("b", '{"realization": "b"}')):

            def is_announced(name: str = name) -> bool:
                payloads = laboratory.payloads("stand/next")
                return bool(payloads) and payloads[-1]["realization"] == name

            assert not bus.is_open(name)
            until(is_announced)
            laboratory.say("stand/ready", '{"realization": "another"}')
            # A broker delivers to the bench and to this listener in the order of their subscriptions at most.
            until(lambda: laboratory.payloads("stand/ready")[-1:] == [{"realization": "another"}])
            assert not bus.is_open(name)
            laboratory.say("stand/ready", word)
            until(partial(bus.is_open, name))
            bus.notify(RealizationStarted(name, "w1", 1))
        bus.notify(RealizationRetried("a", Outcome.BENCH_ERROR, "", 0.0))
        bus.notify(RealizationFinished("b", Outcome.COMPLETED, "", 1.0, 1, 2))
        # Never started in this run: no stand stood by for it.
        bus.notify(RealizationFinished("c", Outcome.SETTLED, "", 0.0, 2, 2))
    until(lambda: len(laboratory.payloads("stand/ended")) == 2)
    ended = [StandMessage.model_validate(payload) for payload in laboratory.payloads("stand/ended")]
    assert [(message.realization, message.outcome) for message in ended] == [
        ("a", Outcome.BENCH_ERROR),
        ("b", Outcome.COMPLETED),
    ]
    waiting = [message.realization for message in messages(laboratory, "demo") if message.event == "waiting"]
    assert waiting == ["a", "b"]
    assert len(laboratory.payloads("stand/next")) == 2


def test_an_announcement_alone_waits_for_nobody(laboratory: Laboratory) -> None:
    """A relay that is switched needs no answer."""
    laboratory.listen()
    with open_bus(broker_of(laboratory), "demo", stand=Stand(announce="relay/on"), warn=never) as bus:
        assert bus.is_open("a")
        assert bus.is_open("b")
    until(lambda: len(laboratory.payloads("relay/on")) == 2)


# The client of MQTT forgets to close a socket whose certificate it refuses.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_password_and_certificate_are_checked_by_both_sides(tmp_path: Path) -> None:
    """The right ones deliver over TLS; a wrong password, and a broker with another certificate, get a warning."""
    authority, key = certificate(tmp_path, "broker")
    stranger, _ = certificate(tmp_path, "stranger")
    passwords = tmp_path / "passwords"
    passwords.write_text(f"rig:{PasswordHash((Argon2Hasher(),)).hash('secret')}\n")
    plugins = {"amqtt.plugins.authentication.FileAuthPlugin": {"password_file": str(passwords)}}
    listener = {"ssl": True, "certfile": str(authority), "keyfile": str(key)}
    with open_laboratory(plugins, listener) as laboratory:
        url = secured(laboratory.port)
        # A certificate is for a name.
        laboratory.host = "localhost"
        laboratory.listen(**access_by(authority))
        with open_bus(parse_broker(url, "secret", authority), "demo", warn=never) as bus:
            bus.notify(EVENTS[1])
            bus.end("complete")
        until(lambda: states(laboratory, "demo") == ["complete"])
        for password, trusted in (("wrong", authority), ("secret", stranger)):
            warnings: list[str] = []
            with open_bus(parse_broker(url, password, trusted), "intruder", warn=warnings.append) as bus:
                bus.notify(EVENTS[1])
                until(partial(bool, warnings))
            assert "not delivered" in warnings[-1]
        assert messages(laboratory, "intruder") == []
    # Here, where the filter above holds.
    gc.collect()


@needs_mosquitto
@pytest.mark.process
def test_a_mosquitto_by_tls_that_restarts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has the last will while the bench is away, and gets what it missed, and the status that it has forgotten."""
    monkeypatch.setattr(bus_module, "RECONNECT_S", 0.05)
    authority, key = certificate(tmp_path, "broker")
    access = access_by(authority)
    warnings: list[str] = []
    with (
        open_mosquitto(tmp_path, {"rig": "secret"}, authority, key) as broker,
        open_laboratory(started=False) as laboratory,
    ):
        laboratory.host, laboratory.port = "localhost", broker.port
        with open_bus(
            parse_broker(secured(broker.port), "secret", authority), "demo", warn=warnings.append
        ) as bus:
            bus.notify(EVENTS[1])
            laboratory.listen(**access)
            until(lambda: "running" in states(laboratory, "demo"))
            broker.stop()
            until(lambda: bool(warnings))
            for event in EVENTS[2:]:
                bus.notify(event)
            laboratory.heard.clear()
            broker.start()
            laboratory.listen(**access)
            bus.notify(EVENTS[0])
            bus.end("complete")
            until(lambda: "complete" in states(laboratory, "demo"))
    assert len(warnings) == 1
    # A subscriber that comes back may be later than what waited: the newest are there, and the status in any case.
    assert messages(laboratory, "demo")[-1].number == len(EVENTS)


@pytest.mark.parametrize(
    ("url", "authority", "named"),
    [
        ("broker.lab", None, "no address of a broker"),
        ("http://broker.lab", None, "no address of a broker"),
        ("mqtt://rig:secret@broker.lab", None, "REBAR_MQTT_PASSWORD"),
        ("mqtt://broker.lab:port", None, "broker.lab:port"),
        ("mqtt://broker.lab/a/#", None, "fragment"),
        ("mqtt://broker.lab/a/%2B/b", None, "no topic to send to"),
        ("mqtt://broker.lab?keepalive=3", None, "query"),
        ("mqtt://::1", None, "an IPv6 address stands in brackets"),
        ("mqtt://fe80::1:1883", None, "an IPv6 address stands in brackets"),
        ("mqtt://[::1", None, "an IPv6 address stands in brackets"),
        ("mqtt://broker.lab", Path("/no/ca.pem"), "no TLS"),
        ("mqtts://broker.lab", Path("/no/ca.pem"), "there is no such file"),
    ],
)
def test_an_address_that_cannot_be_is_refused(url: str, authority: Path | None, named: str) -> None:
    """By name, with what to write instead."""
    with pytest.raises(SetupError, match=named):
        parse_broker(url, authority=authority)


def test_an_address_says_all_but_the_password() -> None:
    """Ports and prefix have their defaults; the password is never printed."""
    plain = parse_broker("mqtt://broker.lab", "secret")
    secure = parse_broker("mqtts://a%20rig@broker.lab:9000/bay/2/", "secret")
    assert (plain.host, plain.port, plain.prefix) == ("broker.lab", 1883, "rebar")
    assert (plain.user, plain.tls) == (None, None)
    assert (secure.port, secure.prefix, secure.user) == (9000, "bay/2", "a rig")
    assert secure.tls is not None
    assert secure.tls.verify_mode is ssl.CERT_REQUIRED
    assert "secret" not in repr(plain) + repr(secure)
    assert parse_broker("mqtt://[::1]:1884").host == "::1"
