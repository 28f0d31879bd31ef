"""Decompositions and tables from elsewhere: ids of any text, and key factors that no SimSpec has."""

from __future__ import annotations

import csv
import io
from xml.etree import ElementTree

import pytest
from pydantic import ValidationError

from bench.errors import SetupError
from bench.reporting import graph_page, graph_svg
from bench.scoring import configuration_of, read_table, score_table, summary_frame
from decompositions import Decomposition, DecompositionDocument, DecompositionVocabulary, decomposition_of

NASTY = (
    '3.2 (a), "quoted"',
    "<script>alert('x')</script>",
    "../up/and=down|#%20&amp;",
    "Überblick 東京 🚁",
    "007",
    "7",
)


def foreign(
    ids: tuple[str, ...] = NASTY,
    factor: str = "operator load (tasks)",
    units: tuple[str, ...] = ("tasks", "tasks", "tasks"),
    vocabulary: DecompositionVocabulary | None = None,
) -> Decomposition:
    principle, attribute, vab, *leaves = ids

    def node(name: str, *children: str) -> dict[str, object]:
        return {"id": name, "title": "Title", "asks": "Do it.", "children": children}

    row = {
        "factor": factor, "ratings": [20, 80], "values": [1, 5], "reason": "Guess.",
    }  # fmt: skip
    observables = [
        {
            "id": name, "title": "Leaf", "asks": "Do it.", "measure": "made_elsewhere", "threshold": 0.5,
            "threshold_reason": "Half.", "considered": "Always.", "key_factors": [row | {"unit": unit}],
        }
        for name, unit in zip(leaves, units, strict=True)
    ]  # fmt: skip
    document = {
        "format": "rebar.decomposition/1", "name": "foreign", "title": "Foreign", "study": [attribute],
        "principles": [node(principle, attribute)], "key_attributes": [node(attribute, vab)],
        "vabs": [node(vab, *leaves)], "observables": observables,
    }  # fmt: skip
    return decomposition_of(DecompositionDocument.model_validate(document), vocabulary)


def test_a_table_with_its_own_ids_and_factors_is_scored() -> None:
    """Ids keep every character, 7 is not 007, and a factor that the bench does not know is rated all the same."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["run", "observable", "x", "operator load (tasks)"])
    for run, load in (("r 1", 1), ("r,2", 3)):
        for leaf, x in (("Überblick 東京 🚁", 1), ("007", 0), ("7", 1)):
            writer.writerow([run, leaf, x, load])
    decomposition = foreign()
    table = read_table(text.getvalue(), decomposition)
    scores = score_table(decomposition, table.runs)
    by_node = {
        (row["realization"], row["node"]): (row["difficulty"], row["achieved"])
        for row in scores.iter_rows(named=True)
    }
    assert by_node["r 1", "007"] == (20.0, 0)
    assert by_node["r,2", "7"] == (50.0, 1)
    assert by_node["r,2", NASTY[0]] == (50.0, 2)
    summary = summary_frame(scores, decomposition)
    assert set(summary["node"]) == set(NASTY)
    back = list(csv.DictReader(io.StringIO(summary.write_csv())))
    assert {row["node"] for row in back} == set(NASTY)
    assert configuration_of(decomposition, table.runs[0].difficulty) == f"{NASTY[1]}=20"


def test_drawings_show_ids_as_text() -> None:
    """Both are well formed, and no id becomes markup or script."""
    decomposition = foreign()
    svg = graph_svg(decomposition)
    assert ElementTree.fromstring(svg).tag.endswith("svg")
    page = graph_page(decomposition)
    assert "<script>alert" not in svg + page
    assert "<script>alert" not in graph_svg(foreign(tuple(reversed(NASTY))))


@pytest.mark.parametrize("name", ["", " a", "a ", "a\nb", "a\tb", "a\x00", "a\u202eb", "a\u2028b", "x" * 121])
def test_an_id_that_breaks_a_line_or_hides_is_refused(name: str) -> None:
    """Empty, blanks at an end, line breaks, control characters, text direction, too long."""
    with pytest.raises(ValidationError):
        foreign((name, *NASTY[1:]))


def test_only_given_values_may_have_factors_of_their_own() -> None:
    """A campaign rates from the SimSpec, which has no such factor; a known one keeps its unit everywhere."""
    known = {"rain": "mm"}
    foreign(vocabulary=DecompositionVocabulary(known, difficulty="given"))
    with pytest.raises(SetupError, match="there is no key factor 'operator load"):
        foreign(vocabulary=DecompositionVocabulary(known))
    with pytest.raises(SetupError, match="the unit 'tasks' is not the unit of the key factor 'rain'"):
        foreign(factor="rain", vocabulary=DecompositionVocabulary(known, difficulty="given"))


def test_factors_that_cannot_be_read_are_refused() -> None:
    """One with the name of another column, and one in two units."""
    with pytest.raises(SetupError, match="the key factor 'x' of foreign has the name of another column"):
        read_table("run,observable,x\nr,7,1\n", foreign(factor="x"))
    with pytest.raises(SetupError, match="give 'load' in h, tasks"):
        read_table("run,observable,x,load\nr,7,1,2\n", foreign(factor="load", units=("tasks", "h", "tasks")))
