"""The report: what a campaign left on disk, as one HTML file that works offline, and the same scores for the terminal.

from bench.reporting import write_report
print(write_report(Path("out/demo")))
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._campaign_data import ReportData as ReportData
    from ._campaign_data import Run as Run
    from ._campaign_folder import load_report_data as load_report_data
    from ._campaign_folder import require_distinct as require_distinct
    from ._companions import COMPANIONS as COMPANIONS
    from ._companions import csv_text as csv_text
    from ._companions import requirements_table as requirements_table
    from ._companions import scores_table as scores_table
    from ._conditions import matching as matching
    from ._conditions import words_of as words_of
    from ._page import load_page_parts as load_page_parts
    from ._page import render_report as render_report
    from ._page import write_report as write_report
    from ._runs_table import runs_document as runs_document
    from ._runs_table import runs_table as runs_table
    from ._terminal import finding as finding
    from ._terminal import score_tables as score_tables
    from .assurance._case import AssuranceCase as AssuranceCase
    from .assurance._case import assurance_case as assurance_case
    from .assurance._drawing import assurance_svg as assurance_svg
    from .figures._configuration import configuration_figure as configuration_figure
    from .figures._factor_effects import factor_effects_figure as factor_effects_figure
    from .figures._files import figure_files as figure_files
    from .figures._map import map_figure as map_figure
    from .figures._pairings import pairings_figure as pairings_figure
    from .figures._run_drawing import run_drawing as run_drawing
    from .graph._drawing import graph_page as graph_page
    from .graph._drawing import graph_svg as graph_svg
    from .map._run_choice import choose_runs as choose_runs
    from .map._run_map import RunMap as RunMap
    from .map._run_map import build_run_map as build_run_map
    from .pictures._boxed_frames import boxed_frames as boxed_frames
    from .statistics._agent_comparison import Comparison as Comparison
    from .statistics._agent_comparison import compare_agents as compare_agents
    from .statistics._agent_comparison import compare_campaigns as compare_campaigns
    from .statistics._calibration import Calibration as Calibration
    from .statistics._calibration import NodeCalibration as NodeCalibration
    from .statistics._calibration import calibrate as calibrate
    from .statistics._calibration import fit_difficulty as fit_difficulty
    from .statistics._design_quality import campaign_design_points as campaign_design_points
    from .statistics._design_quality import campaign_design_quality as campaign_design_quality
    from .statistics._design_quality import difficulty_rating as difficulty_rating
    from .statistics._design_quality import measure_design as measure_design
    from .statistics._design_quality import measured_rating as measured_rating
    from .statistics._factor_effects import FactorEffects as FactorEffects
    from .statistics._factor_effects import factor_effects as factor_effects
    from .statistics._pairings import Pairing as Pairing
    from .statistics._pairings import pair_agents as pair_agents
    from .text._comparison import divergence_cells as divergence_cells
    from .text._comparison import rate_cells as rate_cells
    from .text._comparison import unpaired_cells as unpaired_cells
    from .text._format import plural as plural
    from .text._sheet import Sheet as Sheet
    from .text._sheet import sheets as sheets

# Lazy, because the page's templates and statistics take CPU seconds to import: what rates situations needs few of them.
__getattr__ = lazy_names(__name__)
