"""Fake agents, each of which does one thing, good or bad, and their manifests.

They speak the tick protocol by hand, with nothing but the standard library and one Zenoh put, and show at the same time
how little an agent in another language needs.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from bench.contracts import AgentManifest

BEHAVIOURS = {
    "idle": "acknowledges every tick and does nothing",
    "finish": "says at once that its mission is complete",
    "crash": "exits with code 3 at the tenth tick",
    "hang": "stops answering at the tenth tick",
    "silent": "never connects",
    "mute": "connects and never says hello",
    "babble": "answers a tick with a line that is no message",
    "liar": "claims MAVLink messages that it never sent",
    "pretender": "says it subscribes to a topic and does not",
    "leaver": "closes the tick socket and lives on",
    "spam": "publishes far more than anybody needs",
    "dawdle": "takes 0.3 s of the host's time for each answer",
    "flood": "writes to stdout without end while it answers",
}
# Late enough that the session is under way, early enough for a quick test.
TURN = 10


def agent_manifest(behaviour: str) -> AgentManifest:
    """The manifest of a fake agent."""
    # Imported here: an agent that publishes nothing needs nothing of the bench.
    from bench.contracts import AgentManifest, MavlinkNeed

    return AgentManifest(
        name=f"fake-{behaviour}",
        description=BEHAVIOURS[behaviour],
        command=("{python}", str(Path(__file__).resolve()), "--behaviour", behaviour),
        pace=("lockstep", "realtime"),
        mavlink=(MavlinkNeed(),),
    )


def main() -> None:
    """Run one behaviour until the bench ends it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--behaviour", choices=sorted(BEHAVIOURS), required=True)
    behaviour: str = parser.parse_args().behaviour
    if behaviour == "silent":
        time.sleep(3600)
    host, port = os.environ["REBAR_TICK"].rsplit(":", 1)
    with socket.create_connection((host, int(port))) as connection:
        if behaviour == "mute":
            time.sleep(3600)
        subscribes = ["/clock"] if behaviour == "pretender" else []
        say(
            connection,
            {
                "kind": "hello",
                "protocol": 1,
                "agent": f"fake-{behaviour}",
                "subscribes": subscribes,
                "secret": os.environ["REBAR_TICK_SECRET"],
            },
        )
        for line in connection.makefile("rb"):
            message = json.loads(line)
            if message["kind"] == "end":
                return
            answer(connection, behaviour, message["number"])


def answer(connection: socket.socket, behaviour: str, number: int) -> None:
    """Answer one tick in the manner of the behaviour."""
    topics: dict[str, int] = {}
    links: dict[str, int] = {}
    if behaviour == "finish":
        topics = finish(number)
    elif behaviour == "spam":
        topics = finish(number, phase="searching", times=1500)
    elif behaviour == "dawdle":
        time.sleep(0.3)
    elif behaviour == "flood":
        sys.stdout.write("all work and no play\n" * 1000)
    if number >= TURN:
        if behaviour == "crash":
            sys.stderr.write("this agent gives up\n")
            sys.exit(3)
        if behaviour == "hang":
            time.sleep(3600)
        if behaviour == "babble":
            connection.sendall(b"good morning\n")
            return
        if behaviour == "leaver":
            connection.shutdown(socket.SHUT_RDWR)
            time.sleep(3600)
        if behaviour == "liar":
            links = {"onboard": 7}
    say(connection, {"kind": "ack", "number": number, "topics": topics, "links": links})


def finish(
    number: int, phase: Literal["complete", "searching"] = "complete", times: int = 1
) -> dict[str, int]:
    """Publish a status document; the count of it belongs into every ack from then on."""
    # Imported here: only behaviours that publish need the middleware.
    from bench.contracts import AgentStatus, VehicleTopics, document_text
    from bench.streams import AirAccess, String, open_client

    topic = VehicleTopics(os.environ["REBAR_VEHICLE"]).status
    if number == 0:
        access = AirAccess(
            locator=os.environ["REBAR_ZENOH"],
            user=os.environ["REBAR_ZENOH_USER"],
            password=os.environ["REBAR_ZENOH_PASSWORD"],
            domain=int(os.environ["ROS_DOMAIN_ID"]),
        )
        client = open_client(access, "finisher")
        # Never closed: the node lives as long as the process, as that of an agent which is killed.
        node = client.__enter__()
        publisher = node.publisher(topic, String)
        for _ in range(times):
            publisher.put(String(document_text(AgentStatus(time_s=0.0, phase=phase))))
        _open_clients.append(client)
    return {topic: times}


# Without a reference, the client would be collected and its session closed.
_open_clients: list[object] = []


def say(connection: socket.socket, message: dict[str, object]) -> None:
    """Send one line."""
    connection.sendall(json.dumps(message).encode() + b"\n")


if __name__ == "__main__":
    main()
