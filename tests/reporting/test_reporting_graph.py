"""The graph shows every node and edge, keeps "no number" apart from "low", and shows all text as text."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from chromium import dom_of, needs_chromium
from made_campaign import AGENTS, Made, make_campaign

from bench.errors import SetupError
from bench.reporting import graph_page, graph_svg, load_report_data
from bench.reporting._campaign_data import ReportData
from bench.reporting.graph._layout import lay_out
from decompositions import Decomposition, load_decomposition, shipped_decompositions

SVG = "{http://www.w3.org/2000/svg}"
NASTY = "</script><script>alert(1)</script><img src=x onerror=alert(2)> & \"' <!--"


@pytest.fixture(scope="module")
def full() -> Decomposition:
    """The largest decomposition that comes with the bench."""
    return max(map(load_decomposition, shipped_decompositions()), key=lambda shipped: len(shipped.nodes))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    """Six scenes in which nobody achieves anything under KA-09."""
    folder = make_campaign(tmp_path_factory.mktemp("graph") / "made", Made(never_scored="KA-09"))
    return load_report_data(folder)


@pytest.fixture(scope="module")
def small(data: ReportData) -> Decomposition:
    """The made campaign's decomposition."""
    assert data.document is not None
    return data.document


def edges(decomposition: Decomposition) -> set[tuple[str, str]]:
    return {(node.id, child) for node in decomposition.nodes.values() for child in node.children}


