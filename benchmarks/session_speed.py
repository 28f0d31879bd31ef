"""Simulated seconds for each CPU second of one core, in one run: vehicle alone, vehicle with a client, whole session in lockstep.

Run: python benchmarks/session_speed.py [simulated seconds of the first two]

The session is examples/search.yaml with the naive agent; its CPU seconds are the session's and the agent's together, start-up
of the agent's process included. Process CPU time, so that a loaded machine disturbs it little; the last column sets each
figure against the first.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from vehicle_speed import plant_alone, with_controller

from bench import fly_realization, load_simspec, place
from bench.campaign import load_asked

EXAMPLE = Path(__file__).parents[1] / "examples" / "search.yaml"


def whole_session() -> tuple[float, float, float]:
    """Simulated seconds, and CPU seconds of the session and of the agent."""
    with tempfile.TemporaryDirectory() as folder:
        result = fly_realization(place(load_simspec(EXAMPLE)), load_asked("search-and-report"), Path(folder), "speed")
    return result.simulated_s, result.cpu_s, result.agent_cpu_s


def main(span_s: float = 120.0) -> None:
    whole_session()  # imports and caches
    simulated_s, session_s, agent_s = whole_session()
    rows = [
        ("vehicle alone (cascade, gusts)", span_s / plant_alone(span_s)),
        ("vehicle, controller, one client", span_s / with_controller(span_s, "onboard")[0]),
        ("whole session in lockstep", simulated_s / (session_s + agent_s)),
    ]
    print(f"{'':36}{'sim s / CPU s':>14}{'of the first':>14}")
    for name, speed in rows:
        print(f"{name:36}{speed:14.0f}{speed / rows[0][1]:14.3f}")
    print(f"the session: {simulated_s:.0f} simulated s, {session_s:.2f} CPU s of its own, {agent_s:.2f} of the agent")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 120.0)
