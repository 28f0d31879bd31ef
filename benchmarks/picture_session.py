"""Simulated seconds for each CPU second of a session in lockstep, with and without a listener to the camera.

Run: python benchmarks/picture_session.py

The session is examples/search.yaml with a 640x480 camera at 5 Hz, flown to its end. Its agent is the reference agent, which leaves the pictures
unread; the listener is a subscription of the same agent. CPU seconds are those of the session and the agent together,
recording and start-up included. The sessions take their turn, and the best of the rounds counts, so that a loaded machine
disturbs the ratio little.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from agent_adapters.client import Wanted, open_bench, read_environment
from agent_adapters.reference._agent import LINK, Agent, AgentParts, wanted
from agent_adapters.reference._settings import Settings
from bench import load_simspec, place
from bench.agents import open_agent
from bench.contracts import AgentManifest, MavlinkNeed, VehicleTopics
from bench.recording import open_recording
from bench.simspec import SimSpec
from bench.simulation import SessionPlan, run_session
from bench.streams import CompressedImage, Image

FOLDER = Path(__file__).parent
EXAMPLE = FOLDER.parent / "examples" / "search.yaml"
KINDS = ("nobody", "raw", "jpeg", "both")
ROUNDS = 2


def fly_as_agent(listener: str) -> None:
    """The reference agent, with subscriptions to pictures beside its own."""
    environment = read_environment(os.environ)
    settings, topics = Settings.of(environment.options, "naive"), VehicleTopics(environment.vehicle)
    subscriptions = wanted(environment, settings.camera)
    if listener in ("raw", "both"):
        subscriptions.append(Wanted(topics.image_raw(settings.camera), Image))
    if listener in ("jpeg", "both"):
        subscriptions.append(Wanted(topics.image_compressed(settings.camera), CompressedImage))
    with open_bench("listener", environment, subscriptions) as bench:
        parts = AgentParts.of(environment.vehicle, bench.links[LINK], bench.publish, "naive", settings)
        agent = Agent(environment.vehicle, parts)
        for moment in bench.moments("listener"):
            agent.act(moment)


def session(simspec: SimSpec, listener: str) -> tuple[float, float]:
    """Simulated seconds, and CPU seconds of session and agent."""
    manifest = AgentManifest(
        name=f"listener-{listener}",
        command=("{python}", "{folder}/picture_session.py", "--agent", listener),
        pace=("lockstep",),
        mavlink=(MavlinkNeed(),),
    )
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "recording.mcap"
        with open_recording(recording, simspec=simspec, versions={}) as recorder:
            end = run_session(
                SessionPlan(simspec, manifest, FOLDER, open_agent, Path(folder) / "agent", recorder)
            )
    assert end.outcome.counts, f"{end.outcome}: {end.reason}"
    return end.simulated_s, end.cpu_s + end.agent_cpu_s


def main() -> None:
    """Print the table."""
    simspec = place(load_simspec(EXAMPLE))
    camera = simspec.vehicle.camera.model_copy(update={"width_px": 640, "height_px": 480, "rate_hz": 5.0})
    simspec = simspec.model_copy(
        update={
            "vehicle": simspec.vehicle.model_copy(update={"camera": camera}),
        }
    )
    speeds = dict.fromkeys(KINDS, 0.0)
    for _ in range(ROUNDS):
        for listener in KINDS:
            simulated_s, cpu_s = session(simspec, listener)
            speeds[listener] = max(speeds[listener], simulated_s / cpu_s)
    print(f"{'listener':12}{'sim s / CPU s':>14}{'of nobody':>12}{'ms a frame':>12}")
    for listener, speed in speeds.items():
        frame_ms = 1e3 * (1.0 / speed - 1.0 / speeds["nobody"]) / camera.rate_hz
        print(f"{listener:12}{speed:14.1f}{speed / speeds['nobody']:12.3f}{frame_ms:12.1f}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--agent"]:
        fly_as_agent(sys.argv[2])
    else:
        main()
