"""The rules for the design of the next campaign: its method, its replicates, and its seed."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.documents import validate_document
from bench.errors import SetupError
from bench.realization import Design, DesignFactor, FullFactorial, Method, Sobol
from bench.reporting import ReportData

WIDE_INTERVAL = 0.2
"""Width of a 95 % interval of confidence above which more runs are proposed. Chosen, not measured."""

MAX_REPLICATES_GROWTH = 4
"""Replicates are multiplied by at most this number at once. Chosen, not measured."""

SCREENING_METHODS = ("one_by_one", "fractional_factorial", "plackett_burman", "definitive_screening")

MAX_FACTORIAL_POINTS = 64
"""After a screening a full factorial is proposed up to this number of points. Chosen, not measured."""

SOBOL_POINTS = 32
"""Points of a Sobol design after a screening. A power of two, at which a Sobol sequence is balanced."""


def propose_design(
    old: Design, factors: Sequence[DesignFactor], data: ReportData
) -> tuple[Design, dict[str, str]]:
    """The design over these factors, and reasons by field."""
    reasons = {"seed": "a new one, so that choices made from the results are not judged by the same results"}
    method, reason = _next_method(old, factors)
    if reason:
        reasons["method"] = reason
    replicates, take = old.replicates, method.take if isinstance(method, FullFactorial) else None
    runs, reason = _runs_needed(data)
    points = _point_count(old, factors, method) or len({run.design_point for run in data.runs})
    needed = min(math.ceil(runs / points), MAX_REPLICATES_GROWTH * old.replicates)
    if needed > replicates:
        reasons["replicates"] = f"replicates from {replicates} to {needed}: {reason}"
        replicates = needed
    if take is not None:
        pairs = points * replicates
        new_take = min(pairs, max(take, runs))
        if new_take != take:
            reasons["take"] = (
                f"take from {take} to {new_take}: {reason if new_take > take else 'there are no more pairs'}"
            )
            method = method.model_copy(update={"take": new_take})
    return _design(old, factors, method, replicates=replicates, seed=(old.seed + 1) % 2**63), reasons


def _point_count(old: Design, factors: Sequence[DesignFactor], method: Method) -> int:
    """Design points of a method over these factors. 0 for a stratified one, whose points depend on difficulty."""
    if isinstance(method, Sobol):
        return method.points
    return 0 if method.kind == "stratified" else len(_design(old, factors, method).points())


def _next_method(old: Design, factors: Sequence[DesignFactor]) -> tuple[Method, str]:
    """The old method if it suits these factors, otherwise one that does, with the reason for the change."""
    method = old.method
    if method.kind in SCREENING_METHODS:
        size = _factorial_size(factors)
        if size is not None and size <= MAX_FACTORIAL_POINTS:
            return (
                FullFactorial(),
                f"method from {method.kind} to full_factorial: screening is done, and there are only {size} combinations",
            )
        return (
            Sobol(points=SOBOL_POINTS),
            f"method from {method.kind} to sobol: screening is done, and more points can be added to it",
        )
    if isinstance(method, FullFactorial) and method.take is not None:
        # `take` may exceed the pairs that are left; it is proposed anew together with the replicates.
        method = method.model_copy(update={"take": None})
    try:
        _design(old, factors, method)
    except SetupError as error:
        return Sobol(points=SOBOL_POINTS), f"method from {method.kind} to sobol: {error.faults[0].what}"
    return old.method, ""


def _factorial_size(factors: Sequence[DesignFactor]) -> int | None:
    """Points of the full factorial. None if a range has no steps."""
    free = [factor for factor in factors if factor.formula is None]
    if any(factor.range is not None and factor.range.steps is None for factor in free):
        return None
    return math.prod(len(factor.counted()) for factor in free)


def _design(old: Design, factors: Sequence[DesignFactor], method: Method, **others: int) -> Design:
    document = {
        "factors": list(factors),
        "forbid": old.forbid,
        "method": method,
        "replicates": 1,
        "seed": old.seed,
        **others,
    }
    return validate_document(document, Design)


def _runs_needed(data: ReportData) -> tuple[int, str]:
    """Runs of an agent that narrow the widest interval of confidence to WIDE_INTERVAL, and why. 0 if it is narrower."""
    widths = [
        (tally.confidence_high - tally.confidence_low, tally)
        for agent in data.agents
        for node in data.study
        if (tally := data.tally(agent, node)) is not None
        and tally.confidence_low is not None
        and tally.confidence_high is not None
    ]
    if not widths:
        return 0, ""
    width, widest = max(widths, key=lambda pair: pair[0])
    if width <= WIDE_INTERVAL or not widest.considered:
        return 0, ""
    # The width of an interval falls with the root of the number of runs.
    runs = math.ceil(widest.runs * (width / WIDE_INTERVAL) ** 2)
    reason = (
        f"the 95 % interval of confidence in {widest.node} of {widest.agent} is {100 * width:.0f} points wide over "
        f"{widest.considered} runs; about {runs} runs would make it {100 * WIDE_INTERVAL:.0f}"
    )
    return runs, reason
