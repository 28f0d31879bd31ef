"""The page: report data laid out in one self-contained HTML file that fetches nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from bench.contracts import Outcome, ReportStatements
from bench.errors import SetupError
from bench.recording import read_simspec, read_tape
from bench.scoring import statement_reports

from ._campaign_data import ALL_CONFIGURATIONS, ReportData
from ._campaign_folder import load_report_data
from ._html import content_security_policy, normalized_script, template_environment, template_text
from ._page_sections import (
    PageFigures,
    agent_pairs,
    configuration_panels,
    flattened,
    map_section,
    node_trees,
    outcome_counts,
    studied_nodes,
    verdict_rows,
)
from ._remarks import TABLE_MARKS
from ._simspec_files import situations_of
from .figures._configuration import MIN_VIOLIN_SCORES, MIN_VIOLIN_SPREAD
from .figures._factor_effects import factor_effects_figure
from .figures._style import agent_styles, empty_figure
from .map._run_choice import choose_runs
from .map._run_map import RunMap, build_run_map
from .pictures._worst_pictures import MAX_PICTURES, PICTURE_KEY, WorstPicture, worst_pictures
from .statistics._design_quality import campaign_design_quality
from .statistics._factor_effects import factor_effects
from .statistics._sensor import detector_sentences, sensor_observables
from .statistics._trials import trials_of
from .text._answer import answer_paragraph
from .text._campaign_facts import campaign_facts, factor_rows, provenance_of
from .text._campaign_sentences import (
    confidence_extremes,
    difference_sentences,
    disclaimers,
    sessions_sentence,
)
from .text._comparison import comparison_cells
from .text._fidelity import fidelity_note, with_table_notes
from .text._format import (
    interval,
    number,
    p_value,
    passed_interval,
    percent,
    score,
    span,
)
from .text._glossary import GLOSSARY
from .text._isolation import UNCONFINED, confinement_notes, isolation_cell
from .text._outcomes import outcome_name, outcome_text

# Chosen, not measured: a manifest has a row for every file, which in a large campaign would be most of the
# page.
MANIFEST_ROWS = 5000
# Of the npm package plotly.js-cartesian-dist-min, unchanged, in the version that the locked Python package carries.
PLOTLY = "plotly-cartesian.min.js"


def _is_shown(name: str) -> bool:
    """Whether the page shows an entry of the manifest."""
    # The page cannot contain its own digest, nor that of the manifest which lists it; and digests of logs and journal
    # would make the pages of two equal campaigns differ.
    return "report.html" not in name and not name.startswith(("self_sha256", "host_files"))


def load_page_parts() -> None:
    """Load what every page needs: the figure library and the templates. Doing it again does nothing."""
    # Plotly imports its figures, 0.3 s of a CPU, when the first one is made.
    empty_figure(height=100, margin={})
    _environment().get_template("report.html.j2")


def write_report(folder: Path, path: Path | None = None, *, runs_on_map: int = 6) -> Path:
    """Write the report of a campaign's folder and return its path; the same folder gives the same bytes.

    Without a `path` it is `report.html` in the folder; with one, nothing in the folder is written.

    Raises SetupError when `folder` holds no campaign. The report names what is missing or damaged in it.
    """
    data = load_report_data(folder)
    charts, map_notes = _charts(data, runs_on_map)
    pictures, picture_notes = worst_pictures(data)
    path = path or folder / "report.html"
    # Hidden and with this ending, as the campaign's other files are while they are written: verification passes over it.
    draft = path.with_name(f".{path.name}.part")
    with draft.open("w", encoding="utf-8") as file:
        file.writelines(page_pieces(data, charts, map_notes, pictures, picture_notes))
    # Renamed at the end: a reader, or a browser that reloads, never gets half a page.
    draft.replace(path)
    return path


def render_report(
    data: ReportData,
    charts: Sequence[RunMap] = (),
    map_notes: Sequence[str] = (),
    pictures: Sequence[WorstPicture] = (),
    picture_notes: Sequence[str] = (),
) -> str:
    """The page as text; `page_pieces` says what the arguments are."""
    return "".join(page_pieces(data, charts, map_notes, pictures, picture_notes))


def page_pieces(
    data: ReportData,
    charts: Sequence[RunMap] = (),
    map_notes: Sequence[str] = (),
    pictures: Sequence[WorstPicture] = (),
    picture_notes: Sequence[str] = (),
) -> Iterator[str]:
    """The page as text, piece by piece: with 20,000 runs it has 18 MB, and would be in memory several times.

    `charts` are the runs to show from above, `pictures` the frames in which a detector failed; the notes say what cannot
    be shown.
    """
    figures = PageFigures()
    comparisons = agent_pairs(data, figures)
    matter = factor_effects(data)
    # Plotly is part of the page, because the page fetches nothing and must still open offline. The Python package has
    # only the whole of it (4.8 MB); the bundle "cartesian" (1.5 MB) is the smallest that has violins.
    plotly, script = (normalized_script(template_text(name)) for name in (PLOTLY, "report.js"))
    shown = agent_styles(data.agents)
    trials = trials_of(data.scores)
    names, counts = outcome_counts(data, shown)
    # Agents that saw the truth and suspects first: whoever reads the list is to see them before anything else.
    runs = sorted(data.runs, key=lambda run: [run.fact(mark.kind) is None for mark in TABLE_MARKS])
    context: dict[str, Any] = {
        "data": data,
        "fidelity": fidelity_note(data.campaign),
        "agent_styles": shown,
        "css": Markup(template_text("report.css")),
        "policy": content_security_policy(plotly, script),
        "flown": sessions_sentence(data),
        "verdicts": [(style, rows) for style in shown if (rows := verdict_rows(data, style.name))],
        "answers": {style.name: answer_paragraph(data, style.name) for style in shown},
        "differences": [line for pair in comparisons for line in difference_sentences(data, pair.comparison)],
        "not_claimed": disclaimers(data),
        "facts": campaign_facts(data),
        "quality": campaign_design_quality(data),
        "raised": any(t.raised for (_, where, _), t in data.tallies.items() if where == ALL_CONFIGURATIONS),
        "factors": factor_rows(data),
        "outcome_names": names,
        "outcome_counts": counts,
        "studied": studied_nodes(data, shown, trials, figures) if data.tallies else [],
        "trees": node_trees(data, shown, trials),
        "panels": configuration_panels(data, shown, figures),
        "sensor": sensor_observables(data),
        "statements": statement_reports(
            (run.agent, run.scene, run.fact(ReportStatements))
            for agent in data.agents
            for run in data.runs
            if run.agent == agent and run.outcome is not None and run.outcome.counts and not run.after_stop
        ),
        "style_of": {style.name: style for style in shown},
        "detectors": detector_sentences(simspec.perception for _, simspec in situations_of(data.simspecs)),
        "maps": [map_section(chart, place, figures) for place, chart in enumerate(charts, start=1)],
        "map_notes": map_notes,
        "pictures": pictures,
        "picture_notes": picture_notes,
        "picture_key": PICTURE_KEY,
        "max_pictures": MAX_PICTURES,
        "comparisons": comparisons,
        "matter": matter,
        "factors_id": figures.add("factors-1", factor_effects_figure(matter)) if matter.tables else "",
        "listed_runs": runs,
        "marks": TABLE_MARKS,
        "unconfined": UNCONFINED,
        "confinement": confinement_notes(data),
        "probed": any(run.probes for run in runs),
        "failures": [run for run in runs if run.outcome is not Outcome.COMPLETED],
        "provenance": provenance_of(data),
        "manifest": list(
            islice((row for row in flattened(data.manifest) if _is_shown(row[0])), MANIFEST_ROWS)
        ),
        "labels": {configuration.key: configuration.label for configuration in data.configurations},
        "glossary": GLOSSARY,
        "violin_from": MIN_VIOLIN_SCORES,
        "violin_spread": f"{MIN_VIOLIN_SPREAD:g}",
        "version": version("rebar-bench"),
        "figures": figures.drawn,
        "plotly": Markup(plotly),
        "script": Markup(script),
    }
    pieces = _environment().get_template("report.html.j2").generate(context)
    return with_table_notes(pieces, context["fidelity"])


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
        comparison_cells=comparison_cells,
        outcome_name=outcome_name,
        outcome_text=outcome_text,
        isolation_cell=isolation_cell,
        confidence_extremes=confidence_extremes,
    )
    return templates
