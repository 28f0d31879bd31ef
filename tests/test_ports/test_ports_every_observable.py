"""Every observable of the application, measured in made recordings: achieved, failed, left out."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import cases
import pytest
from cases import CasesOf, Run, recorded

from bench.campaign import measure_all
from bench.contracts import Observation, plugins
from decompositions import Decomposition, Level, load_decomposition

FULL: Decomposition = load_decomposition("search-and-report-full")


def _every_case() -> dict[str, CasesOf]:
    modules = [
        vars(importlib.import_module(f"cases.{info.name}")) for info in pkgutil.iter_modules(cases.__path__)
    ]
    return {name: module[name] for module in modules for name in plugins("rebar.measures") if name in module}


CASES = _every_case()


def measured(observable: str, run: Run, path: Path) -> Observation:
    node = FULL.observables[observable]
    assert node.measure
    return measure_all({observable: (node.measure, node.options)}, recorded(run, path), run.simspec)[0]


@pytest.mark.parametrize("observable", FULL.observables)
def test_every_observable_can_be_achieved_failed_and_not_considered(observable: str, tmp_path: Path) -> None:
    """Through a recording: at or above its threshold where it was done right, below it where it was not, and
    left out where the situation offers nothing, unless it always applies.
    """
    node = FULL.observables[observable]
    assert node.measure
    cases_of_node = CASES[node.measure](node.options)

    achieved = measured(observable, cases_of_node.achieved, tmp_path / "achieved.mcap")
    assert achieved.considered
    assert achieved.x is not None
    assert achieved.x >= max(node.threshold, 0.95)

    failed = measured(observable, cases_of_node.failed, tmp_path / "failed.mcap")
    assert failed.considered
    assert failed.x is not None
    assert failed.x < node.threshold
    assert failed.x <= 0.2
    assert failed.evidence, "a failure says where to look"
    assert not [moment for moment in failed.evidence if "None" in moment.text.split()], "no word of Python"

    assert (cases_of_node.not_considered is None) == node.always_considered
    if cases_of_node.not_considered is not None:
        left_out = measured(observable, cases_of_node.not_considered, tmp_path / "left_out.mcap")
        assert not left_out.considered
        assert left_out.x is None
        assert left_out.evidence, "what is not considered says why"


def test_the_decomposition_is_as_large_as_the_paper_says() -> None:
    """5 principles, 43 key attributes, 121 VABs, 135 observables that stand 158 times under VABs
    (docs/rulings.md 22).
    """
    document = FULL.document
    assert [len(FULL.at_level(level)) for level in Level] == [5, 43, 121, 135]
    assert sum(len(vab.children) for vab in document.vabs) == 158
    titles = {
        "KA-03": "civilian",
        "KA-05": "enemy",
        "KA-09": "Object detection",
        "KA-18": "marking",
        "KA-20": "accomplishment",
    }
    assert all(words in FULL.nodes[node].title for node, words in titles.items())
    assert set(document.study) == set(titles)


def test_no_two_nodes_ask_the_same() -> None:
    """No node repeats what another asks, no two observables measure the same alike, no two VABs have the same children."""
    vabs = [frozenset(vab.children) for vab in FULL.document.vabs]
    assert len(set(vabs)) == len(vabs)
    sentences = [node.asks for node in FULL.nodes.values()]
    assert len(set(sentences)) == len(sentences)
    measures = [
        (observable.measure, tuple(sorted(observable.options.items())), observable.threshold)
        for observable in FULL.observables.values()
    ]
    assert len(set(measures)) == len(measures)


OFFERED = {"area_kept", "attitude_stable"}
"""Measures for decompositions of one's own: every vehicle with a geofence and an autopilot passes them here."""


def test_every_measure_is_used_by_some_observable() -> None:
    """Every measure of the bench is asked for by some observable here, or offered."""
    ours = {
        name for name, entry in plugins("rebar.measures").items() if entry.value.startswith("test_ports.")
    }
    used = {observable.measure for observable in FULL.observables.values()}
    assert ours == used | OFFERED
    assert not used & OFFERED
