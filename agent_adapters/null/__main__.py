"""`python -m agent_adapters.null BEHAVIOUR`, started by the bench from a manifest."""

from __future__ import annotations

import argparse
import os
import signal
from contextlib import suppress

from agent_adapters.client import Wanted, end_process, exit_code, open_bench, read_environment
from bench.clock import CLOCK
from bench.streams import Clock

from ._autopilot import LINK, Autopilot
from ._behaviours import BEHAVIOURS, Behaviour
from ._session import NullSession, subscriptions


def main() -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m agent_adapters.null", description="An agent that does not do what is asked of it."
    )
    parser.add_argument("behaviour", choices=sorted(BEHAVIOURS))
    name: str = parser.parse_args().behaviour
    return exit_code(lambda: run(name, BEHAVIOURS[name]))


def run(name: str, behaviour: Behaviour) -> str:
    """Follow one session to its end; returns why it ended. Raises SetupError and LinkLost."""
    links = {LINK: "REBAR_MAVLINK"} if behaviour.flies else {}
    environment = read_environment(os.environ, links)
    wanted = subscriptions(environment.vehicle, behaviour.listens) if environment.zenoh else []
    if environment.tick is None:
        if not wanted:
            # It hears no clock, so nothing would tell it the time; the bench ends it.
            signal.pause()
        wanted.append(Wanted(CLOCK, Clock))
    with open_bench(f"null_{name.replace('-', '_')}", environment, wanted) as bench:
        session = NullSession(environment.vehicle, bench.publish, environment.seed)
        autopilot = Autopilot(bench.links[LINK]) if behaviour.flies else None
        steps = behaviour.steps(session, autopilot) if behaviour.steps else iter(())
        for moment in bench.moments(f"null-{name}"):
            session.receive(moment)
            if autopilot is not None:
                autopilot.receive(moment)
            # A behaviour that has ended stays silent until the session is over.
            with suppress(StopIteration):
                next(steps)
        return bench.ended


if __name__ == "__main__":
    end_process(main())
