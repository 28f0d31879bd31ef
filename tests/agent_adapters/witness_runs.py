"""`python tests/agent_adapters/witness_runs.py DIR...`: writes witness_runs.yaml anew from flown campaign folders.

A witness of an observable is a run in which it was achieved, or a run in which it failed. As few runs as possible are
chosen, so that they can be flown again.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import yaml
from flown_scenes import DECOMPOSITION

from bench.campaign import load_measurable_decomposition
from bench.contracts import Observation

LIST = Path(__file__).parent / "witness_runs.yaml"

Verdict = tuple[str, bool]  # an observable, and whether it was achieved


@dataclass(frozen=True)
class Witness:
    """One run, and what it shows."""

    campaign: str
    scene: str
    replicate: int
    agent: str
    achieved: tuple[str, ...]
    failed: tuple[str, ...]

    @property
    def run(self) -> str:
        """Its name in the campaign."""
        return f"{self.scene}-r{self.replicate}-{self.agent}"

    @property
    def verdicts(self) -> set[Verdict]:
        return {*((name, True) for name in self.achieved), *((name, False) for name in self.failed)}


def verdicts(observations: Iterable[Observation]) -> set[Verdict]:
    """Of every observable that was considered."""
    return {
        (observation.observable, observation.x >= thresholds()[observation.observable])
        for observation in observations
        if observation.x is not None
    }


@cache
def thresholds() -> dict[str, float]:
    """The threshold of every observable."""
    observables = load_measurable_decomposition(DECOMPOSITION).observables
    return {name: observable.threshold for name, observable in observables.items()}


def listed() -> list[Witness]:
    """The witnesses of witness_runs.yaml."""
    return [
        Witness(**{**entry, "achieved": tuple(entry["achieved"]), "failed": tuple(entry["failed"])})
        for entry in yaml.safe_load(LIST.read_text())
    ]


def flown(folders: Iterable[Path]) -> Iterator[tuple[tuple[str, str, int, str], set[Verdict]]]:
    """Every run of these campaign folders."""
    for folder in folders:
        for file in sorted(folder.glob("runs/*/result.json")):
            result = json.loads(file.read_text())
            point, replicate, agent = result["realization"].split("-", 2)
            observations = [Observation.model_validate(entry) for entry in result["observations"]]
            yield (folder.name, point, int(replicate.removeprefix("r")), agent), verdicts(observations)


def fewest(runs: Mapping[tuple[str, str, int, str], set[Verdict]]) -> Iterator[Witness]:
    """Greedily: always the run that shows most of what is not shown yet."""
    missing = set().union(*runs.values())
    while missing:
        run = max(runs, key=lambda run: (len(runs[run] & missing), run))
        shown = sorted(runs[run] & missing)
        missing -= runs[run]
        yield Witness(
            *run,
            achieved=tuple(name for name, achieved in shown if achieved),
            failed=tuple(name for name, achieved in shown if not achieved),
        )


if __name__ == "__main__":
    witnesses = [vars(witness) for witness in fewest(dict(flown(map(Path, sys.argv[1:]))))]
    plain = json.loads(json.dumps(witnesses))  # tuples are lists to YAML
    LIST.write_text(yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=110))