def document(page: str) -> dict[str, Any]:
    """What the page hands to its script."""
    match = re.search(r'<script type="application/json" id="document">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    return json.loads(match[1])  # type: ignore[no-any-return]


def test_drawing_has_every_node_and_edge(full: Decomposition) -> None:
    root = ET.fromstring(graph_svg(full))
    groups = [group for group in root.iter(f"{SVG}g") if "node" in group.attrib.get("class", "").split()]
    boxes = {group.attrib["id"]: group for group in groups}
    assert set(boxes) == set(full.nodes)
    for name, box in boxes.items():
        assert full.nodes[name].title in box.find(f"{SVG}title").text  # type: ignore[union-attr,operator]
        x, y = map(float, re.findall(r"[\d.]+", box.attrib["transform"]))
        assert x + 306 <= float(root.attrib["width"])
        assert y + 30 <= float(root.attrib["height"])
    lines = [
        path.find(f"{SVG}title").text  # type: ignore[union-attr]
        for path in root.iter(f"{SVG}path")
        if "edge" in path.attrib.get("class", "").split()
    ]
    assert sorted(lines) == sorted(f"{parent} – {child}" for parent, child in edges(full))  # type: ignore[type-var]


def test_boxes_do_not_touch_and_first_edges_do_not_cross(full: Decomposition) -> None:
    """Boxes of a column are a row apart; of two edges between two columns, the higher parent has the higher child."""
    laid = lay_out(full)
    for column in range(len(laid.columns)):
        rows = sorted(laid.row[name] for name in full.nodes if laid.column[name] == column)
        assert all(after - before >= 1.0 for before, after in pairwise(rows))
        first = [edge for edge in laid.edges if edge.first and laid.column[edge.parent] == column]
        ends = sorted((laid.row[edge.parent], laid.row[edge.child]) for edge in first)
        assert [child for _, child in ends] == sorted(child for _, child in ends)
    assert sum(edge.first for edge in laid.edges) == sum(bool(parents) for parents in full.parents.values())


def test_page_has_every_node_edge_and_fact(full: Decomposition) -> None:
    page = graph_page(full)
    nodes = {node["id"]: node for node in document(page)["nodes"]}
    assert {(name, child) for name, node in nodes.items() for child in node["children"]} == edges(full)
    for name, leaf in full.observables.items():
        facts = dict(nodes[name]["facts"])
        assert (facts["Measure"], nodes[name]["asks"]) == (leaf.measure, leaf.asks)
        assert facts["Threshold"] == f"{leaf.threshold:g}. {leaf.threshold_reason}"
        assert facts["Considered"].startswith(leaf.considered)
        reasons = [row.reason for row in full.key_factors(name)]
        assert [row["reason"] for row in nodes[name]["tables"]] == reasons
    assert graph_svg(full) in page


def test_one_document_gives_one_text(full: Decomposition, small: Decomposition, data: ReportData) -> None:
    """Drawn twice, from a document read twice; a page of the full application stays below 1 MB."""
    reloaded = load_decomposition(full.name)
    assert graph_svg(reloaded) == graph_svg(full)
    assert graph_page(reloaded) == graph_page(full)
    assert graph_page(small, data) == graph_page(small, data)
    assert len(graph_page(full).encode()) < 1_000_000
    assert len(graph_svg(full).encode()) < 400_000


def test_state_without_a_number_is_not_low(small: Decomposition, data: ReportData) -> None:
    """KA-09 was considered and has no score, but a confidence of 0; a node that the campaign lacks has neither."""
    shown = document(graph_page(small, data))["shown"][AGENTS[0]]["KA-09"]
    assert shown["score"] == ["unscored", "none"]
    assert shown["confidence"] == ["0", "0 %"]
    assert shown["competence"] == ["absent", "–"]
    assert shown["sentences"][0] == "Passed 0 of 6 runs (0 to 46\u00a0%)."
    assert shown["sentences"][1].startswith(
        "Not scored: nothing under it was achieved in any of 6 considered"
    )
    root = ET.fromstring(graph_svg(small, data, AGENTS[0], "score"))
    groups = [group.attrib for group in root.iter(f"{SVG}g") if "id" in group.attrib]
    dressed = {group["id"]: group["class"] for group in groups}
    assert dressed["KA-09"] == "node unscored"
    assert dressed["KA-03"].startswith("node s")
    other = load_decomposition("search-and-report")
    page = graph_page(other, data)
    assert "scored with another decomposition than this one" in page
    assert "VAB-007" not in document(page)["shown"][AGENTS[0]]


def test_never_considered_is_a_state_of_its_own(small: Decomposition, data: ReportData) -> None:
    key = (AGENTS[0], "all", "KA-20")
    nothing = replace(data.tallies[key], considered=0, scored=0, score=None, confidence=None, competence={})
    page = graph_page(small, replace(data, tallies={**data.tallies, key: nothing}))
    shown = document(page)["shown"][AGENTS[0]]["KA-20"]
    assert {shown[by][0] for by in ("score", "confidence", "competence")} == {"unconsidered"}
    assert shown["sentences"][0].startswith("Never considered:")


def test_graph_shows_the_numbers_of_the_summary(small: Decomposition, data: ReportData) -> None:
    shown = document(graph_page(small, data, AGENTS[1]))
    assert shown["agent"] == AGENTS[1]
    for agent in AGENTS:
        for name in small.nodes:
            tally = data.tally(agent, name)
            assert tally is not None
            assert tally.confidence is not None
            step, text = shown["shown"][agent][name]["confidence"]
            assert text == f"{100 * tally.confidence:.0f} %"
            assert int(step) == min(9, int(10 * tally.confidence))


def test_markup_in_a_document_is_escaped(small: Decomposition, data: ReportData, tmp_path: Path) -> None:
    """Markup in titles, questions and reasons opens no element in the drawing, the page or its data."""
    raw = json.loads(small.document.model_dump_json())
    for part in ("principles", "key_attributes", "vabs", "observables"):
        raw[part][0]["title"] = NASTY[:110]
        raw[part][0]["asks"] = NASTY
    raw["observables"][0]["threshold_reason"] = NASTY
    (tmp_path / "nasty.yaml").write_text(yaml.safe_dump(raw))
    hostile = load_decomposition(tmp_path / "nasty.yaml")
    page = graph_page(hostile, data)
    assert page.count("<script") == page.count("</script") == 2
    assert "<img" not in page
    assert document(page)["nodes"][0]["asks"] == NASTY
    root = ET.fromstring(graph_svg(hostile, data))
    allowed = {"svg", "title", "style", "defs", "pattern", "path", "rect", "text", "g"}
    assert {element.tag.removeprefix(SVG) for element in root.iter()} <= allowed


def test_page_fetches_nothing(small: Decomposition) -> None:
    """The policy forbids it and allows only the page's script, by its digest."""
    page = graph_page(small)
    script = page.rsplit("<script>", 1)[1].split("</script>", 1)[0]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert "default-src &#39;none&#39;; script-src &#39;sha256-" in page
    assert digest.replace("+", "&#43;") in page or digest in page
    assert not re.search(r"""\b(src|href|action)\s*=\s*["']?\s*[a-z]+:""", page)
    assert ".innerHTML" not in script


def test_unknown_agent_is_refused(small: Decomposition, data: ReportData) -> None:
    with pytest.raises(SetupError, match=f"agents: {', '.join(AGENTS)}"):
        graph_svg(small, data, "nobody")


@needs_chromium
def test_browser_runs_the_script(full: Decomposition, tmp_path: Path) -> None:
    """Under the policy: the node of the address is unfolded, selected and described, others are hidden."""
    shared = [name for name, parents in full.parents.items() if len(parents) > 1]
    leaf = next(name for name in shared if name in full.observables)
    dom = dom_of(graph_page(full), tmp_path, f"#{leaf}")
    items = re.findall(r'<div class="node[^>]*>', dom)
    assert len(items) == len(full.nodes)
    (chosen,) = (item for item in items if 'aria-selected="true"' in item)
    assert f'id="node-{leaf}"' in chosen
    assert 0 < sum("hidden" in item for item in items) < len(items)
    details = dom.split('id="details"', 1)[1].split("</aside>", 1)[0]
    assert (full.observables[leaf].measure or "no measure") in details
    assert 'class="also"' in dom
