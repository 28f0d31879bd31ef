"""The report: what a campaign left on disk, as one HTML file that works offline, and the same scores for the terminal.

from bench.reporting import write_report
print(write_report(Path("out/demo")))
"""

from __future__ import annotations

from ._data import ReportData as ReportData
from ._data import load_report_data as load_report_data
from ._design import measure_design as measure_design
from ._design import points_of as points_of
from ._design import quality_of as quality_of
from ._design import rating as rating
from ._figures import configuration_figure as configuration_figure
from ._figures import pairs_figure as pairs_figure
from ._graph import graph_page as graph_page
from ._graph import graph_svg as graph_svg
from ._map import RunMap as RunMap
from ._map import choose_runs as choose_runs
from ._map import draw_map as draw_map
from ._map_figure import map_figure as map_figure
from ._page import render_report as render_report
from ._page import write_report as write_report
from ._pairs import Pairing as Pairing
from ._pairs import pair_agents as pair_agents
from ._statistics import Comparison as Comparison
from ._statistics import FactorsMatter as FactorsMatter
from ._statistics import compare_agents as compare_agents
from ._statistics import compare_campaigns as compare_campaigns
from ._statistics import factors_figure as factors_figure
from ._statistics import factors_that_matter as factors_that_matter
from ._terminal import score_lines as score_lines
from ._terminal import score_table as score_table
