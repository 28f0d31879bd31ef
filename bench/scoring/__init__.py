"""Difficulty, scores and confidence from observations and a decomposition: pure functions, no I/O, no clock.

from bench.scoring import difficulty_of, score_run
difficulty = difficulty_of(decomposition, simspec)
print(difficulty.of("KA-18"), score_run(decomposition, difficulty, result.observations)["KA-18"])

docs/rulings.md numbers the rules that every score rests on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._configuration import configuration_of as configuration_of
    from ._configuration import configuration_tension as configuration_tension
    from ._configuration import studied_key_attributes as studied_key_attributes
    from ._difficulty import Difficulty as Difficulty
    from ._difficulty import Standing as Standing
    from ._difficulty import absence_of as absence_of
    from ._difficulty import difficulty_of as difficulty_of
    from ._difficulty import difficulty_of_values as difficulty_of_values
    from ._difficulty import rate as rate
    from ._difficulty import rated_observables as rated_observables
    from ._difficulty import stated_difficulty as stated_difficulty
    from ._difficulty import tension_of as tension_of
    from ._explain import AgentExplanation as AgentExplanation
    from ._explain import Explanation as Explanation
    from ._explain import ObservableExplanation as ObservableExplanation
    from ._explain import RunExplanation as RunExplanation
    from ._explain import Sources as Sources
    from ._explain import explain as explain
    from ._external import read_table as read_table
    from ._floor import NodeFloor as NodeFloor
    from ._floor import node_floors as node_floors
    from ._floor import worst_first as worst_first
    from ._inverse import hardest_value as hardest_value
    from ._inverse import value_for_rating as value_for_rating
    from ._panel import Panel as Panel
    from ._panel import PanelNode as PanelNode
    from ._panel import panel_of as panel_of
    from ._report import CompletenessReport as CompletenessReport
    from ._report import RunReport as RunReport
    from ._report import ScoreReport as ScoreReport
    from ._report import node_reports as node_reports
    from ._report import run_reports as run_reports
    from ._scores import score_run as score_run
    from ._statements import StatementReport as StatementReport
    from ._statements import statement_reports as statement_reports
    from ._summary import summary_frame as summary_frame
    from ._table import EXCLUDED_OUTCOMES as EXCLUDED_OUTCOMES
    from ._table import SCORE_COLUMNS as SCORE_COLUMNS
    from ._table import ScoredRun as ScoredRun
    from ._table import absent_pairs as absent_pairs
    from ._table import score_table as score_table
    from ._table_file import ScoreTableWriter as ScoreTableWriter
    from ._table_file import read_score_table as read_score_table

# Lazy, because difficulty, which planning needs, takes neither summaries nor their statistics.
__getattr__ = lazy_names(__name__)
