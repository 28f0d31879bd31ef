"""`python -m agent_adapters.mqtt [OPTIONS] [-- COMMAND...]`, the command of an agent that speaks MQTT."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from agent_adapters.client import Tick, open_link, open_tick_line, read_environment
from bench.errors import LinkLost, SetupError

from ._bridge import AgentEnded, AgentSide, Bridge
from ._broker import BrokerAddress, broker_address, open_own_broker
from ._connection import BrokerConnection, open_connection
from ._topics import ACK, LINK, MAVLINK_FROM_AGENT, READY, TICK, topics_from_agent, topics_to_agent

LINK_VARIABLE = "REBAR_MAVLINK"
# What the bridge uses itself. The agent that it starts could only disturb it with these.
_OWN_VARIABLES = ("REBAR_TICK", "REBAR_TICK_SECRET")
# More often than the bench has anything new: everything goes on at once.
_INTERVAL_S = 0.005
# Host seconds for the agent to exit by itself after the end: less than what the bench gives the bridge (0.25 s).
_LEAVE_S = 0.15
_KILL_AFTER_S = 1.0


class _Terminated(Exception):
    """The bench has asked the bridge to end."""


def main() -> int:
    """0 when the session ended in order, 1 when bench or broker were lost, 2 when the bridge was started wrongly, else the
    exit code of the agent that it started.
    """
    arguments = _parser().parse_args()
    signal.signal(signal.SIGTERM, _terminate)
    try:
        _run(arguments)
        return 0
    except (SetupError, LinkLost) as error:
        sys.stderr.write(f"mqtt bridge: {error}\n")
        return 2 if isinstance(error, SetupError) else 1
    except AgentEnded as error:
        if error.code:
            sys.stderr.write(f"mqtt bridge: the agent ended with exit code {error.code}\n")
        # A signal's negative number is no exit code: 128 and the signal, as shells have it.
        return error.code if error.code >= 0 else 128 - error.code
    except _Terminated:
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m agent_adapters.mqtt", description=__doc__)
    parser.add_argument(
        "--broker", help="service:NAME, mqtt://HOST or mqtts://USER@HOST; a mosquitto of one's own without it"
    )
    parser.add_argument("--password-file", type=Path, help="the password for the broker, in its first line")
    parser.add_argument("--ca", type=Path, help="certificates (PEM) that vouch for the broker's")
    parser.add_argument("--port", type=int, default=0, help="of a broker of one's own (default: a free one)")
    parser.add_argument("--camera", action="append", help="a camera's name; may be repeated (default: front)")
    parser.add_argument("--pictures", action="store_true", help="mirror the cameras' pictures (JPEG)")
    parser.add_argument(
        "--no-mavlink", action="store_true", help="leave REBAR_MAVLINK to the agent; not in lockstep"
    )
    parser.add_argument("command", nargs="*", help="the agent; without it, one that runs elsewhere")
    return parser


def _run(arguments: argparse.Namespace) -> None:
    connections = {} if arguments.no_mavlink or LINK_VARIABLE not in os.environ else {LINK: LINK_VARIABLE}
    environment = read_environment(os.environ, connections)
    if environment.tick is None or environment.zenoh is not None:
        remedy = "write air: tick into the manifest"
        raise SetupError(
            "air", "is not tick, and the bridge has the air network from the tick socket", remedy
        )
    allowed = topics_from_agent(environment.vehicle)
    wanted = topics_to_agent(environment.vehicle, arguments.camera or ["front"], pictures=arguments.pictures)
    accepted = (*allowed, *([MAVLINK_FROM_AGENT] if connections else []))
    with ExitStack() as stack:
        address = stack.enter_context(_open_broker(arguments))
        subscriptions = (*accepted, READY, ACK, TICK)
        connection: BrokerConnection = stack.enter_context(open_connection(address, subscriptions))
        process = stack.enter_context(_open_agent(address, arguments.command))
        agent = AgentSide(connection, accepted, process)
        while not agent.name:
            agent.look()
        # Before the hello, after which the vehicle sends.
        link = stack.enter_context(open_link(LINK, environment.mavlink[LINK])) if connections else None
        ticks = stack.enter_context(open_tick_line(environment.tick))
        ticks.hello(agent.name, wanted, environment.tick_secret, _INTERVAL_S)
        first = ticks.next()
        # Lockstep names every topic in `topics`. The other paces count nothing, because nobody waits for it.
        agent.in_lockstep = isinstance(first, Tick) and bool(first.topics)
        if arguments.no_mavlink and agent.in_lockstep:
            remedy = "leave it out, or fly in real time"
            raise SetupError("--no-mavlink", "lockstep counts the messages of all links", remedy)
        bridge = Bridge(ticks, link, connection, agent, allowed)
        try:
            sys.stderr.write(f"{bridge.run(first)}\n")
        finally:
            sys.stderr.write(f"mqtt bridge: {json.dumps(bridge.use())}\n")


@contextmanager
def _open_broker(arguments: argparse.Namespace) -> Iterator[BrokerAddress]:
    if arguments.broker:
        yield broker_address(arguments.broker, arguments.password_file, arguments.ca, os.environ)
        return
    with open_own_broker(Path.home(), arguments.port) as address:
        yield address


@contextmanager
def _open_agent(address: BrokerAddress, command: list[str]) -> Iterator[subprocess.Popen[bytes] | None]:
    """The agent that the bridge starts, if any; leaving the block ends it."""
    if not command:
        sys.stderr.write(f"mqtt bridge: waiting for an agent on {address.prefix}/{READY}\n")
        yield None
        return
    variables = {name: value for name, value in os.environ.items() if name not in _OWN_VARIABLES}
    variables |= {"REBAR_MQTT": address.agent_url, "REBAR_MQTT_PASSWORD": address.agent.password}
    if address.authority is not None:
        variables["REBAR_MQTT_CA"] = str(address.authority.resolve())
    try:
        process = subprocess.Popen(command, env=variables)
    except OSError as error:
        remedy = "correct what stands behind -- in the manifest"
        raise SetupError("command", f"{command[0]!r} cannot be started: {error}", remedy) from error
    try:
        yield process
    finally:
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    with suppress(subprocess.TimeoutExpired):
        process.wait(_LEAVE_S)
    process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(_KILL_AFTER_S)
    process.kill()
    process.wait()


def _terminate(_: int, __: object) -> None:
    # Once: what ends the bridge in order must not be cut short by a second signal.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise _Terminated


if __name__ == "__main__":
    sys.exit(main())
