"""Pure functions: observations and a decomposition in, difficulty, scores and confidence out. No I/O, no clock.

from bench.scoring import difficulty_of, score_run
found = difficulty_of(decomposition, simspec)
print(found.explain("KA-18"), score_run(decomposition, found, result.observations)["KA-18"])
"""

from __future__ import annotations

from ._compare import NodeComparison as NodeComparison
from ._compare import compare_nodes as compare_nodes
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
from ._explain import AgentTold as AgentTold
from ._explain import Explanation as Explanation
from ._explain import ObservableTold as ObservableTold
from ._explain import RunTold as RunTold
from ._explain import Sources as Sources
from ._explain import explain as explain
from ._external import ExternalTable as ExternalTable
from ._external import read_table as read_table
from ._external import score_external as score_external
from ._raising import Change as Change
from ._raising import Goal as Goal
from ._raising import Raising as Raising
from ._raising import raising as raising
from ._raising import value_rated as value_rated
from ._report import NodeReport as NodeReport
from ._report import RunNode as RunNode
from ._report import RunReport as RunReport
from ._report import ScoreReport as ScoreReport
from ._report import node_reports as node_reports
from ._report import run_reports as run_reports
from ._report import score_report as score_report
from ._scores import NodeScore as NodeScore
from ._scores import RunScores as RunScores
from ._scores import score_run as score_run
from ._summary import SUMMARY_COLUMNS as SUMMARY_COLUMNS
from ._summary import summary_frame as summary_frame
from ._table import SCORE_COLUMNS as SCORE_COLUMNS
from ._table import ScoredRun as ScoredRun
from ._table import absent_pairs as absent_pairs
from ._table import score_table as score_table
