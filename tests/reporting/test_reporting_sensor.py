"""The configured sensor has a section of its own, and its numbers stand nowhere among those of an agent."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest
from made_campaign import AGENTS, OBSERVABLES, Made, make_campaign
from test_reporting_page import Page, page_of

from bench.reporting import load_report_data
from bench.reporting.statistics._sensor import detector_sentences, only_about_sensor
from bench.scoring import Standing
from bench.simspec import DetectionModel, Perception

ABOUT_SENSOR = (OBSERVABLES["KA-05"][0], OBSERVABLES["KA-18"][1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign in which two observables measure the detector, one of them in the last scene the agent."""
    folder = make_campaign(tmp_path_factory.mktemp("sensor") / "c", Made(scenes=5))
    path = folder / "scores.parquet"
    mixed = (pl.col("node") == ABOUT_SENSOR[1]) & (pl.col("design_point") == "p004")
    about_sensor = pl.col("node").is_in(ABOUT_SENSOR) & ~mixed
    sensor = pl.when(about_sensor).then(pl.lit(str(Standing.CONFIGURED_SENSOR)))
    scores = pl.read_parquet(path)
    scores.with_columns(standing=sensor.otherwise(pl.col("standing"))).write_parquet(path)
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return page_of(folder)[0]


def test_section_shows_what_the_score_table_holds(folder: Path, page: Page) -> None:
    """Mean, range and count of every agent, over the runs in which the observable is about the detector."""
    scores = pl.read_parquet(folder / "scores.parquet").filter(pl.col("standing") == "configured sensor")
    rows = [row for row in page.tables["sensor-table"] if len(row) == 6][1:]
    expected = []
    for node in ABOUT_SENSOR:
        for letter, agent in zip("AB", AGENTS, strict=True):
            runs = scores.filter(node=node, agent=agent)
            x = [value for value in runs["x"].to_list() if value is not None]
            reached = sum(value >= 0.8 for value in x)
            shares = [f"{100 * share:.1f} %" for share in (sum(x) / len(x), min(x), max(x))]
            counts = [str(reached), f"{len(x)} of {runs.height}"]
            expected.append([f"{letter} {agent}", shares[0], " to ".join(shares[1:]), "80.0 %", *counts])
    assert [[" ".join(cell.split()) for cell in row] for row in rows] == expected
    assert {row[-1] for row in expected} == {"5 of 5", "4 of 4"}


def test_tree_of_an_agent_leaves_the_sensor_out(page: Page) -> None:
    """The row remains and refers to the section; an observable that also measures the agent keeps its numbers."""
    of_sensor = [row for row in page.tables[""] if row and row[0].startswith(ABOUT_SENSOR[0])]
    assert len(of_sensor) == len(AGENTS)
    assert all(row[1:] == ["measures the configured sensor, not the agent"] for row in of_sensor)
    mixed = [row for row in page.tables[""] if row and row[0].startswith(ABOUT_SENSOR[1])]
    assert [len(row) for row in mixed] == [11] * len(AGENTS)
    assert {("a", "href", "#sensor")} <= set(page.attributes)
    assert "sensor" in page.ids


def test_campaign_without_such_observables_says_so(tmp_path: Path) -> None:
    page, _ = page_of(make_campaign(tmp_path / "c", Made(scenes=1)))
    assert "No observable of this decomposition measures the detector of the bench." in page.text
    assert "sensor-table" not in page.tables


def test_subject_in_the_document_makes_the_section(tmp_path: Path) -> None:
    folder = make_campaign(tmp_path / "c", Made(scenes=1, about_sensor=ABOUT_SENSOR))
    document = json.loads((folder / "decomposition.json").read_text())
    subjects = {row["id"]: row.get("subject") for row in document["observables"]}
    assert [name for name, subject in subjects.items() if subject == "perception"] == list(ABOUT_SENSOR)
    scores = load_report_data(folder).scores
    assert only_about_sensor(scores) == {(agent, name) for agent in AGENTS for name in ABOUT_SENSOR}


def test_detectors_are_described_once_each() -> None:
    degraded = Perception(model=DetectionModel(half_height_px=20.0, false_per_frame=0.5))
    sentences = detector_sentences([degraded, Perception(mode="perfect"), degraded])
    assert len(sentences) == 2
    assert "20 pixels high" in sentences[0]
    assert "0.5 false detections a frame" in sentences[0]
    assert sentences[1].startswith("Without errors")
