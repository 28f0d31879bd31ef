"""CPU seconds and peak memory of scoring many runs over a large decomposition, each step in a process of its
own.

python benchmarks/scoring_speed.py [RUNS]

The decomposition is made: 5 principles, 43 key attributes, 121 VABs, 135 observables that stand 158 times
under VABs, as many as the paper's application has. Runs are 12 situations in design points of three
replicates, flown by two agents.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

from bench.contracts import Observation, Outcome
from bench.scoring import Difficulty, ScoredRun, difficulty_of_values, score_table, summary_frame
from bench.statistics import Trials, competence, count_trials
from decompositions import Decomposition, DecompositionDocument, decomposition_of

COUNTS = (5, 43, 121, 135)
EDGES = (60, 140, 158)
SITUATIONS = 12


def synthetic_decomposition() -> Decomposition:
    """A DAG of the application's size, with more than one parent for some nodes at every level."""
    rng = np.random.default_rng(1)
    names = [
        [f"{letter}-{number:03d}" for number in range(count)]
        for letter, count in zip("PKVO", COUNTS, strict=True)
    ]
    layers = [
        _linked(above, below, edges, rng)
        for above, below, edges in zip(names[:3], names[1:], EDGES, strict=True)
    ]
    document = {
        "format": "rebar.decomposition/1",
        "name": "made",
        "title": "Made",
        "principles": layers[0],
        "key_attributes": layers[1],
        "vabs": layers[2],
        "observables": [_observable(name, rng) for name in names[3]],
        "study": names[1][:5],
    }
    return decomposition_of(DecompositionDocument.model_validate(document))


def _linked(
    above: list[str], below: list[str], edges: int, rng: np.random.Generator
) -> list[dict[str, object]]:
    pairs = {(above[number % len(above)], name) for number, name in enumerate(below)}
    pairs |= {(name, below[number % len(below)]) for number, name in enumerate(above)}
    while len(pairs) < edges:
        pairs.add((str(rng.choice(above)), str(rng.choice(below))))
    return [
        {
            "id": name,
            "title": name,
            "asks": "?",
            "children": sorted(child for parent, child in pairs if parent == name),
        }
        for name in above
    ]


def _observable(name: str, rng: np.random.Generator) -> dict[str, object]:
    worst = float(rng.uniform(1.0, 3.0))
    row = {
        "factor": "fog_level",
        "unit": "level",
        "ratings": [10, 90],
        "values": [0.0, worst],
        "reason": "For the benchmark.",
    }
    return {
        "id": name,
        "title": name,
        "asks": "?",
        "measure": "m",
        "threshold": 0.3,
        "threshold_reason": "For the benchmark.",
        "considered": "Mostly.",
        "key_factors": [row],
        "partial_credit": bool(rng.random() < 0.5),
    }


def runs_of(observables: Decomposition, count: int) -> list[ScoredRun]:
    """Seeded runs, nine observables in ten considered."""
    rng = np.random.default_rng(2)
    difficulties = [
        difficulty_of_values(observables, {"fog_level": 3.0 * number / SITUATIONS})
        for number in range(SITUATIONS)
    ]
    return [_run(observables, number, difficulties, rng) for number in range(count)]


def _run(
    observables: Decomposition, number: int, difficulties: list[Difficulty], rng: np.random.Generator
) -> ScoredRun:
    point = number // 6
    xs, considered = rng.random(len(observables.observables)), rng.random(len(observables.observables)) < 0.9
    observations = tuple(
        Observation.model_construct(
            observable=name, considered=bool(observable), x=float(x) if observable else None
        )
        for name, x, observable in zip(observables.observables, xs, considered, strict=True)
    )
    name = f"{point:05d}-{number % 3}-{number % 2}"
    return ScoredRun(
        f"run-{number}-{name}",
        f"p{point:05d}",
        number % 3,
        f"agent-{number % 2}",
        Outcome.COMPLETED,
        difficulties[point % 12],
        observations,
    )


def table(path: Path, count: int) -> Callable[[], object]:
    """Score the runs and write the table as Parquet."""
    observables = synthetic_decomposition()
    runs = runs_of(observables, count)

    def step() -> None:
        score_table(observables, runs).write_parquet(path)

    return step


def read(path: Path, count: int) -> Callable[[], object]:
    """Read the table, which the steps after it do too."""
    return lambda: pl.read_parquet(path)


def competent(path: Path, count: int) -> Callable[[], object]:
    """Competence alone, run by run, at both shares."""
    scores = pl.read_parquet(
        path, columns=["agent", "node", "design_point", "difficulty", "achieved", "considered"]
    )
    scores = scores.filter(pl.col("considered") > 0)
    group, point = (
        scores.select(pl.struct(names).rank("dense") - 1).to_series()
        for names in (["agent", "node"], ["design_point"])
    )
    passed = scores["achieved"] == scores["considered"]
    trials = Trials(
        group.cast(pl.Int64).to_numpy(),
        scores["difficulty"].to_numpy(),
        passed.to_numpy(),
        point.cast(pl.Int64).to_numpy(),
    )

    def step() -> None:
        counted = count_trials(trials, int(trials.group.max()) + 1)
        for share in ((1, 2), (9, 10)):
            competence(counted, share)

    return step


def summary(path: Path, count: int) -> Callable[[], object]:
    """Sum the table up: means, intervals and competence of every node, agent and configuration."""
    observables, scores = synthetic_decomposition(), pl.read_parquet(path)
    return lambda: summary_frame(scores, observables)


STEPS = {"table": table, "read": read, "summary": summary, "competence": competent}


def measure(name: str, path: Path, count: int) -> None:
    """Print what one step took, without what was made ready for it, and the peak of the whole process."""
    step = STEPS[name](path, count)
    before = _peak_mb()
    began = time.process_time()
    step()
    spent = time.process_time() - began
    print(f"{name:<12}{spent:8.2f} s CPU{_peak_mb():8.0f} MB peak ({before:.0f} MB before it)", flush=True)


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    """Every step in a process of its own, one core."""
    if len(sys.argv) == 4:
        measure(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]))
        return
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    with tempfile.TemporaryDirectory() as folder:
        for name in STEPS:
            command = [sys.executable, __file__, name, str(Path(folder) / "scores.parquet"), str(count)]
            subprocess.run(
                command, check=True, env=os.environ | {"POLARS_MAX_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
            )


if __name__ == "__main__":
    main()
