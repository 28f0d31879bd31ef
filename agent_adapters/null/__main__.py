"""`python -m agent_adapters.null BEHAVIOUR`, started by the bench from a manifest."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from contextlib import suppress

from agent_adapters.client import Wanted, end_process, open_bench, read_environment
from bench.clock import CLOCK
from bench.errors import LinkLost, SetupError
from bench.streams import Clock

from ._autopilot import LINK, Autopilot
from ._behaviours import BEHAVIOURS, Behaviour
from ._session import NullSession, subscriptions


def main() -> int:
    """0 when the session ended in order, 1 when the bench was lost, 2 when the agent was started wrongly."""
    parser = argparse.ArgumentParser(
        prog="python -m agent_adapters.null", description="An agent that does not do what is asked of it."
    )
    parser.add_argument("behaviour", choices=sorted(BEHAVIOURS))
    name: str = parser.parse_args().behaviour
    try:
        run(name, BEHAVIOURS[name])
    except SetupError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except LinkLost as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


def run(name: str, behaviour: Behaviour) -> None:
    """Follow one session to its end. Raises SetupError and LinkLost."""
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


if __name__ == "__main__":
    end_process(main())
