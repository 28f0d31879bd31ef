"""What the reports of a run state of their confidence and their error, and how far each was off."""

from __future__ import annotations

import math

from bench.contracts import ReportStatement, ReportStatements, Tape
from bench.simspec import TARGET_ROLES, SimSpec

MAX_REPORTS = 1000
"""Reports of a run that are kept: who floods the bench has stated enough by then, and results stay small."""


def report_statements(simspec: SimSpec, tape: Tape) -> list[ReportStatements]:
    """The fact of a session whose agent reported something; empty when it did not, or nobody's truth was recorded."""
    if not tape.reports or not len(tape.actor_time_s):
        return []
    statements = []
    for report in tape.reports[:MAX_REPORTS]:
        stated, places = report.value, tape.actors_at(report.time.s)
        errors_m = [
            math.hypot(place[0] - stated.east_m, place[1] - stated.north_m)
            for place, member in zip(places, tape.cast, strict=True)
            if member.role in TARGET_ROLES and member.class_label == stated.class_label
        ]
        error_m = round(min(errors_m), 3) if errors_m else None
        statements.append(
            ReportStatement(confidence=stated.confidence, error_m=error_m, sigma_m=stated.position_sigma_m)
        )
    return [ReportStatements(reports=tuple(statements))]
