"""Tables from elsewhere: the same scores as the bench's own, and every fault of a bad one with its line, at once."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from xml.etree import ElementTree

import pytest
from made_decompositions import factor_row, leaf, made_decomposition, node, worked_decomposition
from pydantic import ValidationError

from bench.errors import Fault, SetupError
from bench.reporting import graph_page, graph_svg
from bench.scoring import absent_pairs, configuration_of, read_table, score_run, score_table, summary_frame
from bench.scoring._external import ExternalTable
from decompositions import Decomposition, DecompositionVocabulary

FOG, RAIN = (factor_row(factor, [10, 100], [0, 9]) for factor in ("fog_level", "rain_level"))


@pytest.fixture
def external() -> Decomposition:
    return worked_decomposition()


@pytest.fixture
def rated() -> Decomposition:
    rows = {"OBS1": [FOG], "OBS2": [FOG, RAIN], "OBS3": [RAIN]}
    return worked_decomposition([leaf(name, *tables) for name, tables in rows.items()])


WORKED = """run,observable,difficulty,x,considered
1,OBS1,30,1,
1,OBS2,80,1,true
1,OBS3,50,0.9,YES
2,OBS1,30,0,1
2,OBS2,80,0.5,
2,OBS3,50,1,
"""


def faults_of(text: str, decomposition: Decomposition) -> list[Fault]:
    with pytest.raises(SetupError) as caught:
        read_table(text, decomposition, "t.csv")
    return list(caught.value.faults)


def test_the_worked_example_has_its_numbers(external: Decomposition) -> None:
    """Also behind a byte order mark."""
    table = read_table(WORKED, external)
    assert read_table("\ufeff" + WORKED, external).runs == table.runs
    assert [run.realization for run in table.runs] == ["1", "2"]
    second = score_run(external, table.runs[1].difficulty, table.runs[1].observations)
    assert (second["VAB1"].score, second["KA1"].score, second["KA1"].confidence) == (80.0, 50.0, 2 / 3)
    summary = summary_frame(score_table(external, table.runs), external)
    row = summary.filter(node="KA1", configuration="all").row(0, named=True)
    assert (row["score_mean"], row["confidence_mean"]) == (40.0, pytest.approx(5 / 6))


def test_lines_are_those_of_the_file(external: Decomposition) -> None:
    """Blank lines and quoted line breaks do not shift the lines that are told."""
    text = 'run,observable,difficulty,x\n\n"a\nb",OBS1,30,1\nc,OBS1,30,1\n'
    assert dict(read_table(text, external).lines) == {("a\nb", "OBS1"): 3, ("c", "OBS1"): 5}


def test_a_missing_row_is_not_considered_and_is_counted(external: Decomposition) -> None:
    """Absent pairs have neither score nor difficulty; they are shown by number."""
    table = read_table("run,observable,difficulty,x,considered\na,OBS1,30,1,\nb,OBS3,40,,no\n", external)
    assert absent_pairs(external, table.runs) == 4
    scores = score_table(external, table.runs)
    rows = {(row["realization"], row["node"]): row for row in scores.iter_rows(named=True)}
    assert (rows["a", "KA1"]["score"], rows["a", "KA1"]["difficulty"], rows["a", "VAB2"]["difficulty"]) == (
        30.0,
        30.0,
        None,
    )
    assert (
        rows["b", "VAB1"]["considered"],
        rows["b", "KA1"]["confidence"],
        rows["b", "OBS3"]["difficulty"],
    ) == (0, None, 40.0)
    summary = summary_frame(scores, external).filter(node="VAB2", configuration="all").row(0, named=True)
    assert (summary["considered"], summary["score_mean"], summary["difficulty"]) == (0, None, 40.0)


def test_a_studied_attribute_without_rows_has_an_unknown_difficulty() -> None:
    """A run that says nothing of a key attribute lies in a configuration of its own, said to be unknown."""
    decomposition = worked_decomposition(key_attributes=[node("KA1", ["VAB1"]), node("KA2", ["VAB2"])])
    scores = score_table(
        decomposition, read_table("run,observable,difficulty,x\na,OBS1,30,1\n", decomposition).runs
    )
    assert scores["configuration"].unique().to_list() == ["KA1=30 KA2=unknown"]


def test_design_points_and_agents_are_optional(external: Decomposition) -> None:
    """Without a design point each run is its own; runs of one share it as replicates."""
    alone = read_table(WORKED, external).runs
    assert [(run.design_point, run.replicate, run.agent) for run in alone] == [
        ("1", 0, "agent"),
        ("2", 0, "agent"),
    ]
    text = "run,observable,difficulty,x,design_point,agent\na,OBS1,30,1,p,one\nb,OBS1,30,1,p,two\n"
    together = read_table(text, external).runs
    assert [(run.design_point, run.replicate, run.agent) for run in together] == [
        ("p", 0, "one"),
        ("p", 1, "two"),
    ]


def test_factor_columns_are_rated_by_the_tables(rated: Decomposition) -> None:
    """With the key factors in the table, difficulty is rated here, for every observable, absent ones too."""
    table = read_table(
        "run,observable,x,fog_level,rain_level\na,OBS1,1,9,4.5\na,OBS2,1,9,4.5\nb,OBS1,1,0,4.5\n", rated
    )
    first, second = table.runs
    assert first.difficulty.of("OBS1") == 100.0
    assert first.difficulty.observables["OBS2"].ruled_by == ("rain_level",)
    assert (first.difficulty.of("KA1"), second.difficulty.of("KA1")) == (55.0, 10.0)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("run,observable,difficulty,x\na,OBS1,30,1\na,OBS1,30,1\n", 3, "has OBS1 already on line 2"),
        ("run,observable,difficulty,x\na,OBS9,30,1\n", 2, "no observable 'OBS9'"),
        ("run,observable,difficulty,x\na,OBS1,30,1.01\n", 2, "x 1.01 lies outside 0 to 1"),
        ("run,observable,difficulty,x\na,OBS1,30,-1e-9\n", 2, "lies outside 0 to 1"),
        ("run,observable,difficulty,x\na,OBS1,30,nan\n", 2, "is not a number"),
        ("run,observable,difficulty,x\na,OBS1,30,1_0\n", 2, "is not a number"),
        ("run,observable,difficulty,x\na,OBS1,30,\n", 2, "x is empty where considered is not false"),
        ("run,observable,difficulty,x\na,OBS1,101,1\n", 2, "difficulty 101 lies outside 0 to 100"),
        ("run,observable,difficulty,x\na,OBS1,,1\n", 2, "difficulty is empty"),
        ("run,observable,difficulty,x,considered\na,OBS1,1,1,maybe\n", 2, "considered is 'maybe'"),
        ("run,observable,difficulty,x\n,OBS1,1,1\n", 2, "run is empty"),
        ("run,observable,difficulty,x\na,OBS1,1\n", 2, "3 cells, and the header has 4"),
        ("run,observable,difficulty,x,mood\na,OBS1,1,1,good\n", 1, "unknown column 'mood'"),
        ("run,observable,difficulty\na,OBS1,1\n", 1, "the column 'x' is missing"),
        ("run,observable,x\na,OBS1,1\n", 1, "the column 'difficulty' is missing"),
        ("run,observable,difficulty,x,x\na,OBS1,1,1,1\n", 1, "'x' appears twice"),
        ("run;observable;difficulty;x\na;OBS1;1;1\n", 1, "not separated by commas"),
        (
            "run,observable,difficulty,x,agent\na,OBS1,1,1,n\na,OBS2,1,1,m\n",
            3,
            "agent 'm' here and 'n' on line 2",
        ),
        (
            "run,observable,difficulty,x,fog_level\na,OBS1,1,1,3\n",
            1,
            "a difficulty and factor columns too: fog_level",
        ),
        ("run,observable,x,fog_level\na,OBS1,1,3\n", 1, "the factor column 'rain_level' is missing"),
        (
            "run,observable,x,fog_level,rain_level\na,OBS1,1,3,1\na,OBS2,1,4,1\n",
            3,
            "fog_level 4.0 here and 3.0 on line 2",
        ),
        ("run,observable,x,fog_level,rain_level\na,OBS1,1,,1\n", 2, "fog_level is empty"),
        ("run,observable,difficulty,x\n", 1, "has no rows"),
        ("", 1, "has no rows"),
        ('run,observable,difficulty,x\n"a,OBS1,1,1\n', 2, "not valid CSV"),
    ],
)
def test_each_fault_has_its_line(text: str, line: int, message: str, rated: Decomposition) -> None:
    """What does not hold is told with file, line and mend."""
    faults = [fault for fault in faults_of(text, rated) if message in fault.what]
    assert faults, faults_of(text, rated)
    assert faults[0].where == f"t.csv:{line}"
    assert faults[0].remedy


def test_all_faults_come_at_once(external: Decomposition) -> None:
    """Ten rows with ten faults are mended in one round; ten thousand are cut short and counted."""
    rows = ["a,OBS1,101,2,maybe", "a,OBS9,30,1,", ",OBS2,30,1,", "b,OBS1,30,,1"]
    text = "run,observable,difficulty,x,considered\n" + "\n".join(rows)
    assert [fault.where for fault in faults_of(text, external)] == ["t.csv:2"] * 3 + [
        "t.csv:3",
        "t.csv:4",
        "t.csv:5",
    ]
    faults = faults_of(
        "run,observable,difficulty,x\n" + "\n".join(f"r{i},OBS1,30,7" for i in range(1000)), external
    )
    assert (len(faults), faults[-1].what) == (201, "800 more faults")


def test_what_stands_beside_a_row_that_is_not_considered_is_ignored(external: Decomposition) -> None:
    """x of such a row plays no part, and an empty one is right there."""
    table: ExternalTable = read_table(
        "run,observable,difficulty,x,considered\na,OBS1,30,0.2,FALSE\na,OBS2,30,,No\na,OBS3,30,,0\n", external
    )
    assert all(not row.considered and row.x is None for row in table.runs[0].observations)


NASTY = (
    '3.2 (a), "quoted"',
    "<script>alert('x')</script>",
    "../up/and=down|#%20&amp;",
    "Überblick 東京 🚁",
    "007",
    "7",
)


def foreign(
    ids: Sequence[str] = NASTY,
    factor: str = "operator load (tasks)",
    units: Sequence[str] = ("tasks", "tasks", "tasks"),
    vocabulary: DecompositionVocabulary | None = None,
) -> Decomposition:
    principle, attribute, vab, *leaves = ids
    tables = [factor_row(factor, [20, 80], [1, 5], unit) for unit in units]
    return made_decomposition(
        [leaf(name, row) for name, row in zip(leaves, tables, strict=True)],
        {vab: leaves},
        {attribute: [vab]},
        {principle: [attribute]},
        vocabulary=vocabulary,
        study=[attribute],
    )


def test_a_table_with_its_own_ids_and_factors_is_scored() -> None:
    """Ids keep every character, 7 is not 007, and a factor that the bench does not know is rated all the same."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["run", "observable", "x", "operator load (tasks)"])
    for run, load in (("r 1", 1), ("r,2", 3)):
        for name, x in (("Überblick 東京 🚁", 1), ("007", 0), ("7", 1)):
            writer.writerow([run, name, x, load])
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
    with pytest.raises(SetupError, match="the key factor 'x' of made has the name of another column"):
        read_table("run,observable,x\nr,7,1\n", foreign(factor="x"))
    with pytest.raises(SetupError, match="give 'load' in h, tasks"):
        read_table("run,observable,x,load\nr,7,1,2\n", foreign(factor="load", units=("tasks", "h", "tasks")))
