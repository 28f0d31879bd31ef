"""Simulated seconds for each CPU second of a session in lockstep, with and without somebody who needs the camera.

Run: python benchmarks/picture_session.py [KIND...]

The session is examples/search.yaml with a 640x480 camera at 5 Hz, flown to its end. Its agent is the reference agent,
which leaves the pictures unread; the listener is a subscription of the same agent. `blind` is a detector on the pictures
that finds nothing, `small` the one that ships; in the other sessions detections are those of the truth. CPU seconds are
those of the session and the agent together, recording and start-up included. The sessions take their turn: the table has the
best of the rounds, the median, and the median ratio to the session for nobody of the same round, so that a loaded machine
disturbs the ratio little. Without compiled bytecode (PYTHONDONTWRITEBYTECODE) start-up takes seconds more.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from agent_adapters.client import Wanted, open_bench, read_environment
from agent_adapters.reference._agent import LINK, Agent, AgentParts, wanted
from agent_adapters.reference._settings import Settings
from bench import load_simspec, place
from bench.agents import open_agent
from bench.contracts import AgentManifest, Detection, MavlinkNeed, Pixels, VehicleTopics
from bench.recording import open_recording
from bench.simspec import Perception, SimSpec
from bench.simulation import SessionPlan, run_session
from bench.streams import CompressedImage, Image

FOLDER = Path(__file__).parent
EXAMPLE = FOLDER.parent / "examples" / "search.yaml"
LISTENERS = ("raw", "jpeg", "both")
KINDS = ("nobody", "blind", "small", *LISTENERS)
ROUNDS = 5


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


class BlindDetector:
    """Finds nothing, at no cost."""

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        return ()


def session(simspec: SimSpec, kind: str) -> tuple[float, float]:
    """Simulated seconds, and CPU seconds of session and agent."""
    listener = kind if kind in LISTENERS else "nobody"
    if kind in ("blind", "small"):
        simspec = simspec.model_copy(update={"perception": Perception(source="detector")})
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
                SessionPlan(
                    simspec,
                    manifest,
                    FOLDER,
                    open_agent,
                    Path(folder) / "agent",
                    recorder,
                    open_on_pixels=(lambda _: BlindDetector()) if kind == "blind" else None,
                )
            )
    assert end.outcome.counts, f"{end.outcome}: {end.reason}"
    return end.simulated_s, end.cpu_s + end.agent_cpu_s


def main(kinds: Sequence[str]) -> None:
    """Print the table of these kinds of session."""
    simspec = place(load_simspec(EXAMPLE))
    camera = simspec.vehicle.camera.model_copy(update={"width_px": 640, "height_px": 480, "rate_hz": 5.0})
    simspec = simspec.model_copy(
        update={
            "vehicle": simspec.vehicle.model_copy(update={"camera": camera}),
            "perception": Perception(source="truth"),
        }
    )
    speeds: dict[str, list[float]] = {kind: [] for kind in kinds}
    began = os.getloadavg()[0]
    for _ in range(ROUNDS):
        for kind in kinds:
            simulated_s, cpu_s = session(simspec, kind)
            speeds[kind].append(simulated_s / cpu_s)
    print(f"simulated seconds per CPU second, {ROUNDS} rounds, load {began:.1f} to {os.getloadavg()[0]:.1f}")
    print(f"{'for':12}{'best':>10}{'median':>10}{'of nobody':>12}{'ms a frame':>12}")
    for kind, of_rounds in speeds.items():
        pairs = list(zip(of_rounds, speeds["nobody"], strict=True))
        ratio = statistics.median(speed / nobody for speed, nobody in pairs)
        frame_ms = statistics.median(1e3 * (1.0 / speed - 1.0 / nobody) for speed, nobody in pairs)
        print(
            f"{kind:12}{max(of_rounds):10.1f}{statistics.median(of_rounds):10.1f}{ratio:12.3f}{frame_ms / camera.rate_hz:12.1f}"
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--agent"]:
        fly_as_agent(sys.argv[2])
    else:
        main(("nobody", *(kind for kind in KINDS[1:] if kind in sys.argv[1:])) if sys.argv[1:] else KINDS)
