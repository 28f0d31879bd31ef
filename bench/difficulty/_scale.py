"""The scale of measured difficulty as a document, and what it says of a situation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from bench.documents import Document, load_document, read_document
from bench.errors import SetupError
from bench.scoring import tension_of
from decompositions import Decomposition

from ._features import Feature

POINTS_PER_LOG_ODDS = 10.0
"""A failure share of a half is 50, of three in four 61, of nine in ten 72."""
MIN_POINTS = 1.0
"""Of a contribution that a sentence names."""


class FeatureScale(Document):
    """The values of a feature over the panel's situations; values outside count as the nearest one inside."""

    mean: float
    deviation: float = Field(gt=0.0)
    low: float
    high: float

    def standardized(self, value: float) -> float:
        """Deviations from the panel's mean."""
        return (min(max(value, self.low), self.high) - self.mean) / self.deviation


class NodeScale(Document):
    """The model of one key attribute, in log odds of failure."""

    trials: int
    failures: int
    abilities: dict[str, float] = Field(
        min_length=1, description="Of each agent of the panel, in its average situation."
    )
    weights: dict[str, float] = Field(description="For one deviation of each feature.")
    unproved: str = Field(
        "not tested on agents outside the panel",
        description="Why nothing is claimed on this scale; empty where it held on agents outside the panel.",
    )


class FlownFolder(Document):
    """What was flown. The digest is that of the digests of all scenes."""

    name: str
    scenes: int
    scenes_sha256: str
    runs: int
    agents: tuple[str, ...]


class DifficultyScale(Document):
    """A scale of measured difficulty for one decomposition."""

    format: Literal["rebar.difficulty-scale/1"] = "rebar.difficulty-scale/1"
    decomposition: str
    decomposition_sha256: str
    fitted_to: tuple[FlownFolder, ...]
    tested_on: tuple[FlownFolder, ...] = ()
    features: dict[str, FeatureScale]
    nodes: dict[str, NodeScale]

    @property
    def proved(self) -> tuple[str, ...]:
        """The nodes whose difficulty was shown to predict agents outside the panel."""
        return tuple(name for name, node in self.nodes.items() if not node.unproved)

    @model_validator(mode="after")
    def _check_weights(self) -> Self:
        for node, model in self.nodes.items():
            if unknown := sorted(model.weights.keys() - self.features.keys()):
                raise ValueError(f"{node} has a weight for {unknown[0]!r}, which is not among the features")
        return self

    def log_odds(self, node: str, features: Mapping[str, Feature]) -> float:
        """By how much a situation raises every agent's log odds of failure above the panel's average situation.

        Raises SetupError for a weight of a feature that is not computed.
        """
        return math.fsum(self._terms(node, features).values())

    def measure(self, node: str, features: Mapping[str, Feature]) -> MeasuredDifficulty:
        """The measured difficulty of a node. Raises KeyError for a node without a scale, and as `log_odds`."""
        model, terms = self.nodes[node], self._terms(node, features)
        total = math.fsum(terms.values())
        average, here = _panel_log_odds(model, 0.0), _panel_log_odds(model, total)
        # The panel's share is no sum of terms, so each takes its part of the way; without one, the slope of the share.
        step = total if abs(total) > 1e-3 else 1e-3
        points = POINTS_PER_LOG_ODDS * (_panel_log_odds(model, step) - average) / step
        return MeasuredDifficulty(
            node,
            min(100.0, max(0.0, 50.0 + POINTS_PER_LOG_ODDS * here)),
            float(np.exp(-np.logaddexp(0.0, -here))),
            50.0 + POINTS_PER_LOG_ODDS * average,
            tuple(
                sorted(
                    (Contribution(name, points * term, features[name].words) for name, term in terms.items()),
                    key=lambda part: -abs(part.points),
                )
            ),
            model.unproved,
        )

    def _terms(self, node: str, features: Mapping[str, Feature]) -> dict[str, float]:
        if unknown := sorted(self.nodes[node].weights.keys() - features.keys()):
            what = f"has a weight for {unknown[0]!r} in {node}, which this version does not compute"
            raise SetupError(f"the scale of {self.decomposition}", what, "fit it again")
        return {
            name: weight * self.features[name].standardized(features[name].value)
            for name, weight in self.nodes[node].weights.items()
        }


@dataclass(frozen=True, slots=True)
class Contribution:
    """What one feature adds to a difficulty, in points, and what it is in this situation."""

    feature: str
    points: float
    words: str


@dataclass(frozen=True, slots=True)
class MeasuredDifficulty:
    """The measured difficulty of one node: `average` and the contributions add up to it, unless it was clipped.

    `failure_share` is that of the panel. `unproved` says why nothing may be claimed on this scale.
    """

    node: str
    difficulty: float
    failure_share: float
    average: float
    contributions: tuple[Contribution, ...]
    unproved: str

    @property
    def tension(self) -> int:
        """1 to 5, as of a published rating."""
        return tension_of(self.difficulty)

    def sentence(self, count: int = 4) -> str:
        """The difficulty and the contributions behind it, the largest first."""
        named = [part for part in self.contributions[:count] if abs(part.points) >= MIN_POINTS]
        rest = math.fsum(part.points for part in self.contributions if part not in named)
        parts = [f"{part.words} ({part.points:+.0f})" for part in named]
        if abs(rest) >= MIN_POINTS:
            parts.append(f"all else ({rest:+.0f})")
        doubt = f" No scale here: {self.unproved}." if self.unproved else ""
        return (
            f"{self.node}: tension {self.tension}, measured {self.difficulty:.0f}. The panel fails it in {self.failure_share:.0%} of such runs, and is at "
            f"{self.average:.0f} in its average situation{'; here ' if parts else ''}{', '.join(parts)}.{doubt}"
        )


def load_scale(path: Path, decomposition: Decomposition) -> DifficultyScale:
    """A scale from a file. Raises SetupError where it is one of another decomposition."""
    scale = load_document(path, DifficultyScale)
    if scale.decomposition_sha256 != decomposition.digest:
        raise SetupError(
            str(path),
            f"is a scale of another version of {scale.decomposition} than the {decomposition.name} here",
            "fit it again: `rebar calibrate --fit DIR --out FILE`",
        )
    if unknown := sorted(scale.nodes.keys() - set(decomposition.key_attributes)):
        what = f"has {unknown[0]!r}, which is no key attribute of {decomposition.name}"
        raise SetupError(f"{path}: nodes", what, "fit it again")
    return scale


def shipped_scale(decomposition: Decomposition) -> DifficultyScale | None:
    """The scale that ships for a decomposition; None where there is none for this version of it."""
    folder = resources.files(__package__).joinpath("scales")
    file = folder.joinpath(f"{decomposition.name.replace('-', '_')}.yaml")
    if not file.is_file():
        return None
    scale = read_document(file.read_text(encoding="utf-8"), DifficultyScale, source=file.name)
    return scale if scale.decomposition_sha256 == decomposition.digest else None


def _panel_log_odds(model: NodeScale, log_odds: float) -> float:
    """Log odds of the share of failures over all agents of the panel."""
    agents = np.array(list(model.abilities.values())) + log_odds
    # Logarithms of the sums of chances to fail and to pass: a chance itself would round to 0 or 1.
    fails, passes = (np.logaddexp.reduce(-np.logaddexp(0.0, sign * agents)) for sign in (-1.0, 1.0))
    return float(fails - passes)
