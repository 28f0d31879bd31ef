"""Pure functions: observations and a decomposition in, difficulty, scores and confidence out. No I/O, no clock.

from bench.scoring import difficulty_of, score_run
found = difficulty_of(decomposition, simspec)
print(found.explain("KA-18"), score_run(decomposition, found, result.observations)["KA-18"])
"""

from __future__ import annotations

from ._competence import Competence as Competence
from ._competence import Trials as Trials
from ._competence import competence as competence
from ._competence import competence_of as competence_of
from ._competence import tally as tally
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
from ._explain import Explanation as Explanation
from ._explain import Sources as Sources
from ._explain import explain as explain
from ._external import ExternalTable as ExternalTable
from ._external import read_table as read_table
from ._external import score_external as score_external
from ._intervals import clopper_pearson as clopper_pearson
from ._intervals import effective_size as effective_size
from ._intervals import wilson as wilson
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
