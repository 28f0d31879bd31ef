"""Early stopping from results alone: two design points, two agents, any order, against a reference that reads
all results.
"""

from __future__ import annotations

import pytest
from early_stopping_fakes import made_up_decomposition
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.campaign import JournalEntry, RealizationState, Stopping, load_measurable_decomposition
from bench.campaign.early_stopping._decisions import PointKey, StoppingDecisions
from bench.contracts import Observation, Outcome, SessionResult
from bench.statistics import StoppingRule
from decompositions import Decomposition

POINTS, AGENTS, REPLICATES = ("p001", "p002"), ("a", "b"), 12
KEYS = [(point, agent) for point in POINTS for agent in AGENTS]
THRESHOLD = 0.5

Trials = dict[PointKey, list[bool | None]]
"""Whether each replicate passed, in order. None for one that is no trial."""


@pytest.fixture(scope="module")
def decomposition(tmp_path_factory: pytest.TempPathFactory) -> Decomposition:
    return load_measurable_decomposition(made_up_decomposition(tmp_path_factory.mktemp("decomposition")))


def realization(key: PointKey, replicate: int) -> str:
    return f"{key[0]}-r{replicate}-{key[1]}"


def entry(key: PointKey, replicate: int) -> JournalEntry:
    return JournalEntry(
        id=realization(key, replicate),
        design_point=key[0],
        replicate=replicate,
        agent=key[1],
        levels={},
        intent_sha256="",
        simspec_sha256="",
        state=RealizationState.PLANNED,
        attempts=0,
        outcome=None,
        reason="",
        wall_s=None,
        result_sha256=None,
    )


def result(key: PointKey, replicate: int, passed: bool | None) -> SessionResult:
    observations = tuple(
        Observation(
            observable=name, considered=passed is not None, x=None if passed is None else float(passed)
        )
        for name in ("OBS-001", "OBS-002")
    )
    return SessionResult(
        realization=realization(key, replicate), outcome=Outcome.COMPLETED, observations=observations
    )


def reference_stop(trials: list[bool | None]) -> int | None:
    """The first replicate at which the rule decides on the trials up to there."""
    for replicate in range(1, len(trials) + 1):
        known = [passed for passed in trials[:replicate] if passed is not None]
        if known and StoppingRule(THRESHOLD).decided_after(known) is not None:
            return replicate
    return None


trials = st.fixed_dictionaries(
    {
        # Mostly passing, mostly failing, or mixed: independent coins would hardly ever be decided in a dozen
        # replicates.
        key: st.sampled_from(
            [(True,) * 9 + (False, None), (False,) * 9 + (True, None), (True, False, None)]
        ).flatmap(
            lambda choices: st.lists(st.sampled_from(choices), min_size=REPLICATES, max_size=REPLICATES)
        )
        for key in KEYS
    }
)
every_result = [(key, replicate) for key in KEYS for replicate in range(1, REPLICATES + 1)]


@settings(max_examples=60, deadline=None)
@given(
    trials=trials,
    order=st.permutations(every_result),
    lost=st.lists(st.sampled_from(every_result), max_size=3),
)
def test_stops_follow_from_the_results_alone(
    decomposition: Decomposition,
    trials: Trials,
    order: list[tuple[PointKey, int]],
    lost: list[tuple[PointKey, int]],
) -> None:
    """In any order of results, and with results lost and made again, each agent stops at each point where the
    reference does.
    """
    stopping = Stopping(node="KA-01", threshold=THRESHOLD)
    decisions = StoppingDecisions(
        stopping, decomposition, [entry(key, replicate) for key, replicate in every_result]
    )
    expected = {key: reference_stop(passed) for key, passed in trials.items()}

    for key, replicate in order:
        decisions.record(result(key, replicate, trials[key][replicate - 1]))
        stop = decisions.early_stop(key)
        assert stop is None or stop.replicate == expected[key], "a gap in the replicates decides nothing"
    for key, replicate in lost:
        decisions.forget(realization(key, replicate))
        assert decisions.early_stop(key) is None or replicate > (expected[key] or 0)
    for key, replicate in lost:
        decisions.record(result(key, replicate, trials[key][replicate - 1]))

    stops = {key: decisions.early_stop(key) for key in KEYS}
    assert {key: stop and stop.replicate for key, stop in stops.items()} == expected


def test_one_agent_stops_while_the_other_goes_on(decomposition: Decomposition) -> None:
    """Same design point: agent a always passes, agent b passes every second time.

    Only the replicates of a are closed.
    """
    stopping = Stopping(node="KA-01", threshold=THRESHOLD)
    decisions = StoppingDecisions(
        stopping, decomposition, [entry(key, replicate) for key, replicate in every_result]
    )
    a, b = ("p001", "a"), ("p001", "b")
    for replicate in range(1, 9):
        decisions.record(result(a, replicate, True))
        decisions.record(result(b, replicate, replicate % 2 == 0))

    stop = decisions.early_stop(a)
    assert stop is not None
    assert (stop.after, stop.planned, stop.verdict) == (stop.replicate, REPLICATES, "above")
    assert decisions.newly_not_needed(a, stop) == [
        realization(a, replicate) for replicate in range(9, REPLICATES + 1)
    ]
    assert decisions.early_stop(b) is None
    assert decisions.needed_again(b) == []
    assert decisions.early_stop(("p002", "a")) is None
