"""An agent behind the bridge, for tests: in lockstep it sends a status at every tick, and what is asked of it besides.

mqtt_agents.py [unruly | exit]
"""

from __future__ import annotations

import json
import os
import queue
import sys
from collections import Counter
from typing import Any
from urllib.parse import urlsplit

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

MANNER = sys.argv[1] if len(sys.argv) > 1 else ""
URL, VEHICLE = urlsplit(os.environ["REBAR_MQTT"]), os.environ["REBAR_VEHICLE"]
PREFIX = URL.path.strip("/")
# What the bridge keeps for itself must not be here: an agent that has it could speak past the bridge.
assert not {"REBAR_ZENOH_PASSWORD", "REBAR_TICK", "REBAR_TICK_SECRET"} & os.environ.keys()


def main() -> None:
    inbox: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
    client = paho.Client(CallbackAPIVersion.VERSION2)
    if URL.username:
        client.username_pw_set(URL.username, os.environ["REBAR_MQTT_PASSWORD"])

    def take_in(_: Any, __: Any, message: paho.MQTTMessage) -> None:
        topic = message.topic.removeprefix(f"{PREFIX}/")
        # Its own words come back too, and not all of them are JSON.
        if "agent" not in topic or topic.endswith("to_agent"):
            inbox.put((topic, json.loads(message.payload)))

    client.on_message = take_in
    client.on_subscribe = lambda *_: inbox.put(("subscribed", None))

    def subscribe(*_: Any) -> None:
        client.subscribe(f"{PREFIX}/#")

    client.on_connect = subscribe
    client.connect(str(URL.hostname), URL.port or 1883)
    client.loop_start()
    received: Counter[str] = Counter()
    sent: Counter[str] = Counter()
    tick: Any = None

    def send(topic: str, payload: str | bytes) -> None:
        sent[topic] += 1
        client.publish(f"{PREFIX}/{topic}", payload)

    while True:
        topic, document = inbox.get()
        received[topic] += 1
        if topic == "subscribed":
            send("bridge/ready", '{"agent": "tester"}')
        tick = document if topic == "bridge/tick" else tick
        if tick is None or any(received[name] < count for name, count in tick["topics"].items()):
            continue
        if MANNER == "exit" and tick["number"] == 5:
            sys.exit("the agent has had enough")
        status = {"time_s": tick["time_ns"] * 1e-9, "phase": "searching"}
        send(f"{VEHICLE}/agent/status", json.dumps(status))
        if MANNER == "unruly":
            send(f"{VEHICLE}/agent/reports", b"\xff no UTF-8")
            send(f"{VEHICLE}/agent/decisions", "x" * 300_000)
            send(f"{VEHICLE}/agent/tracks", "no JSON, which is the bench's to judge")
            send("mavlink/onboard/from_agent", '{"name": "NO_MESSAGE"}')
            send(f"{VEHICLE}/mission", '{"forged": true}')
            send(f"{VEHICLE}/agent/another", "{}")
        send("bridge/ack", json.dumps({"number": tick["number"], "topics": sent}))
        tick = None


main()
