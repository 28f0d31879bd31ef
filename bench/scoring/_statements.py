"""What an agent states of its confidence and its errors, judged over all runs of a campaign (docs/rulings.md 30)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from bench.contracts import ReportStatements
from bench.documents import Document
from bench.statistics import Skill, confidence_skill, error_skill

RIGHT_WITHIN_M = 20.0
"""A report is right that has a target of its class so near: as near as `targets_reported` asks for."""

ABOUT_WITHIN_M = 40.0
"""A report is about the nearest target of its class within this; the stated error of one about nobody is about nothing."""


class StatementReport(Document):
    """One kind of statement of one agent over its runs, against the best constant."""

    agent: str
    of: Literal["confidence", "position_sigma_m"]
    measured_by: Annotated[
        Literal["Brier score", "interval score"],
        Field(description="Lower is better; the interval score in metres."),
    ]
    statements: Annotated[int, Field(ge=0)]
    scenes: Annotated[
        int, Field(ge=0, description="Scenes that they were made in: the interval draws these.")
    ]
    score: Annotated[float, Field(description="Mean over the statements.")]
    best_constant: Annotated[
        float, Field(description="The number that, stated always, would have scored best.")
    ]
    constant_score: Annotated[float, Field(description="The mean score of that number.")]
    skill: Annotated[
        float | None,
        Field(
            description="1 - score / constant_score. Null: the best constant is perfect, nothing can be better."
        ),
    ]
    skill_low: Annotated[
        float | None,
        Field(description="Lower end of the 95 % interval over scenes. Null with fewer than five."),
    ]
    skill_high: Annotated[float | None, Field(description="Upper end of that interval.")]


def statement_reports(
    runs: Iterable[tuple[str, tuple[str, int], ReportStatements | None]],
) -> tuple[StatementReport, ...]:
    """A row for each agent and kind of statement, from agent, scene and statements of each run, agents in that order."""
    rows: dict[str, list[tuple[str, float, float | None, float | None]]] = {}
    for agent, scene, statements in runs:
        of_agent = rows.setdefault(agent, [])
        for report in statements.reports if statements is not None else ():
            of_agent.append((f"{scene}", report.confidence, report.error_m, report.sigma_m))
    reports = []
    for agent, stated in rows.items():
        scenes = [scene for scene, *_ in stated]
        right = np.array(
            [error_m is not None and error_m <= RIGHT_WITHIN_M for *_, error_m, _ in stated], float
        )
        confidence = confidence_skill(np.array([row[1] for row in stated], float), right, scenes)
        placed = [
            (scene, sigma_m, error_m)
            for scene, _, error_m, sigma_m in stated
            if sigma_m is not None and error_m is not None and error_m <= ABOUT_WITHIN_M
        ]
        error = error_skill(
            np.array([sigma_m for _, sigma_m, _ in placed], float),
            np.array([error_m for *_, error_m in placed], float),
            [scene for scene, *_ in placed],
        )
        if confidence is not None:
            reports.append(_row(agent, "confidence", "Brier score", confidence))
        if error is not None:
            reports.append(_row(agent, "position_sigma_m", "interval score", error))
    return tuple(reports)


def _row(
    agent: str,
    of: Literal["confidence", "position_sigma_m"],
    measured_by: Literal["Brier score", "interval score"],
    skill: Skill,
) -> StatementReport:
    return StatementReport(
        agent=agent,
        of=of,
        measured_by=measured_by,
        statements=skill.statements,
        scenes=skill.scenes,
        score=skill.score,
        best_constant=skill.best_constant,
        constant_score=skill.constant_score,
        skill=skill.skill,
        skill_low=skill.low,
        skill_high=skill.high,
    )
