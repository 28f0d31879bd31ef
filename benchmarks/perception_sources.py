"""The same agent on the same scenes with each source of perception, and the error model that is fitted to one of them.

Run: python benchmarks/perception_sources.py FOLDER [--flights N] [--seeds N] [--begin-score SCORE]

Four scenes of campaigns/demo.yaml (fog 1 to 4, 35 m high, a camera of 640x480), flown by reference-naive with the truth,
the simulated detector, the detector `small` and none. Prints how many scenes pass with the truth and with each other
source, as docs/statistics.md has it; and the rates of `small`, of the model fitted to its recordings on the same frames,
and of flights of the same scenes with that model, as docs/detection.md has it. With --begin-score, instead: the rates of
`small` without and with perception.begin_score, as docs/pixel-detector.md has them. Campaigns stay in FOLDER, and are not
flown again.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy import stats

from bench.contracts import DetectionFrame, SimTime, Tape
from bench.perception import open_detector
from bench.perception.fit import DetectorFit, fit_detector
from bench.perception.fit._fit import BANDS_PX, _sightings
from bench.perception.fit._matching import MatchedRun, match_runs
from bench.recording import read_simspec, read_tape
from bench.simspec import SimSpec

DEMO = Path(__file__).parents[1] / "campaigns" / "demo.yaml"
SOURCES = ("truth", "simulated", "detector", "agent")
NODES = ("KA-03", "OBS-031", "KA-05", "KA-09", "KA-18")
BIG_SCORE = 0.35

Run = tuple[SimSpec, Tape]


def campaign(name: str, perception: Mapping[str, Any], seed: int | None = None) -> dict[str, Any]:
    """The four scenes with one perception; `seed` is that of its draws, the scenes' own if None."""
    document: dict[str, Any] = yaml.safe_load(DEMO.read_text(encoding="utf-8"))
    document |= {"name": name, "agents": [{"manifest": "reference-naive"}], "budgets": {"wall_s": 900.0}}
    base = document["base"]
    base["vehicle"]["camera"] = {"width_px": 640, "height_px": 480}
    base["mission"]["altitude_m"] = 35.0
    base["perception"] = dict(perception)
    if seed is not None:
        base["seeds"] = {"perception": seed}
    fog = {
        "name": "fog",
        "unit": "level",
        "levels": [1.0, 2.0, 3.0, 4.0],
        "sets": ["environment.fog_level"],
    }
    document["design"] |= {"method": {"kind": "full_factorial"}, "factors": [fog]}
    return document


def fly(folder: Path, document: Mapping[str, Any]) -> Path:
    """The folder of a campaign, flown."""
    out = folder / str(document["name"])
    path = folder / f"{document['name']}.yaml"
    path.write_text(yaml.safe_dump(dict(document), sort_keys=False), encoding="utf-8")
    rebar("run", str(path), "--out", str(out))
    return out


def rebar(*arguments: str) -> str:
    """What the command prints."""
    command = (sys.executable, "-m", "bench.cli", *arguments)
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def runs_of(folder: Path) -> list[Run]:
    """SimSpec and tape of each session of a campaign."""
    runs = []
    for path in sorted(folder.glob("runs/*/recording.mcap")):
        simspec = read_simspec(path)
        runs.append((simspec, read_tape(path, simspec)))
    return runs


def print_comparison(truth: Path, other: Path) -> None:
    """Scenes passed with both, with the truth alone, with the other alone, with neither."""
    nodes = [word for node in NODES for word in ("--node", node)]
    document = json.loads(rebar("compare", str(truth), str(other), *nodes, "--json"))
    print(f"scenes passed with truth and {other.name} / truth alone / {other.name} alone / neither:")
    for node in document["nodes"]:
        print(f"  {node['node']:8}", " / ".join(str(count) for count in node["counts"].values()))


Rates = dict[str, tuple[float, float]]
"""Count, and of how many, by name."""


def rates_of(matched: Sequence[MatchedRun]) -> Rates:
    """Detected by effective size, wrong labels, and false detections a frame."""
    rows = _sightings(matched)
    frames = float(sum(len(run.frames) for run in matched))
    false = [item for run in matched for frame in run.frames for item in frame.false]
    wrong = rows.hit & (np.array(rows.label) != np.array(rows.true_label))
    rates = {"detected": (float(rows.hit.sum()), float(len(rows.hit)))}
    for low, high in pairwise(BANDS_PX):
        inside = (rows.size_px >= low) & (rows.size_px < high)
        if inside.any():
            rates[f"of {low:g} to {high:g} px"] = (float(rows.hit[inside].sum()), float(inside.sum()))
    sure = (rows.score >= BIG_SCORE) & rows.hit & ~wrong
    rates[f"right label, score {BIG_SCORE:g}"] = (float(sure.sum()), float(len(rows.hit)))
    rates["wrong labels"] = (float(wrong.sum()), float(rows.hit.sum()))
    rates["false a frame"] = (float(len(false)), frames)
    sure_false = sum(item.score >= BIG_SCORE for item in false)
    rates[f"false a frame, score {BIG_SCORE:g}"] = (float(sure_false), frames)
    return rates


def on_same_frames(runs: Sequence[Run], fit: DetectorFit, seed: int) -> Rates:
    """What the fitted model makes of the frames of the runs."""
    made = []
    for number, (simspec, tape) in enumerate(runs):
        seeds = simspec.seeds.model_copy(update={"perception": 1000 * seed + number})
        fitted = simspec.model_copy(update={"perception": fit.perception, "seeds": seeds})
        detector = open_detector(fitted, tape.cast)
        for frame in tape.frames:
            detector.process(frame)
        results = tuple(detector.due(SimTime(10**15)))
        made.append((fitted, tape_with(tape, results)))
    return rates_of(match_runs(made))


