"""Measures of detections judge the perception of the bench; those of tracks judge the agent's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from cases import scene
from cases.perception import actors_of, looked_at, own_labels

from bench.contracts import Measure, load_plugin
from bench.simspec import Outage, PerceptionSource, SimSpec, factor_values

OF_DETECTIONS: Mapping[str, Mapping[str, Any]] = {
    "detection_share": {"role": "bystander"},
    "detection_precision": {"role": "any"},
    "detection_role_right": {"role": "bystander", "as_role": "adversary"},
    "steady_detection": {"role": "any"},
    "detection_fairness": {"by": "asset"},
}


def with_source(spec: SimSpec, source: PerceptionSource) -> SimSpec:
    return spec.model_copy(update={"perception": spec.perception.model_copy(update={"source": source})})


@pytest.mark.parametrize("name", OF_DETECTIONS)
def test_without_detections_of_the_bench_none_of_these_measures_considers_a_run(name: str) -> None:
    """The same tape is considered with every source of the bench, and not with that of the agent."""
    spec = scene()
    measure: Measure = load_plugin("rebar.measures", name)
    actors = actors_of(spec)
    tape = looked_at(spec, actors, {}, own_labels(spec, actors)).tape
    answers = {
        source: measure("O-1", tape, with_source(spec, source), OF_DETECTIONS[name])
        for source in ("truth", "simulated", "agent")
    }
    assert answers["truth"].considered
    assert answers["truth"] == answers["simulated"]
    assert not answers["agent"].considered
    assert answers["agent"].evidence[0].text.startswith("perception.source is agent")


def test_outages_of_the_detector_do_not_exist_for_an_agent_with_its_own_perception() -> None:
    """Neither as key factors nor as faults that a run has to answer for; others stay."""
    outages = (
        Outage(kind="detections", at_s=10.0, duration_s=5.0),
        Outage(kind="operator_link", at_s=20.0, duration_s=7.0),
    )
    spec = scene().model_copy(update={"outages": outages})
    ours, own = factor_values(spec), factor_values(with_source(spec, "agent"))
    assert (ours["detections_outage_s"], own["detections_outage_s"]) == (5.0, 0.0)
    assert ours["operator_link_outage_s"] == own["operator_link_outage_s"] == 7.0
    assert ours["kept_detections_share"] == 0.0
    assert "kept_detections_share" not in own
