"""Statistics over scores: intervals, competence, factor tests, comparisons, power, stopping. Pure functions, no I/O.

from bench.statistics import runs_for_half_width
print(runs_for_half_width(share=0.9, half_width=0.05))
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._anova import anova as anova
    from ._comparison import SIGNIFICANCE as SIGNIFICANCE
    from ._comparison import NodeComparison as NodeComparison
    from ._comparison import UnpairedNodeComparison as UnpairedNodeComparison
    from ._comparison import compare_nodes as compare_nodes
    from ._comparison import compare_unpaired_nodes as compare_unpaired_nodes
    from ._competence import COMPETENCE_SHARES as COMPETENCE_SHARES
    from ._competence import TrialCounts as TrialCounts
    from ._competence import Trials as Trials
    from ._competence import competence as competence
    from ._competence import count_design_points as count_design_points
    from ._competence import count_trials as count_trials
    from ._competence import failures_rise as failures_rise
    from ._curve import Curve as Curve
    from ._curve import CurveState as CurveState
    from ._curve import difficulty_response as difficulty_response
    from ._difficulty_slope import AgentAbility as AgentAbility
    from ._difficulty_slope import DifficultySlope as DifficultySlope
    from ._difficulty_slope import Direction as Direction
    from ._difficulty_slope import SlopeState as SlopeState
    from ._difficulty_slope import difficulty_slope as difficulty_slope
    from ._divergence import Divergence as Divergence
    from ._equivalence import difference_bounds as difference_bounds
    from ._intervals import bounded_mean as bounded_mean
    from ._intervals import clopper_pearson as clopper_pearson
    from ._intervals import effective_size as effective_size
    from ._item_response import fit_item_response as fit_item_response
    from ._power import mcnemar_power as mcnemar_power
    from ._power import pairs_for_difference as pairs_for_difference
    from ._power import runs_for_half_width as runs_for_half_width
    from ._proper_scores import Skill as Skill
    from ._proper_scores import confidence_skill as confidence_skill
    from ._proper_scores import error_skill as error_skill
    from ._regression import OddsRatio as OddsRatio
    from ._regression import logistic as logistic
    from ._replicates import replicate_interval as replicate_interval
    from ._scale_proof import ScaleProof as ScaleProof
    from ._scale_proof import prove_scale as prove_scale
    from ._screening import FACTOR_COLUMNS as FACTOR_COLUMNS
    from ._screening import NodeFactorAnalysis as NodeFactorAnalysis
    from ._screening import factor_frame as factor_frame
    from ._screening import node_factors as node_factors
    from ._sequential import StoppingRule as StoppingRule
    from ._sequential import mean_bounds as mean_bounds
    from ._sequential import pass_rate_bounds as pass_rate_bounds
    from ._terms import FactorColumn as FactorColumn
    from ._terms import FactorIndependence as FactorIndependence
    from ._terms import FactorLevel as FactorLevel
    from ._terms import factor_columns as factor_columns

# Difficulties that agree to this many decimals are one difficulty (ruling 14): interpolation leaves rounding errors.
DIFFICULTY_DECIMALS = 6

# Lazy, because scipy's distributions take a CPU second to import: what only rates difficulty needs none.
__getattr__ = lazy_names(__name__)
