"""What the bench hands over to an agent when it starts it."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import NoReturn

from bench.errors import Fault, LinkLost, SetupError
from bench.values import value_class

Option = str | float | int | bool


@value_class(frozen=True, slots=True)
class AgentEnvironment:
    """The REBAR_* variables, parsed.

    `tick` is None in the realtime pace, `tick_secret` is what the hello must bear; `zenoh` is None for a MAVLink-only agent.
    """

    vehicle: str
    mavlink: Mapping[str, str]
    zenoh: str | None
    zenoh_user: str
    zenoh_password: str
    domain: int
    tick: tuple[str, int] | None
    options: Mapping[str, Option]
    seed: int
    tick_secret: str = field(default="", repr=False)


def read_environment(
    variables: Mapping[str, str], links: Mapping[str, str] | None = None
) -> AgentEnvironment:
    """Parse the environment; `links` maps link names to the variables that hold their connection strings.

    Raises SetupError with every variable that is missing or cannot be read.
    """
    links = {"onboard": "REBAR_MAVLINK"} if links is None else links
    faults = [
        Fault(
            name,
            "is not set",
            "start this program through the bench, or set the variables of docs/agents-protocol.md",
        )
        for name in ("REBAR_VEHICLE", *links.values())
        if not variables.get(name)
    ]
    tick = _host_and_port(variables.get("REBAR_TICK"), faults)
    domain = _integer("ROS_DOMAIN_ID", variables.get("ROS_DOMAIN_ID", "0"), faults)
    seed = _integer("REBAR_SEED", variables.get("REBAR_SEED", "0"), faults)
    options = _options(variables.get("REBAR_OPTIONS", "{}"), faults)
    if faults:
        raise SetupError(faults)
    return AgentEnvironment(
        vehicle=variables["REBAR_VEHICLE"],
        mavlink={name: variables[variable] for name, variable in links.items()},
        zenoh=variables.get("REBAR_ZENOH"),
        zenoh_user=variables.get("REBAR_ZENOH_USER", ""),
        zenoh_password=variables.get("REBAR_ZENOH_PASSWORD", ""),
        domain=domain,
        tick=tick,
        options=options,
        seed=seed,
        tick_secret=variables.get("REBAR_TICK_SECRET", ""),
    )


def use_one_thread() -> None:
    """Keep NumPy to the calling thread, where nobody has said otherwise. To be called before NumPy is first imported.

    The threads of its linear algebra cost a third of its import, and sessions already run one on each core.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def exit_code(fly: Callable[[], str]) -> int:
    """Fly one session, and say on standard error why it ended: 0 when it ended in order, 1 when the bench or the vehicle
    was lost, 2 when the agent was started wrongly.
    """
    try:
        code, text = 0, fly()
    except SetupError as error:
        code, text = 2, str(error)
    except LinkLost as error:
        code, text = 1, str(error)
    sys.stderr.write(f"{text}\n")
    return code


def end_process(code: int) -> NoReturn:
    """End at once with an exit code, when everything is closed. Nothing runs after it, exit handlers included.

    To take down what Python has imported costs 0.1 CPU seconds, for which the bench waits.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _host_and_port(text: str | None, faults: list[Fault]) -> tuple[str, int] | None:
    if text is None:
        return None
    host, _, port = text.rpartition(":")
    if host and port.isdigit() and 0 < int(port) < 65536:
        return host, int(port)
    faults.append(Fault("REBAR_TICK", f"{text!r} is not host:port", "for example 127.0.0.1:4000"))
    return None


def _integer(name: str, text: str, faults: list[Fault]) -> int:
    try:
        return int(text)
    except ValueError:
        faults.append(Fault(name, f"{text!r} is not a whole number", "for example 0"))
        return 0


def _options(text: str, faults: list[Fault]) -> Mapping[str, Option]:
    try:
        options = json.loads(text)
    except ValueError:
        options = None
    if isinstance(options, dict):
        return options
    faults.append(Fault("REBAR_OPTIONS", "is not a JSON object", 'for example {"altitude_m": 40}'))
    return {}
