"""What confinement costs: the same session on two rungs in turn, by the CPU time of everything that it started.

    python benchmarks/confinement_cost.py [--pairs 8] [--rung bwrap] [--simspec examples/search.yaml]

Pairs alternate their order, so that a slow drift of the host falls on both sides. The ratio is printed for each pair
with the median and a 95 % interval of the mean of its logarithm.
"""

from __future__ import annotations

import argparse
import math
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Of Student's t with as many degrees of freedom; beyond the table the normal distribution's is near enough.
T_975 = {7: 2.365, 9: 2.262, 11: 2.201, 15: 2.131, 19: 2.093}


def cpu_s(simspec: Path, rung: str) -> float:
    """CPU seconds of `rebar simulate`, its worker, the box and the agent."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        command = [str(Path(sys.executable).parent / "rebar"), "simulate", str(simspec)]
        subprocess.run(
            [*command, "--isolation", rung, "--out", f"{folder}/out"], check=True, stdout=subprocess.DEVNULL
        )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=8)
    parser.add_argument("--rung", default="bwrap")
    parser.add_argument("--simspec", type=Path, default=ROOT / "examples" / "search.yaml")
    options = parser.parse_args()
    # The first session compiles and reads files that the others find in memory.
    cpu_s(options.simspec, "none")
    ratios = []
    for pair in range(options.pairs):
        order = (options.rung, "none") if pair % 2 else ("none", options.rung)
        spent = {rung: cpu_s(options.simspec, rung) for rung in order}
        ratios.append(spent[options.rung] / spent["none"])
        print(
            f"{options.rung} {spent[options.rung]:.2f} s, none {spent['none']:.2f} s, ratio {ratios[-1]:.4f}",
            flush=True,
        )
    logarithms = [math.log(ratio) for ratio in ratios]
    mean = statistics.mean(logarithms)
    half = T_975.get(len(ratios) - 1, 1.96) * statistics.stdev(logarithms) / math.sqrt(len(ratios))
    low, middle, high = (math.exp(value) for value in (mean - half, mean, mean + half))
    print(
        f"median {statistics.median(ratios):.4f}, mean {middle:.4f} ({low:.4f} to {high:.4f}), {len(ratios)} pairs"
    )


if __name__ == "__main__":
    main()
