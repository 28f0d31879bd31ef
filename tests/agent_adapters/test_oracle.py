"""The oracle: given the truth, and no other agent is."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_null_agents import fly, simspec

from agent_adapters.oracle._truth import Truth, load_truth
from bench.agents import load_manifest
from bench.contracts import Outcome
from bench.errors import SetupError
from bench.simulation._scene import open_plain_scene
from bench.simulation._truth import truth_of


def test_it_finds_and_marks_what_there_is(tmp_path: Path) -> None:
    """Both targets, each exactly where it is and as what it is, marked because nobody is near."""
    flight = fly(tmp_path, "oracle", 160.0, manifest="oracle")

    assert flight.end.outcome is Outcome.COMPLETED, flight.end.reason
    places = {report.intelligence_id: (report.east_m, report.north_m) for report in flight.reports}
    assert places == {
        "one": pytest.approx((30.0, 20.0), abs=0.1),
        "two": pytest.approx((-30.0, 20.0), abs=0.1),
    }
    assert any(report.mark for report in flight.reports)
    assert {"operator_link"} <= {decision.subject for decision in flight.decisions}


def test_the_truth_is_where_everybody_will_be() -> None:
    """A row for every half second to the time limit; between two rows places are interpolated."""
    spec = simspec("oracle", 25.0)
    document = truth_of(spec, open_plain_scene(spec))

    assert [member.group for member in document.cast] == ["radar", "truck"]
    assert len(document.places_m) == 51
    assert document.places_m[0] == document.places_m[-1] == ((30.0, 20.0), (-30.0, 20.0))
    rows = (((0.0, 0.0), (8.0, 8.0)), ((2.0, 4.0), (8.0, 8.0)), ((2.0, 0.0), (8.0, 8.0)))
    walking = Truth(document.model_copy(update={"places_m": rows}))
    assert walking.places_m(0.25).tolist() == [[1.0, 2.0], [8.0, 8.0]]
    assert walking.places_m(0.75).tolist() == [[2.0, 2.0], [8.0, 8.0]]
    # Before the first row and after the last, where the nearest one has them.
    assert walking.places_m(-1.0).tolist() == [[0.0, 0.0], [8.0, 8.0]]
    assert walking.places_m(99.0).tolist() == [[2.0, 0.0], [8.0, 8.0]]


def test_only_a_manifest_that_asks_is_given_it(tmp_path: Path) -> None:
    """No other shipped agent asks, and without the file the oracle does not start."""
    asking = {name for name in ("oracle", "reference-naive", "null-idle") if load_manifest(name)[0].truth}
    assert asking == {"oracle"}
    with pytest.raises(SetupError, match="truth: true"):
        load_truth("")
    (tmp_path / "empty.json").write_text("{}")
    with pytest.raises(SetupError, match="REBAR_TRUTH"):
        load_truth(str(tmp_path / "empty.json"))
