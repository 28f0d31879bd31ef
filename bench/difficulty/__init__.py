"""Measured difficulty: how often a frozen panel of agents fails in a situation, predicted before anything flies.

from bench.difficulty import features_of, shipped_scale
scale = shipped_scale(decomposition)
print(scale.measure("KA-20", features_of(simspec)).sentence())

docs/calibration.md has the panel, the model, and what it was shown to predict.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._features import Feature as Feature
    from ._features import changed_situations as changed_situations
    from ._features import features_of as features_of
    from ._fit import MIN_OUTCOMES as MIN_OUTCOMES
    from ._fit import ScaleTrials as ScaleTrials
    from ._fit import fit_scale as fit_scale
    from ._scale import POINTS_PER_LOG_ODDS as POINTS_PER_LOG_ODDS
    from ._scale import Contribution as Contribution
    from ._scale import DifficultyScale as DifficultyScale
    from ._scale import FlownFolder as FlownFolder
    from ._scale import MeasuredDifficulty as MeasuredDifficulty
    from ._scale import NodeScale as NodeScale
    from ._scale import load_scale as load_scale
    from ._scale import shipped_scale as shipped_scale

__getattr__ = lazy_names(__name__)
