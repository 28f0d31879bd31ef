"""What agents state of their certainty, judged over all runs: who always states the same has no skill in any campaign."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_campaign import AGENTS, Made, make_campaign
from made_run import report, simspec, tape
from test_reporting_page import page_of

from bench.campaign.planning._statements import report_statements
from bench.contracts import ReportStatement, ReportStatements
from bench.scoring import statement_reports

RADAR_AT, TRUCK_AT = ("mobile_radar", 100.0, 100.0), ("military_vehicle", -100.0, 100.0)
ALWAYS, KNOWING = AGENTS
SCENES = 20


def told(agent: str, number: int) -> ReportStatements:
    """Reports of one scene, half of them right: one agent states 0.9 and 5 m always, the other what it knows."""
    draw = np.random.default_rng(number)
    reports = []
    for turn in range(4):
        sigma_m, right = float(draw.uniform(0.5, 8.0)), turn % 2 == 0
        error_m = min(sigma_m * float(draw.rayleigh()), 19.0) if right else float(draw.uniform(21.0, 200.0))
        stated = (0.9, 5.0) if agent == ALWAYS else (0.9 if right else 0.2, sigma_m if right else 30.0)
        reports.append(ReportStatement(confidence=stated[0], error_m=round(error_m, 3), sigma_m=stated[1]))
    return ReportStatements(reports=tuple(reports))


def test_a_constant_has_no_skill_and_knowledge_has() -> None:
    rows = statement_reports(
        (agent, (f"p{number:03}", 1), told(agent, number)) for agent in AGENTS for number in range(SCENES)
    )
    wanted = [(agent, of) for agent in AGENTS for of in ("confidence", "position_sigma_m")]
    assert [(row.agent, row.of) for row in rows] == wanted
    for row in rows:
        assert row.scenes == SCENES
        assert row.skill_low is not None
        assert row.skill_high is not None
        assert row.skill_high <= 0.0 if row.agent == ALWAYS else row.skill_low > 0.0
    assert statement_reports([(ALWAYS, ("p000", 1), None)]) == ()


def test_a_report_is_as_far_off_as_the_nearest_target_of_its_class() -> None:
    """Beside a target, beside one of another class, and of a class that nobody has."""
    spec = simspec()
    reports = (
        report(60.0, RADAR_AT[0], RADAR_AT[1] + 3.0, RADAR_AT[2] + 4.0, confidence=0.8, position_sigma_m=2.0),
        report(70.0, RADAR_AT[0], *TRUCK_AT[1:]),
        report(80.0, "hangar", *TRUCK_AT[1:]),
    )
    (fact,) = report_statements(spec, tape(spec, reports=reports))
    assert fact.reports == (
        ReportStatement(confidence=0.8, error_m=5.0, sigma_m=2.0),
        ReportStatement(confidence=0.9, error_m=200.0, sigma_m=None),
        ReportStatement(confidence=0.9, error_m=None, sigma_m=None),
    )
    assert report_statements(spec, tape(spec)) == []


@pytest.mark.parametrize("with_facts", [True, False])
def test_the_report_has_a_table_of_the_agents(tmp_path: Path, *, with_facts: bool) -> None:
    folder = make_campaign(tmp_path / "c", Made(scenes=6))
    for path in sorted(folder.glob("runs/**/result.json")) if with_facts else ():
        result = json.loads(path.read_text())
        agent = next(agent for agent in AGENTS if path.parent.name.endswith(agent))
        number = sum(map(ord, path.parent.name))
        result.setdefault("facts", {})["report_statements"] = told(agent, number).model_dump()
        path.write_text(json.dumps(result))
    page = page_of(folder)[0]
    rows = page.tables.get("statements-table", [])[1:]
    assert len(rows) == (4 if with_facts else 0)
    for row in rows:
        assert row[0] in AGENTS
        assert (float(row[7].replace("−", "-")) > 0.0) is (row[0] == KNOWING), row
