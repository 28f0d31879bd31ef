"""The assurance case: its elements are those of the notation, its numbers those of the scores, its drawing holds all of it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from itertools import combinations

import networkx as nx
import polars as pl
import pytest
from made_campaign import AGENTS, OBSERVABLES, PRINCIPLES, Made, make_campaign
from scipy.stats import binomtest

from bench.contracts import Outcome
from bench.errors import SetupError
from bench.reporting import AssuranceCase, ReportData, assurance_case, assurance_svg, load_report_data

SVG = "{http://www.w3.org/2000/svg}"
SUPPORT = {"goal": {"goal", "strategy", "solution"}, "strategy": {"goal", "strategy", "solution"}}
CONTEXT = {kind: {"context", "assumption", "justification"} for kind in ("goal", "strategy")}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    """Two agents; one run that the bench spoilt; a description and an agent's reason that would break markup."""
    endings = {f"p001-r0-{AGENTS[0]}": (Outcome.BENCH_ERROR, "<b>&")}
    made = load_report_data(make_campaign(tmp_path_factory.mktemp("case") / "c", Made(endings=endings)))
    files = {"scores.parquet": "a1" * 32, "runs.csv": "b2" * 32, "campaign.yaml": "c3" * 32}
    return replace(made, name="<i>made & up</i>", manifest={**made.manifest, "files": files})


@pytest.mark.parametrize("agent", AGENTS)
def test_every_element_is_supported_as_the_notation_has_it(data: ReportData, agent: str) -> None:
    """One top goal, no circle, everything reached from it; only goals and strategies rest on others."""
    case = assurance_case(data, agent)
    elements = {element.id: element for element in case.elements}
    assert len(elements) == len(case.elements)
    graph: nx.DiGraph[str] = nx.DiGraph()
    for element in case.elements:
        for relation, allowed in ((element.supported_by, SUPPORT), (element.in_context_of, CONTEXT)):
            assert {elements[name].kind for name in relation} <= allowed.get(element.kind, set())
            graph.add_edges_from((element.id, name) for name in relation)
        # Nothing is left open in silence: a goal is supported, or says that it is undeveloped.
        if element.kind in ("goal", "strategy"):
            assert bool(element.supported_by) is not element.undeveloped, element.text
        else:
            assert not element.undeveloped
    assert nx.is_directed_acyclic_graph(graph)
    assert [name for name in graph if not graph.in_degree(name)] == [case.elements[0].id]
    assert AssuranceCase.model_validate_json(case.model_dump_json()) == case


@pytest.mark.parametrize("agent", AGENTS)
def test_the_numbers_are_those_of_the_scores(data: ReportData, agent: str) -> None:
    """Counted again from the table: verdicts of principles, key attributes achieved whole, and the recordings that count."""
    case = assurance_case(data, agent)
    rows = data.scores.filter(pl.col("agent").cast(pl.String) == agent)
    solutions = {element.node: element for element in case.elements if element.kind == "solution"}
    assert solutions.keys() == {*PRINCIPLES, *OBSERVABLES}
    for node, solution in solutions.items():
        of_node = rows.filter(pl.col("node").cast(pl.String) == node, pl.col("considered") > 0)
        whole = of_node["achieved"] == of_node["considered"]
        passed = of_node["verdict"].drop_nulls() if node in PRINCIPLES else whole
        assert (solution.passed, solution.runs) == (int(passed.sum()), len(passed))
        exact = binomtest(int(passed.sum()), len(passed)).proportion_ci(0.95, "exact")
        assert (solution.low, solution.high) == pytest.approx((exact.low, exact.high))
        assert solution.evidence == {"scores.parquet": "a1" * 32, "runs.csv": "b2" * 32}
    spoilt = {f"p001-r0-{AGENTS[0]}"}
    assert set(case.recordings) == {run.realization for run in data.runs if run.agent == agent} - spoilt
    assert any(str(data.document.digest)[:16] in element.text for element in case.elements)  # type: ignore[union-attr]


def test_what_no_run_showed_is_undeveloped(data: ReportData) -> None:
    """A principle without a verdict, a key attribute and observables that no run considered."""
    gone = ("KA-20", "OBS-201", "OBS-202", "OBS-181")
    tallies = {key: tally for key, tally in data.tallies.items() if key[2] not in gone}
    reliable = (AGENTS[1], "all", "P-RELIABLE")
    tallies[reliable] = replace(tallies[reliable], verdict_passed=0, verdict_considered=0)
    case = assurance_case(replace(data, tallies=tallies), AGENTS[1])
    undeveloped = {element.node: element.text for element in case.elements if element.undeveloped}
    assert undeveloped["P-RELIABLE"].endswith("shown in no run")
    assert undeveloped["KA-18"] == "1 of 2 observables of KA-18 were considered in no run: OBS-181"
    # Nothing is argued below a principle of which nothing was shown.
    assert "KA-20" not in {element.node for element in case.elements}
    with pytest.raises(SetupError, match="has no agent 'nobody'"):
        assurance_case(data, "nobody")
    with pytest.raises(SetupError, match="no decomposition that can be read"):
        assurance_case(replace(data, document=None), AGENTS[0])


def test_the_drawing_has_every_element_and_none_on_another(data: ReportData) -> None:
    case = assurance_case(data, AGENTS[0])
    root = ElementTree.fromstring(assurance_svg(case))
    boxes = {}
    for group in root.iter(f"{SVG}g"):
        x, y = map(float, re.findall(r"[\d.]+", group.attrib["transform"]))
        shape = group.find(f"{SVG}rect")
        if shape is None:  # a strategy: M14 0H{width}L{width - 14} {height}H0Z
            path = group.find(f"{SVG}path")
            assert path is not None
            width, height = re.findall(r"H([\d.]+)L\S+ ([\d.]+)H0Z", path.attrib["d"])[0]
        else:
            width, height = shape.attrib["width"], shape.attrib["height"]
        boxes[group.attrib["id"]] = (x, y, x + float(width), y + float(height))
        title = group.findtext(f"{SVG}title")
        element = next(element for element in case.elements if element.id == group.attrib["id"])
        assert title == f"{element.id} {element.text}"
        lines = [text.text or "" for text in group.findall(f"{SVG}text")]
        shown = " ".join(lines).split(f"{element.id} ")[-1].removesuffix(" …")
        # A line may also end behind a hyphen.
        assert element.text.replace(" ", "").startswith(shown.replace(" ", ""))
    assert boxes.keys() == {element.id for element in case.elements}
    for (first, a), (second, b) in combinations(boxes.items(), 2):
        apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
        assert apart, (first, second)
    width, height = float(root.attrib["width"]), float(root.attrib["height"])
    assert max(box[2] for box in boxes.values()) <= width
    assert max(box[3] for box in boxes.values()) <= height
    arrows = [path for path in root.iter(f"{SVG}path") if "supported-by" in path.get("marker-end", "")]
    assert len(arrows) == sum(len(element.supported_by) for element in case.elements)
    assert assurance_svg(case) == assurance_svg(assurance_case(data, AGENTS[0]))
