"""What the MQTT bridge takes: `python benchmarks/mqtt_bridge.py [SIMULATED_S]`, at most so long a flight (60).

Flies examples/mqtt/mqtt_agent.yaml in the scene of examples/search.yaml, in lockstep and in real time. `broker` is the way
of a tick from the bridge through the broker and back to it, behind all messages of its moment; `answer` is the time from a
tick to the agent's acknowledgement.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
LINE = "mqtt bridge: {"


def main() -> None:
    limit_s = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    for pace in ("lockstep", "realtime"):
        with tempfile.TemporaryDirectory() as folder:
            result, use = fly(Path(folder), pace, limit_s)
        per_s = (use["to_agent"] + use["from_agent"]) / result["simulated_s"]
        print(
            f"{pace}: {result['outcome']}, {result['simulated_s']:.0f} simulated s in {result['wall_s']:.0f} s; "
            f"{per_s:.0f} messages a simulated s; bridge, broker and agent {result['agent_cpu_s']:.1f} CPU s, "
            f"bench {result['cpu_s']:.1f}"
        )
        for name in ("broker", "answer"):
            if use[name]:
                print(
                    f"  {name}: median {use[name]['median_ms']:.1f} ms, 99 % {use[name]['p99_ms']:.1f} ms, "
                    f"most {use[name]['max_ms']:.1f} ms"
                )


def fly(folder: Path, pace: str, limit_s: float) -> tuple[dict, dict]:  # type: ignore[type-arg]
    """The result of one session, and what the bridge says of itself."""
    spec = yaml.safe_load((ROOT / "examples" / "search.yaml").read_text())
    spec["agent"] = {"manifest": str(ROOT / "examples" / "mqtt" / "mqtt_agent.yaml")}
    spec["pace"] = {"mode": pace}
    spec["mission"]["time_limit_s"] = limit_s
    (folder / "simspec.yaml").write_text(yaml.safe_dump(spec))
    command = [sys.executable, "-m", "bench.cli", "simulate", "simspec.yaml", "--out", "out"]
    subprocess.run(command, cwd=folder, check=False, stdout=subprocess.DEVNULL)
    result = json.loads((folder / "out" / "result.json").read_text())
    (line,) = (
        line for line in (folder / "out" / "agent.log").read_text().splitlines() if line.startswith(LINE)
    )
    return result, json.loads(line.removeprefix("mqtt bridge: "))


if __name__ == "__main__":
    main()
