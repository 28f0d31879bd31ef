"""An agent that knows MQTT and JSON alone: flies to each reported place, comes home and lands, at any pace.

mqtt_agent.yaml beside this file starts it behind the bridge; docs/mqtt-agents.md describes the topics.
"""

import asyncio
import json
import math
import os
import socket
import ssl
from collections import Counter
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import aiomqtt

URL, VEHICLE = urlsplit(os.environ["REBAR_MQTT"]), os.environ["REBAR_VEHICLE"]
PREFIX = URL.path.strip("/")
DEGREE_M, HEIGHT_M = 111_200.0, 30.0
ARRIVED = 450  # in 1e-7 degrees, as MAVLink states positions: some 5 m
ARM, TAKE_OFF, LAND, REPOSITION = 400, 22, 21, 192  # MAV_CMD
documents: dict[str, list[Any]] = {}  # every document that has come, by topic
mavlink: dict[str, Any] = {}  # the last message of each name


def wrapped(degrees: float) -> float:
    """The same longitude from -180 to 180: the date line lies in between."""
    return math.remainder(degrees, 360.0)


def fly() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """The flight in steps: a phase, and the message to send every two seconds until the next one."""
    while not mavlink.keys() >= {"HEARTBEAT", "GLOBAL_POSITION_INT"} or "mission" not in documents:
        yield "starting", "HEARTBEAT", {"type": 18, "autopilot": 8, "mavlink_version": 3}
    order, ground_m = documents["mission"][0], mavlink["GLOBAL_POSITION_INT"]["alt"] * 1e-3
    while mavlink["GLOBAL_POSITION_INT"]["relative_alt"] * 1e-3 < 0.8 * HEIGHT_M:
        armed = mavlink["HEARTBEAT"]["base_mode"] & 128
        up = {
            "command": TAKE_OFF,
            "param4": None,
            "param5": None,
            "param6": None,
            "param7": ground_m + HEIGHT_M,
        }
        yield "taking_off", "COMMAND_LONG", up if armed else {"command": ARM, "param1": 1}
    origin = order["origin"]
    for place in [*documents.get("intelligence", []), order["home"]]:
        east_deg = place["east_m"] / DEGREE_M / math.cos(math.radians(origin["latitude_deg"]))
        x = round((origin["latitude_deg"] + place["north_m"] / DEGREE_M) * 1e7)
        y = round(wrapped(origin["longitude_deg"] + east_deg) * 1e7)
        there = {"command": REPOSITION, "param1": 8, "param2": 1, "param4": None, "x": x, "y": y}
        while True:
            here = mavlink["GLOBAL_POSITION_INT"]
            if math.hypot(here["lat"] - x, wrapped((here["lon"] - y) * 1e-7) * 1e7) <= ARRIVED:
                break
            yield "searching", "COMMAND_INT", {**there, "z": ground_m + HEIGHT_M}
    while mavlink["HEARTBEAT"]["base_mode"] & 128:
        yield "landing", "COMMAND_LONG", {"command": LAND, "param4": None}
    while True:
        yield "complete", "HEARTBEAT", {"type": 18, "autopilot": 8, "mavlink_version": 3}


async def main() -> None:
    user, password = URL.username, os.environ["REBAR_MQTT_PASSWORD"]
    no_delay = [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)]
    tls = URL.scheme == "mqtts"
    async with aiomqtt.Client(
        str(URL.hostname),
        URL.port or 1883,
        username=user,
        password=password,
        tls_context=ssl.create_default_context(cafile=os.environ.get("REBAR_MQTT_CA")) if tls else None,
        socket_options=no_delay,
    ) as broker:
        received, sent, flight, due_s = Counter[str](), Counter[str](), fly(), 0.0
        tick: dict[str, Any] | None = None

        async def send(topic: str, document: dict[str, Any]) -> None:
            sent[topic] += 1
            await broker.publish(f"{PREFIX}/{topic}", json.dumps(document), qos=0)

        await broker.subscribe(f"{PREFIX}/#", qos=0)
        await send("bridge/ready", {"agent": "mqtt-agent"})
        async for message in broker.messages:
            topic, document = (
                str(message.topic).removeprefix(f"{PREFIX}/"),
                json.loads(bytes(message.payload)),
            )
            received[topic] += 1
            documents.setdefault(topic.rpartition("/")[2], []).append(document)
            if topic == "mavlink/onboard/to_agent":
                mavlink[document["name"]] = document["fields"]
            tick = document if topic == "bridge/tick" else tick
            # MQTT keeps the order of one topic alone: a tick counts once all that it states is here. In real time a broker
            # may have dropped a message, and nobody waits.
            states = tick["topics"] if tick is not None and tick["lockstep"] else {}
            if tick is None or any(received[name] < count for name, count in states.items()):
                continue
            if (time_s := tick["time_ns"] * 1e-9) >= due_s:
                due_s = time_s + 2.0
                phase, name, fields = next(flight)
                await send(f"{VEHICLE}/agent/status", {"time_s": time_s, "phase": phase})
                target = {} if name == "HEARTBEAT" else {"target_system": 1, "target_component": 1}
                await send("mavlink/onboard/from_agent", {"name": name, "fields": {**target, **fields}})
            await send("bridge/ack", {"number": tick["number"], "topics": dict(sent)})
            tick = None


asyncio.run(main())
