"""What an agent states of its confidence and its errors, judged over all runs of a campaign (docs/rulings.md 30)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import Literal

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
    measured_by: Literal["Brier score", "interval score"] = Field(
        description="Lower is better; the interval score in metres."
    )
    statements: int = Field(ge=0)
    scenes: int = Field(ge=0, description="Scenes that they were made in: the interval draws these.")
    score: float = Field(description="Mean over the statements.")
    best_constant: float = Field(description="The number that, stated always, would have scored best.")
    constant_score: float = Field(description="The mean score of that number.")
    skill: float | None = Field(
        description="1 - score / constant_score. Null: the best constant is perfect, nothing can be better."
    )
    skill_low: float | None = Field(
        description="Lower end of the 95 % interval over scenes. Null with fewer than five."
    )
    skill_high: float | None = Field(description="Upper end of that interval.")


def statement_reports(
    runs: Iterable[tuple[str, tuple[str, int], ReportStatements | None]],
) -> tuple[StatementReport, ...]:
    """A row for each agent and kind of statement, from agent, scene and statements of each run, agents in that order."""
    rows: dict[str, list[_Statement]] = {}
    for agent, scene, statements in runs:
        of_agent = rows.setdefault(agent, [])
        for report in statements.reports if statements is not None else ():
            of_agent.append((f"{scene}", report.confidence, report.error_m, report.sigma_m))
    return tuple(report for agent, stated in rows.items() for report in _reports_of(agent, stated))


_Statement = tuple[str, float, float | None, float | None]
"""Scene, confidence, true error and stated error in metres."""


def _reports_of(agent: str, stated: Sequence[_Statement]) -> Iterator[StatementReport]:
    right = [error_m is not None and error_m <= RIGHT_WITHIN_M for *_, error_m, _ in stated]
    placed = [
        (scene, sigma_m, error_m)
        for scene, _, error_m, sigma_m in stated
        if sigma_m is not None and error_m is not None and error_m <= ABOUT_WITHIN_M
    ]
    confidence = confidence_skill(
        np.array([confidence for _, confidence, *_ in stated], float),
        np.array(right, float),
        [scene for scene, *_ in stated],
    )
    error = error_skill(
        np.array([sigma_m for _, sigma_m, _ in placed], float),
        np.array([error_m for *_, error_m in placed], float),
        [scene for scene, *_ in placed],
    )
    if confidence is not None:
        yield _report(agent, "confidence", "Brier score", confidence)
    if error is not None:
        yield _report(agent, "position_sigma_m", "interval score", error)


def _report(
    agent: str,
    of: Literal["confidence", "position_sigma_m"],
    measured_by: Literal["Brier score", "interval score"],
    skill: Skill,
) -> StatementReport:
    numbers = asdict(skill)
    bounds = {f"skill_{end}": numbers.pop(end) for end in ("low", "high")}
    return StatementReport(agent=agent, of=of, measured_by=measured_by, **numbers, **bounds)
