"""How fast an unmodified agent flies in warp: simulated seconds for each second of the host's clock, and of CPU time.

    python benchmarks/warp_speed.py [--sessions 5] [SIMSPEC ...]

Without a SimSpec it flies examples/patrol.yaml. The sessions of one SimSpec fly one after the other in this process, as in a
worker of a campaign. "In flight" begins with the agent's first message: starting the agent and importing what it needs is
left out. Equal digests of recordings say that nothing about a flight depended on the host.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

from bench.agents import load_manifest, open_agent
from bench.campaign import versions
from bench.contracts import Record
from bench.realization import place
from bench.recording import open_recording
from bench.simspec import SimSpec, load_simspec
from bench.simulation import SessionPlan, run_session

ROOT = Path(__file__).parents[1]


def fly(simspec: SimSpec, folder: Path) -> tuple[float, float]:
    """Fly one session and print a line; simulated seconds for each second of the clock, in the session and in flight."""
    manifest, manifest_folder = load_manifest(simspec.agent.manifest)
    first_words: list[tuple[float, float]] = []
    (folder / "agent").mkdir()
    with open_recording(
        folder / "recording.mcap", simspec=simspec, versions=versions(), metadata={}
    ) as recording:

        def note_first_words(record: Record) -> None:
            recording(record)
            if not first_words and record.topic.endswith("from_agent"):
                first_words.append((record.time.s, time.monotonic()))

        plan = SessionPlan(simspec, manifest, manifest_folder, open_agent, folder / "agent", note_first_words)
        end = run_session(plan)
        ended_s = time.monotonic()
    speed = end.simulated_s / end.wall_s
    spoken_s, spoken_at_s = first_words[0] if first_words else (0.0, ended_s - end.wall_s)
    in_flight = (end.simulated_s - spoken_s) / (ended_s - spoken_at_s)
    print(
        f"{end.outcome} after {end.simulated_s:.2f} simulated s: {speed:.1f} for each s of the clock, {in_flight:.1f} in flight, "
        f"{end.simulated_s / (end.cpu_s + end.agent_cpu_s):.1f} for each CPU s (bench {end.cpu_s:.2f}, agent "
        f"{end.agent_cpu_s:.2f}); load {os.getloadavg()[0]:.1f}; recording {str(recording.sha256)[:12]}",
        flush=True,
    )
    return speed, in_flight


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("simspecs", nargs="*", type=Path, default=[ROOT / "examples" / "patrol.yaml"])
    parser.add_argument("--sessions", type=int, default=5)
    options = parser.parse_args()
    paths = [path.resolve() for path in options.simspecs]
    # Manifests in the examples are named from here.
    os.chdir(ROOT)
    for path in paths:
        simspec = load_simspec(path)
        simspec = place(simspec.model_copy(update={"pace": simspec.pace.model_copy(update={"mode": "warp"})}))
        print(path.name)
        speeds = []
        for _ in range(options.sessions):
            with tempfile.TemporaryDirectory() as folder:
                speeds.append(fly(simspec, Path(folder)))
        # The first session imports what the others find in memory.
        session, in_flight = (statistics.median(column) for column in zip(*speeds[1:] or speeds, strict=True))
        print(f"median without the first: {session:.1f}, in flight {in_flight:.1f}")


if __name__ == "__main__":
    main()
