"""A cheating agent, started by the bench from cheat.yaml."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

# Started as a file: the package is found from the folder above it.
sys.path.insert(0, str(Path(__file__).parents[1]))

from agent_adapters.client import open_bench, read_environment
from bench.errors import Fault, LinkLost, SetupError
from cheats._catalogue import CHEATS, Entry
from cheats._cheat import LINK, Cheat
from cheats._ticks import breach

# Simulated time at which a trick begins: the session is under way, and everything of it is in place.
_BEGIN_S = 0.3
# What only a session gives.
_SESSION = ("REBAR_VEHICLE", "REBAR_MAVLINK", "REBAR_ZENOH", "REBAR_TICK", "REBAR_TICK_SECRET")


def main() -> int:
    """0 when the session ended in order, 1 when the bench was lost, 2 outside a session."""
    parser = argparse.ArgumentParser(description="An agent that cheats, to show that it gains nothing.")
    parser.add_argument("trick", choices=sorted(CHEATS))
    name: str = parser.parse_args().trick
    # The bench ends an agent by SIGTERM; what was gained is to be printed all the same.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        run(name, CHEATS[name])
    except SetupError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except LinkLost as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


def run(name: str, entry: Entry) -> None:
    """Follow one session to its end, and print what the trick got. Raises SetupError outside a session."""
    if missing := [variable for variable in _SESSION if not os.environ.get(variable)]:
        raise SetupError(
            Fault(
                f"cheat-{name}",
                f"this is no session ({', '.join(missing)} not set): cheats are test material and run nowhere else",
                f"let the bench start it in lockstep, with agent.manifest: tests/agent_adapters/cheats/cheat.yaml and agent.options.trick: {name} in a SimSpec",
            )
        )
    environment = read_environment(os.environ, {LINK: "REBAR_MAVLINK"})
    with open_bench(f"cheat_{name.replace('-', '_')}", environment) as bench:
        cheat = Cheat(bench)
        try:
            if entry.breach is not None:
                cheat.attempts = 1
                cheat.gains = {"ticks": breach(bench, entry.breach)}
            elif entry.trick is not None:
                _play(cheat, name, entry)
        finally:
            # On a line of its own, whatever the trick has printed.
            got = {"cheat": name, "attempts": cheat.attempts, "gains": cheat.gains}
            print(f"\n{json.dumps(got)}", flush=True)


def _play(cheat: Cheat, name: str, entry: Entry) -> None:
    assert entry.trick is not None
    steps = entry.trick(cheat)
    for moment in cheat.bench.moments(f"cheat-{name}"):
        cheat.receive(moment)
        if cheat.now_s >= _BEGIN_S:
            # A trick that is over stays silent until the session is.
            with suppress(StopIteration):
                next(steps)


if __name__ == "__main__":
    sys.exit(main())
