"""Simulated seconds for each CPU second of one core, in one run: vehicle alone, vehicle with a client, whole
session in lockstep.

Run: python benchmarks/session_speed.py [simulated seconds of the first two]

The session is examples/search.yaml with the naive agent; its CPU seconds are the session's and the agent's
together, start-up of the agent's process included. Process CPU time, and the best of three rounds in which
all take their turn, so that a loaded machine disturbs it little; the last column sets each figure against the
first.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from vehicle_speed import best, plant_alone, with_controller

from bench import load_simspec, place
from bench.campaign import load_measurable_decomposition
from bench.campaign.execution._flight import fly_here

EXAMPLE = Path(__file__).parents[1] / "examples" / "search.yaml"


def whole_session() -> tuple[float, float, float]:
    """Simulated seconds, and CPU seconds of the session and of the agent."""
    with tempfile.TemporaryDirectory() as folder:
        result = fly_here(
            place(load_simspec(EXAMPLE)),
            load_measurable_decomposition("search-and-report"),
            Path(folder),
            "speed",
        )
    return result.simulated_s, result.cpu_s, result.agent_cpu_s


def main(span_s: float = 60.0) -> None:
    simulated_s, _, _ = whole_session()  # imports and caches

    def session() -> tuple[float, float]:
        _, session_s, agent_s = whole_session()
        return session_s + agent_s, agent_s

    result = best(
        {
            "vehicle alone (cascade, gusts)": lambda: (plant_alone(span_s), 0.0),
            "vehicle, controller, one client": lambda: with_controller(span_s, "onboard"),
            "whole session in lockstep": session,
        }
    )
    (alone_s, _), (flown_s, _), (all_s, agent_s) = result.values()
    print(f"{'':36}{'sim s / CPU s':>14}{'of the first':>14}")
    for name, speed in zip(result, (span_s / alone_s, span_s / flown_s, simulated_s / all_s), strict=True):
        print(f"{name:36}{speed:14.0f}{speed * alone_s / span_s:14.3f}")
    print(
        f"the session: {simulated_s:.0f} simulated s, {all_s - agent_s:.2f} CPU s of its own, {agent_s:.2f} of the agent"
    )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