def tape_with(tape: Tape, detections: tuple[DetectionFrame, ...]) -> Tape:
    """The tape with other detections."""
    nothing = np.zeros(0)
    return Tape(
        cast=tape.cast,
        vehicle_time_s=tape.vehicle_time_s,
        vehicle_position_enu_m=tape.vehicle_position_enu_m,
        vehicle_velocity_enu_mps=tape.vehicle_velocity_enu_mps,
        actor_time_s=nothing,
        actor_position_enu_m=np.zeros((0, len(tape.cast), 3)),
        frames=tape.frames,
        detections=detections,
    )


def mean_and_interval(values: Sequence[float]) -> str:
    """Mean of independent values, and the half width of its 95 % interval by Student's t."""
    count, mean = len(values), float(np.mean(values))
    if count < 2:
        return f"{mean:.4f}"
    half = float(stats.t.ppf(0.975, count - 1)) * float(np.std(values, ddof=1)) / math.sqrt(count)
    return f"{mean:.4f} +- {half:.4f}"


def print_rates(run: Rates, same: Sequence[Rates], flown: Sequence[Rates]) -> None:
    """One row for each rate: of the run, and mean and interval of the model's."""

    def column(rates: Sequence[Rates], name: str) -> str:
        values = [each[name][0] / each[name][1] for each in rates if name in each and each[name][1]]
        return mean_and_interval(values) if values else ""

    print(f"{'':30}{'run':>10}{'(of)':>8}  {'model, same frames':>20}  {'model, flown':>20}")
    for name, (count, total) in run.items():
        share = count / total if total else math.nan
        print(f"{name:30}{share:10.4f}{total:8.0f}  {column(same, name):>20}  {column(flown, name):>20}")


def begun(tape: Tape, begin_score: float) -> tuple[DetectionFrame, ...]:
    """The detections of a tape as this perception.begin_score leaves them."""
    tracks: set[str] = set()
    results = []
    for result in tape.detections:
        tracks |= {item.track for item in result.detections if item.score >= begin_score}
        kept = tuple(item for item in result.detections if item.track in tracks)
        results.append(replace(result, detections=kept))
    return tuple(results)


def print_begin_scores(runs: Sequence[Run]) -> None:
    """What a score to begin with takes away, beside a least score for every detection."""
    names = ("detected", "of 8 to 12 px", f"right label, score {BIG_SCORE:g}", "false a frame")
    print(f"{'on the same frames':24}", *(f"{name:>24}" for name in names))
    for score in (0.0, 0.25, 0.3, 0.35, 0.4):
        made = [(simspec, tape_with(tape, begun(tape, score))) for simspec, tape in runs]
        print_row(f"begin_score {score:g}", rates_of(match_runs(made)), names)
    for score in (0.2, 0.25, 0.3):
        made = [(simspec, tape_with(tape, above(tape, score))) for simspec, tape in runs]
        print_row(f"every score {score:g}", rates_of(match_runs(made)), names)


def above(tape: Tape, least_score: float) -> tuple[DetectionFrame, ...]:
    """The detections of a tape with at least this score."""
    return tuple(
        replace(result, detections=tuple(item for item in result.detections if item.score >= least_score))
        for result in tape.detections
    )


def print_row(title: str, rates: Rates, names: Sequence[str]) -> None:
    """Some rates, in one row."""
    print(f"{title:24}", *(f"{rates[name][0] / rates[name][1]:24.3f}" for name in names))


def print_begin_score(folder: Path, begin_score: float) -> None:
    """The rates of the detector, of its flights with the score to begin with, and what that does to agents."""
    truth, plain = (fly(folder, campaign(source, {"source": source})) for source in ("truth", "detector"))
    name = f"begin-{round(100 * begin_score)}"
    flown = fly(folder, campaign(name, {"source": "detector", "begin_score": begin_score}))
    for other in (plain, flown):
        print_comparison(truth, other)
    runs = runs_of(plain)
    print_rates(rates_of(match_runs(runs)), [], [rates_of(match_runs(runs_of(flown)))])
    print_begin_scores(runs)


def main() -> None:
    """Fly what is missing, and print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--flights", type=int, default=10, help="Flights of all scenes with the fitted model")
    parser.add_argument("--seeds", type=int, default=40, help="Draws of the fitted model on the same frames")
    parser.add_argument("--begin-score", type=float, help="Compare this perception.begin_score with none")
    options = parser.parse_args()
    folder: Path = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    if options.begin_score is not None:
        print_begin_score(folder, options.begin_score)
        return
    flown = {source: fly(folder, campaign(source, {"source": source})) for source in SOURCES}
    for source in SOURCES[1:]:
        print_comparison(flown["truth"], flown[source])
    runs = runs_of(flown["detector"])
    fit = fit_detector(runs)
    perception = fit.perception.model_dump(mode="json", exclude_defaults=True)
    same = [on_same_frames(runs, fit, seed) for seed in range(1, options.seeds + 1)]
    again = []
    for seed in range(1, options.flights + 1):
        out = fly(folder, campaign(f"fitted-{seed}", perception, seed))
        again.append(rates_of(match_runs(runs_of(out))))
        print(".", end="", flush=True, file=sys.stderr)
    print_rates(rates_of(match_runs(runs)), same, again)


if __name__ == "__main__":
    main()
