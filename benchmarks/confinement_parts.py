"""What confinement costs, part by part: the start of a box, and each system call of the agent in it.

    python benchmarks/confinement_parts.py [--rung bwrap] [--starts 100] [--calls 300000] [--simspec examples/search.yaml]

A whole session's CPU time differs by several per cent from run to run on a busy host, more than the cost itself
(`confinement_cost.py`). Both parts here are short and taken in turn with `none`, so that their medians are steady. With
strace installed the system calls of a session's agent are counted, and the sum is put beside the session's CPU time.
An unconfined agent is not free of cost to the bench either: it looks through all processes for what the agent left.
"""

from __future__ import annotations

import argparse
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.agents import load_manifest, open_agent
from bench.agents.confinement import rungs
from bench.contracts import AgentEndpoints, AgentManifest, AgentPlan
from bench.simspec import SimSpec, load_simspec

ROOT = Path(__file__).parents[1]
# A cheap call, whose share of the filter is the largest that any call has; it is none of libc's or the vDSO's own.
CALLS = "import os, sys\nfor _ in range(int(sys.argv[1])): os.getppid()"
POLL_S = 0.001


def cpu_s() -> float:
    """CPU seconds of this process and of all its children that have ended."""
    usages = [resource.getrusage(process) for process in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def agent_cpu_s(rung: str, command: tuple[str, ...], spec: SimSpec) -> float:
    """CPU seconds of the bench and the agent for one agent, from before its start until all of it is gone."""
    manifest = AgentManifest(name="part", command=command, isolation=rung, zenoh=False)
    with tempfile.TemporaryDirectory() as folder:
        plan = AgentPlan(
            manifest, Path(folder), spec, AgentEndpoints({}, None, "", "", 0, None), Path(folder, "a")
        )
        before_s = cpu_s()
        with open_agent(plan) as agent:
            while agent.exit_code() is None:
                time.sleep(POLL_S)
        return cpu_s() - before_s


def difference_s(
    rung: str, command: tuple[str, ...], spec: SimSpec, pairs: int
) -> tuple[float, float, float]:
    """Median difference to `none` over pairs in turn, with a 95 % interval by order statistics."""
    differences = []
    for pair in range(pairs):
        order = (rung, "none") if pair % 2 else ("none", rung)
        spent = {name: agent_cpu_s(name, command, spec) for name in order}
        differences.append(spent[rung] - spent["none"])
    differences.sort()
    # The ranks between which a median lies with 95 % (binomial with one half, normal approximation).
    half = int(0.98 * pairs**0.5) + 1
    low, high = max(0, pairs // 2 - half), min(pairs - 1, pairs // 2 + half)
    return statistics.median(differences), differences[low], differences[high]


def session_calls(simspec: Path) -> int | None:
    """System calls of everything that a session's agent does, by strace; None without it."""
    if (strace := shutil.which("strace")) is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        counted = Path(folder, "calls")
        spec = load_simspec(simspec)
        manifest, _ = load_manifest(spec.agent.manifest)
        program = [sys.executable if word == "{python}" else word for word in manifest.command]
        traced = Path(folder, "traced.yaml")
        words = ", ".join(f'"{word}"' for word in [strace, "-f", "-c", "-o", str(counted), *program])
        links = "".join(
            f"  - {{name: {need.name}, kind: {need.kind}, streams: {need.streams}, variable: {need.variable}}}\n"
            for need in manifest.mavlink
        )
        traced.write_text(
            f"format: rebar.agent/1\nname: traced\ncommand: [{words}]\npace: [lockstep]\nmavlink:\n{links}zenoh: true\n"
            "isolation: none\nreset: process\n"
        )
        text = re.sub(
            r"^agent:.*$", f"agent: {{manifest: {traced}}}", simspec.read_text(), flags=re.MULTILINE
        )
        copy = Path(folder, "simspec.yaml")
        copy.write_text(text)
        rebar = str(Path(sys.executable).parent / "rebar")
        subprocess.run(
            [rebar, "simulate", str(copy), "--out", f"{folder}/out"], check=True, stdout=subprocess.DEVNULL
        )
        total = re.search(r"^\s*100\.00\s+[\d.]+\s+\d+\s+(\d+).*total$", counted.read_text(), re.MULTILINE)
        assert total, counted.read_text()[-500:]
        return int(total[1])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rung", default="bwrap", choices=["bwrap", "landlock"])
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--calls", type=int, default=300_000)
    parser.add_argument("--simspec", type=Path, default=ROOT / "examples" / "search.yaml")
    options = parser.parse_args()
    spec = load_simspec(options.simspec)
    if reason := rungs()[options.rung].trial():
        sys.exit(f"{options.rung} cannot start here: {reason}")
    nothing = ("{python}", "-I", "-S", "-c", CALLS, "0")
    start_s, start_low_s, start_high_s = difference_s(options.rung, nothing, spec, options.starts)
    print(
        f"start and end of the box: {1e3 * start_s:.1f} ms of CPU more than unconfined "
        f"({1e3 * start_low_s:.1f} to {1e3 * start_high_s:.1f}), {options.starts} pairs"
    )
    repeated = (*nothing[:-1], str(options.calls))
    added_s, *bounds_s = (
        (value_s - start_s) / options.calls for value_s in difference_s(options.rung, repeated, spec, 30)
    )
    low, high = (f"{1e9 * bound_s:.0f}" for bound_s in bounds_s)
    print(f"each system call: {1e9 * added_s:.0f} ns more ({low} to {high})")
    if (calls := session_calls(options.simspec)) is None:
        print("strace is not installed: the calls of a session are not counted")
        return
    before_s = cpu_s()
    with tempfile.TemporaryDirectory() as folder:
        rebar = str(Path(sys.executable).parent / "rebar")
        subprocess.run(
            [rebar, "simulate", str(options.simspec), "--isolation", "none", "--out", f"{folder}/out"],
            check=True,
            stdout=subprocess.DEVNULL,
        )
    session_s = cpu_s() - before_s
    cost_s = start_high_s + calls * bounds_s[-1]
    print(
        f"a session: {calls} system calls of its agent, {session_s:.2f} s of CPU unconfined; start and calls by "
        f"their upper bounds {1e3 * cost_s:.0f} ms, {100 * cost_s / session_s:.2f} %"
    )


if __name__ == "__main__":
    main()
