"""Pure functions: observations and a decomposition in, difficulty, scores and confidence out. No I/O, no clock.

from bench.scoring import difficulty_of, score_run
found = difficulty_of(decomposition, simspec)
print(found.explain("KA-18"), score_run(decomposition, found, result.observations)["KA-18"])
"""

from __future__ import annotations

from ._anova import Anova as Anova
from ._anova import Effect as Effect
from ._anova import anova as anova
from ._bootstrap import bootstrap_means as bootstrap_means
from ._compare import NodeComparison as NodeComparison
from ._compare import compare_nodes as compare_nodes
from ._competence import Competence as Competence
from ._competence import Trials as Trials
from ._competence import competence as competence
from ._competence import competence_of as competence_of
from ._competence import tally as tally
from ._competence import tally_points as tally_points
from ._configuration import configuration_of as configuration_of
from ._configuration import configuration_tension as configuration_tension
from ._configuration import studied as studied
from ._difficulty import Difficulty as Difficulty
from ._difficulty import FactorRating as FactorRating
from ._difficulty import NodeDifficulty as NodeDifficulty
from ._difficulty import ObservableDifficulty as ObservableDifficulty
from ._difficulty import difficulty as difficulty
from ._difficulty import difficulty_given as difficulty_given
from ._difficulty import difficulty_of as difficulty_of
from ._difficulty import rate as rate
from ._difficulty import tension as tension
from ._divergence import Divergence as Divergence
from ._divergence import Ended as Ended
from ._divergence import divergence as divergence
from ._divergence import js_divergence as js_divergence
from ._effects import Difference as Difference
from ._effects import PairedCounts as PairedCounts
from ._effects import cliffs_delta as cliffs_delta
from ._explain import Explanation as Explanation
from ._explain import Sources as Sources
from ._explain import explain as explain
from ._external import ExternalTable as ExternalTable
from ._external import read_table as read_table
from ._external import score_external as score_external
from ._intervals import clopper_pearson as clopper_pearson
from ._intervals import effective_size as effective_size
from ._intervals import wilson as wilson
from ._multiplicity import benjamini_hochberg as benjamini_hochberg
from ._multiplicity import holm as holm
from ._power import mcnemar_power as mcnemar_power
from ._power import pairs_for_difference as pairs_for_difference
from ._power import runs_for_claim as runs_for_claim
from ._power import runs_for_half_width as runs_for_half_width
from ._raising import Change as Change
from ._raising import Goal as Goal
from ._raising import Raising as Raising
from ._raising import raising as raising
from ._raising import value_rated as value_rated
from ._regression import Correlation as Correlation
from ._regression import FactorTest as FactorTest
from ._regression import Logistic as Logistic
from ._regression import OddsRatio as OddsRatio
from ._regression import correlation as correlation
from ._regression import logistic as logistic
from ._report import ScoreReport as ScoreReport
from ._report import node_reports as node_reports
from ._report import run_reports as run_reports
from ._report import score_report as score_report
from ._scores import NodeScore as NodeScore
from ._scores import RunScores as RunScores
from ._scores import score_run as score_run
from ._screening import FACTOR_COLUMNS as FACTOR_COLUMNS
from ._screening import NodeFactors as NodeFactors
from ._screening import factor_frame as factor_frame
from ._screening import node_factors as node_factors
from ._summary import SUMMARY_COLUMNS as SUMMARY_COLUMNS
from ._summary import summary_frame as summary_frame
from ._table import SCORE_COLUMNS as SCORE_COLUMNS
from ._table import ScoredRun as ScoredRun
from ._table import absent_pairs as absent_pairs
from ._table import score_table as score_table
from ._terms import FactorColumn as FactorColumn
from ._terms import FactorLevel as FactorLevel
from ._terms import Independence as Independence
from ._terms import LeftOut as LeftOut
from ._terms import cramers_v as cramers_v
from ._terms import factor_columns as factor_columns
from ._terms import independence as independence
