"""Fitting a scale of measured difficulty to flown campaigns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Floats
from bench.statistics import fit_item_response
from decompositions import Decomposition

from ._features import Feature
from ._scale import DifficultyScale, FeatureScale, FlownFolder, NodeScale

MIN_OUTCOMES = 10
"""Failures, and passes, that a node needs for a model. Chosen; a claim needs more (bench.statistics.ScaleProof)."""

MIN_WEIGHT = 0.01
"""Log odds for one deviation: a tenth of a point of difficulty. What is less is left out of the document."""


@dataclass(frozen=True, slots=True)
class ScaleTrials:
    """The considered trials of one node: who flew which scene, and whether it failed."""

    agents: tuple[str, ...]
    scenes: tuple[str, ...]
    failed: tuple[bool, ...]


def fit_scale(
    decomposition: Decomposition,
    trials: Mapping[str, ScaleTrials],
    features: Mapping[str, Mapping[str, Feature]],
    flown: FlownFolder,
) -> DifficultyScale:
    """A scale from the trials of nodes and the features of scenes. Nodes with too few failures or passes have none."""
    scenes = sorted(features)
    names = list(features[scenes[0]])
    values: Floats = np.array([[features[scene][name].value for name in names] for scene in scenes])
    # A feature that hardly varies says nothing; its weight would be noise.
    varied = [column for column in range(len(names)) if values[:, column].std() > 1e-6]
    scales = {
        names[column]: FeatureScale(
            mean=round(float(values[:, column].mean()), 6),
            deviation=round(float(values[:, column].std()), 6),
            low=round(float(values[:, column].min()), 6),
            high=round(float(values[:, column].max()), 6),
        )
        for column in varied
    }
    standardized: Floats = np.array(
        [
            [scale.standardized(features[scene][name].value) for name, scale in scales.items()]
            for scene in scenes
        ]
    )
    nodes = {
        node: _fit_node(trials[node], scenes, standardized, list(scales))
        for node in trials
        if min(sum(trials[node].failed), len(trials[node].failed) - sum(trials[node].failed)) >= MIN_OUTCOMES
    }
    return DifficultyScale(
        decomposition=decomposition.name,
        decomposition_sha256=decomposition.digest,
        fitted_to=(flown,),
        features=scales,
        nodes=nodes,
    )


def _fit_node(
    trials: ScaleTrials, scenes: Sequence[str], standardized: Floats, names: Sequence[str]
) -> NodeScale:
    agents = sorted(set(trials.agents))
    fit = fit_item_response(
        trials.failed,
        [agents.index(agent) for agent in trials.agents],
        [scenes.index(scene) for scene in trials.scenes],
        standardized,
    )
    return NodeScale(
        trials=len(trials.failed),
        failures=sum(trials.failed),
        abilities={agent: round(float(value), 4) for agent, value in zip(agents, fit.abilities, strict=True)},
        weights={
            name: round(float(value), 4)
            for name, value in zip(names, fit.weights, strict=True)
            if abs(value) >= MIN_WEIGHT
        },
    )
