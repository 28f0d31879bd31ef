"""The page: report data laid out in one self-contained HTML file that fetches nothing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import polars as pl
from markupsafe import Markup

from bench.contracts import ReportStatements
from bench.errors import SetupError
from bench.recording import read_simspec, read_tape
from bench.scoring import statement_reports

from ._campaign_data import ALL_CONFIGURATIONS, ReportData
from ._campaign_folder import load_report_data
from ._companions import companions
from ._html import (
    content_security_policy,
    json_script_text,
    normalized_script,
    template_environment,
    template_text,
)
from ._page_sections import (
    agent_pairs,
    configuration_panels,
    map_section,
    node_trees,
    outcome_counts,
    studied_nodes,
)
from ._runs_table import failed_stages, listed_runs, runs_document, runs_table
from ._simspec_files import situations_of
from .figures._configuration import MIN_VIOLIN_SCORES, MIN_VIOLIN_SPREAD
from .figures._factor_effects import factor_effects_figure
from .figures._style import agent_styles
from .map._run_choice import choose_runs
from .map._run_map import RunMap, build_run_map
from .pictures._worst_pictures import MAX_PICTURES, PICTURE_KEY, WorstPicture, worst_pictures
from .statistics._design_quality import campaign_design_quality
from .statistics._factor_effects import factor_effects
from .statistics._measured import MeasuredCompetence, measured_competence
from .statistics._sensor import detector_sentences, sensor_observables
from .statistics._trials import trials_of
from .text._answer import answer_paragraph
from .text._campaign_facts import campaign_facts, factor_rows, provenance_of
from .text._campaign_sentences import (
    difference_sentences,
    disclaimers,
    sessions_sentence,
)
from .text._comparison import divergence_cells, rate_cells
from .text._fidelity import fidelity_note, with_table_notes
from .text._format import (
    interval,
    listed,
    number,
    p_value,
    passed_interval,
    percent,
    plural,
    score,
    span,
)
from .text._glossary import GLOSSARY
from .text._isolation import confinement_notes
from .text._outcomes import endings
from .text._sheet import sheets


def load_page_parts() -> None:
    """Load the templates that every page needs. Doing it again does nothing."""
    _environment().get_template("report.html.j2")


def write_report(folder: Path, path: Path | None = None, *, runs_on_map: int = 6) -> Path:
    """Write the report of a campaign's folder and return its path; the same folder gives the same bytes.

    Without a `path` it is `report.html` in the folder, with the files COMPANIONS beside it; with one, it is the page alone,
    and nothing in the folder is written.

    Raises SetupError when `folder` holds no campaign. The report names what is missing or damaged in it.
    """
    data = load_report_data(folder)
    runs = runs_table(data)
    charts, map_notes = _charts(data, runs_on_map)
    pictures, picture_notes = worst_pictures(data)
    measured = measured_competence(data)
    if path is None:
        for name, text in companions(data, runs, measured).items():
            _write_whole(folder / name, [text])
    path = path or folder / "report.html"
    _write_whole(path, _page_pieces(data, runs, measured, charts, map_notes, pictures, picture_notes))
    return path


def _write_whole(path: Path, pieces: Iterable[str]) -> None:
    # Hidden and with this ending, as the campaign's other files are while they are written: verification passes over it.
    draft = path.with_name(f".{path.name}.part")
    with draft.open("w", encoding="utf-8") as file:
        file.writelines(pieces)
    # Renamed at the end: a reader, or a browser that reloads, never gets half a page.
    draft.replace(path)


def render_report(
    data: ReportData,
    charts: Sequence[RunMap] = (),
    map_notes: Sequence[str] = (),
    pictures: Sequence[WorstPicture] = (),
    picture_notes: Sequence[str] = (),
) -> str:
    """The page as text. `charts` are the runs to show from above, `pictures` the frames in which a detector failed; the notes
    say what cannot be shown.
    """
    tables = runs_table(data), measured_competence(data)
    return "".join(_page_pieces(data, *tables, charts, map_notes, pictures, picture_notes))


def _page_pieces(
    data: ReportData,
    runs: pl.DataFrame,
    measured: MeasuredCompetence,
    charts: Sequence[RunMap],
    map_notes: Sequence[str],
    pictures: Sequence[WorstPicture],
    picture_notes: Sequence[str],
) -> Iterator[str]:
    """The page piece by piece: with 10,080 runs it has 8.6 MB, and would be in memory several times. `runs` is `runs_table`."""
    comparisons = agent_pairs(data)
    matter = factor_effects(data)
    script = normalized_script(template_text("report.js"))
    shown = agent_styles(data.agents)
    trials = trials_of(data.scores)
    names, counts = outcome_counts(data, shown)
    boxes = {chart.run.realization: f"map-{place}-box" for place, chart in enumerate(charts, start=1)}
    context: dict[str, Any] = {
        "data": data,
        "fidelity": fidelity_note(data.campaign),
        "agent_styles": shown,
        "css": Markup(template_text("report.css")),
        "policy": content_security_policy(script),
        "flown": sessions_sentence(data),
        "sheets": sheets(data),
        "answers": {style.name: answer_paragraph(data, style.name) for style in shown},
        "differences": [line for pair in comparisons for line in difference_sentences(data, pair.comparison)],
        "not_claimed": disclaimers(data),
        "facts": campaign_facts(data),
        "quality": campaign_design_quality(data),
        "raised": any(t.raised for (_, where, _), t in data.tallies.items() if where == ALL_CONFIGURATIONS),
        "factors": factor_rows(data),
        "outcome_names": names,
        "outcome_counts": counts,
        "studied": studied_nodes(data, shown, trials) if data.tallies else [],
        "measured": measured,
        "listed_doubts": _by_reason(measured.doubts),
        "trees": node_trees(data, shown),
        "panels": configuration_panels(data, shown),
        "sensor": sensor_observables(data),
        "statements": statement_reports(
            (run.agent, run.scene, run.fact(ReportStatements))
            for agent in data.agents
            for run in data.runs
            if run.agent == agent and run.counts
        ),
        "style_of": {style.name: style for style in shown},
        "detectors": detector_sentences(simspec.perception for _, simspec in situations_of(data.simspecs)),
        "maps": [map_section(chart, place) for place, chart in enumerate(charts, start=1)],
        "map_notes": map_notes,
        "pictures": pictures,
        "picture_notes": picture_notes,
        "picture_key": PICTURE_KEY,
        "max_pictures": MAX_PICTURES,
        "comparisons": comparisons,
        "matter": matter,
        "factors_figure": factor_effects_figure(matter),
        "listed": listed_runs(runs, data),
        "runs_json": json_script_text(runs_document(runs, boxes, failed_stages(runs, data))),
        "confinement": confinement_notes(data),
        "endings": endings(data),
        "provenance": provenance_of(data),
        "glossary": GLOSSARY,
        "violin_from": MIN_VIOLIN_SCORES,
        "violin_spread": f"{MIN_VIOLIN_SPREAD:g}",
        "version": version("rebar-bench"),
        "script": Markup(script),
    }
    pieces = _environment().get_template("report.html.j2").generate(context)
    return with_table_notes(pieces, context["fidelity"])


def _by_reason(doubts: Mapping[str, str]) -> str:
    return "; ".join(
        f"{reason}: {listed([node for node, doubt in doubts.items() if doubt == reason])}"
        for reason in dict.fromkeys(doubts.values())
    )


def _charts(data: ReportData, count: int) -> tuple[list[RunMap], list[str]]:
    """Maps of the chosen runs, and a sentence for each recording that could not be read."""
    charts, notes = [], []
    for run in choose_runs(data, count):
        assert run.recording is not None  # only recorded runs are chosen
        try:
            simspec = read_simspec(run.recording)
            charts.append(build_run_map(run, simspec, read_tape(run.recording, simspec)))
        # One damaged recording loses its map and not the report.
        except (SetupError, OSError):
            notes.append(f"The recording of {run.realization} cannot be read, so it is not drawn.")
    # Only runs that count: others, such as a lost worker, may have ended before they recorded anything.
    absent = [
        run.realization for run in data.runs if run.recording is None and run.outcome and run.outcome.counts
    ]
    if absent:
        more = f" and {len(absent) - 3} more" if len(absent) > 3 else ""
        notes.append(f"No recording is here of {', '.join(absent[:3])}{more}.")
    return charts, notes


@cache
def _environment() -> jinja2.Environment:
    """The templates, compiled once for all pages of a process: that took 40 % of the time of a small page."""
    templates = template_environment()
    templates.globals.update(
        number=number,
        percent=percent,
        score=score,
        interval=interval,
        passed_interval=passed_interval,
        span=span,
        p_value=p_value,
        plural=plural,
        rate_cells=rate_cells,
        divergence_cells=divergence_cells,
    )
    return templates
