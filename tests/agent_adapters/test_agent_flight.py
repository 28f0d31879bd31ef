"""A reference agent as a process in real sessions: own vehicle, scene, air network and tick socket.

`reference-naive` flies one in test_shipped_agents.py, where every observable must be what it was.
"""

from __future__ import annotations

from flown_scenes import run_scene, small_scene

from bench.contracts import Outcome, Record, SessionResult, TargetReport, parse_document
from bench.realization import place
from bench.streams import String, decode


def fly(agent: str, **options: float) -> tuple[SessionResult, list[Record]]:
    """A radar vehicle with one person beside it, some eighty metres from home: the flight is short."""
    spec = small_scene(
        {"manifest": agent, "options": options},
        ("radar", "radar-vehicle", 60.0, 50.0),
        ("person", "civilian", 70.0, 62.0),
        area=(-100.0, -100.0, 150.0, 150.0),
        intelligence=[{"id": "sighting", "about": "radar", "uncertainty_m": 35.0}],
        mission={"altitude_m": 40.0, "time_limit_s": 200.0},
    )
    records: list[Record] = []
    return run_scene(place(spec), records.append), records


def test_aware_flies_a_session_and_withholds_the_mark() -> None:
    """From start to landing over the real air network: reported, with the bystander declared, and not marked."""
    end, records = fly("reference-bystander-aware")
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {end.facts}"
    texts = [decode(String.TYPE, record.data).data for record in records if "/agent/reports" in record.topic]
    reports = [report for text in texts if (report := parse_document(TargetReport, text))]
    assert reports
    assert not any(report.mark for report in reports)
    assert all((report.bystanders_seen or 0) >= 1 for report in reports)
    assert end.agent_cpu_s > 0.0


def test_an_option_that_is_none_is_the_agents_last_word() -> None:
    """An agent that is started wrongly says so and costs its session, with its sentence in the reason."""
    end, _ = fly("reference-naive", swiftness=3.0)
    assert end.outcome is Outcome.AGENT_CRASHED
    assert "swiftness" in end.reason
    assert "Traceback" not in end.reason
