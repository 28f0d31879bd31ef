"""How fast the overhead simulation is, and how well it foretells the full one.

    python benchmarks/overhead_speed.py                      # missions of the demo's scenes for each CPU second of one core
    python benchmarks/overhead_speed.py --against out/demo   # and rank correlations with a campaign that was flown in full

Correlations are over realizations, with the 2.5 and 97.5 percentiles of 2000 bootstrap samples of scenes:
both agents of a scene are drawn together.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from scipy import stats

from agent_adapters.reference.surrogate import computed, observe, pack
from bench.campaign import load_campaign, load_measurable_decomposition, measures_of, read_runs, realizations
from bench.contracts import SessionResult
from bench.realization import place
from bench.scoring import score_table
from bench.simspec import SimSpec

DEMO = Path(__file__).parents[1] / "campaigns" / "demo.yaml"
MISSIONS = 1920
SAMPLES = 2000
SEED = 2026


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", type=Path, help="folder of a campaign that was flown in full")
    parser.add_argument("--rounds", type=int, default=5, help="the fastest counts")
    options = parser.parse_args()
    result = predictions(options.against) if options.against else speed(options.rounds)
    print(json.dumps(result, indent=1))


def speed(rounds: int) -> dict[str, float]:
    """Missions for each CPU second: flown and measured, and with packing and the observations as
    documents.
    """
    campaign = load_campaign(DEMO)
    measures = measures_of(load_measurable_decomposition(campaign.decomposition))
    placed = [place(plan.simspec) for plan in realizations(campaign)]
    simspecs = [placed[k % len(placed)] for k in range(MISSIONS)]
    batch = pack(simspecs)

    def whole() -> None:
        observed = observe(pack(simspecs), measures)
        for row in range(MISSIONS):
            observed.of(row)

    times_s = {
        "flown and measured": min(_cpu_s(lambda: observe(batch, measures)) for _ in range(rounds)),
        "from SimSpecs to observations": min(_cpu_s(whole) for _ in range(rounds)),
    }
    return {name: round(MISSIONS / time_s) for name, time_s in times_s.items()}


def _cpu_s(work: Callable[[], object]) -> float:
    began_s = time.process_time()
    work()
    return time.process_time() - began_s


def predictions(folder: Path) -> dict[str, object]:
    """Correlations of what was flown in full with the same SimSpecs flown overhead."""
    full = read_runs(folder)
    measures = measures_of(full.decomposition)
    names = [run.realization for run in full.runs]
    simspecs = [
        SimSpec.model_validate_json((folder / "simspecs" / f"{name}.json").read_bytes()) for name in names
    ]
    observed = observe(pack(simspecs), measures)
    over = [replace(run, observations=observed.of(row)) for row, run in enumerate(full.runs)]
    scenes = np.unique([f"{run.design_point}-{run.replicate}" for run in full.runs], return_inverse=True)[1]
    tables = [score_table(full.decomposition, list(runs), full.study) for runs in (full.runs, over)]
    ended_s = [
        SessionResult.model_validate_json((folder / "runs" / name / "result.json").read_bytes()).simulated_s
        for name in names
    ]
    result: dict[str, object] = {
        "realizations": len(names),
        "not computed": observed.missing,
        "length of the mission": _correlation(np.array(ended_s), observed.end_s, scenes),
    }
    for node in full.study:
        of_full, of_overhead = (table.filter(table["node"] == node).sort("realization") for table in tables)
        result[node] = _node(of_full, of_overhead, names, scenes)
    result["mean score of each agent and node"] = _means(tables, full.study)
    for index, name in enumerate(observed.observables):
        if name in computed(measures):
            truth = np.array(
                [
                    next(observation.x for observation in run.observations if observation.observable == name)
                    for run in full.runs
                ],
                float,
            )
            considered = np.isfinite(truth) & observed.considered[:, index]
            result[name] = _correlation(truth[considered], observed.x[considered, index], scenes[considered])
    return result


def _node(
    full: pl.DataFrame, over: pl.DataFrame, names: Sequence[str], scenes: np.ndarray
) -> dict[str, object]:
    order = np.argsort(names)
    columns = {}
    for label, frame in (("full", full), ("overhead", over)):
        columns[label] = {
            column: frame[column].to_numpy().astype(float) for column in ("score", "confidence", "difficulty")
        }
    flown, overhead = columns["full"], columns["overhead"]
    scored = np.isfinite(flown["score"]) & np.isfinite(overhead["score"])
    considered = np.isfinite(flown["confidence"]) & np.isfinite(overhead["confidence"])
    ordered_scenes = scenes[order]
    passes = (flown["confidence"][considered] >= 1.0) == (overhead["confidence"][considered] >= 1.0)
    return {
        "score": _correlation(flown["score"][scored], overhead["score"][scored], ordered_scenes[scored]),
        "score less difficulty": _correlation(
            (flown["score"] - flown["difficulty"])[scored],
            (overhead["score"] - overhead["difficulty"])[scored],
            ordered_scenes[scored],
        ),
        "same verdict": f"{int(passes.sum())} of {len(passes)}",
        "scored alike": f"{int((np.isfinite(flown['score']) == np.isfinite(overhead['score'])).sum())} of {len(names)}",
    }


def _means(tables: Sequence[pl.DataFrame], study: Sequence[str]) -> dict[str, object]:
    """Over the pairs of agent and node that have a mean score in both."""
    frames = [
        table.filter(pl.col("node").is_in(study))
        .group_by("agent", "node")
        .agg(pl.col("score").mean())
        .sort("agent", "node")
        for table in tables
    ]
    full, overhead = (frame["score"].to_numpy().astype(float) for frame in frames)
    finite = np.isfinite(full) & np.isfinite(overhead)
    return _correlation(full[finite], overhead[finite], np.arange(int(finite.sum())))


def _correlation(full: np.ndarray, over: np.ndarray, scenes: np.ndarray) -> dict[str, object]:
    if not len(full):
        return {"n": 0}
    result: dict[str, object] = {
        "n": len(full),
        "mean full": _rounded(full.mean()),
        "mean overhead": _rounded(over.mean()),
    }
    if len(set(full)) < 2 or len(set(over)) < 2:
        return result | {"rank correlation": "none: one of both never changes"}
    result["spearman"] = _rounded(stats.spearmanr(full, over).statistic)
    result["kendall"] = _rounded(stats.kendalltau(full, over).statistic)
    result["spearman 95 %"] = _interval(full, over, scenes)
    return result


def _interval(full: np.ndarray, over: np.ndarray, scenes: np.ndarray) -> list[float]:
    rng = np.random.Generator(np.random.PCG64(SEED))
    members = [np.flatnonzero(scenes == scene) for scene in np.unique(scenes)]
    correlations = []
    for _ in range(SAMPLES):
        rows = np.concatenate([members[k] for k in rng.integers(len(members), size=len(members))])
        if len(set(full[rows])) > 1 and len(set(over[rows])) > 1:
            correlations.append(stats.spearmanr(full[rows], over[rows]).statistic)
    return [_rounded(value) for value in np.percentile(correlations, [2.5, 97.5])]


def _rounded(value: float) -> float:
    return round(float(value), 3)


if __name__ == "__main__":
    main()
