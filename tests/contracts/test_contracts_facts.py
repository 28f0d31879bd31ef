"""Facts of a session: documents in `result.json` that a class each describes."""

from __future__ import annotations

import json
import re

import pytest

from bench.contracts import (
    AgentExit,
    Arithmetic,
    Confinement,
    Fact,
    FirmwareEnds,
    Outcome,
    ServicesLetIn,
    ServiceUse,
    SessionResult,
    StepTiming,
    SuspectEnds,
    TruthGiven,
    TruthSightings,
    facts_of,
)

BOXED = Confinement(isolation="landlock", network="own", open_walls=("udp",))
SERVED = ServicesLetIn(
    uses=(ServiceUse(name="a", host="a.org", port=1), ServiceUse(name="b", host="b.org", port=2))
)
TIMING = StepTiming(
    steps=9, late=1, late_after_s=0.02, delay_p50_s=0.0, delay_p95_s=0.0, delay_p99_s=0.1, delay_max_s=0.1
)


def result_with(*facts: Fact) -> SessionResult:
    return SessionResult(realization="a", outcome=Outcome.COMPLETED, facts=facts_of(*facts))


def read_back(result: SessionResult, **changes: object) -> SessionResult:
    document = json.loads(result.model_dump_json()) | changes
    return SessionResult.model_validate_json(json.dumps(document))


def test_a_fact_is_read_back_as_the_class_that_wrote_it() -> None:
    """Several in one result; the ones that no part told are None."""
    result = result_with(BOXED, SERVED).with_facts(TIMING)
    assert read_back(result) == result
    assert [result.fact(kind) for kind in (Confinement, ServicesLetIn, StepTiming, AgentExit)] == [
        BOXED,
        SERVED,
        TIMING,
        None,
    ]


def test_a_new_fact_is_one_class() -> None:
    """Written, read back and in the schema, without a line elsewhere."""

    class Moonlight(Fact):
        key = "moonlight"
        phase: float

    result = result_with(Moonlight(phase=0.25), BOXED)
    assert json.loads(result.model_dump_json())["facts"]["moonlight"] == {"phase": 0.25}
    assert read_back(result).fact(Moonlight) == Moonlight(phase=0.25)
    assert "moonlight" in SessionResult.model_json_schema()["properties"]["facts"]["properties"]


def test_the_latest_of_a_kind_counts() -> None:
    """As where the runner marks a result that was marked before."""
    twice = result_with(SuspectEnds(texts=("a",)), BOXED).with_facts(SuspectEnds(texts=("a", "b")))
    assert twice.fact(SuspectEnds) == SuspectEnds(texts=("a", "b"))
    assert twice.fact(Confinement) == BOXED


@pytest.mark.parametrize("edited", [{"steps": "many"}, None, 7, {"steps": 1, "unknown": 2}])
def test_a_fact_that_was_edited_reads_as_absent(edited: object) -> None:
    """The result is whole without it, and the others stay; so is one that a later version told."""
    facts = {"timing": edited, "confinement": BOXED.model_dump(), "of_a_later_version": {"x": 1}}
    result = read_back(result_with(), facts=facts)
    assert result.facts == facts_of(BOXED)


def test_results_of_earlier_versions_keep_what_warns_of_them() -> None:
    """Facts stood there as `details`: those of one value still read, and confinement is not recorded."""
    document = json.loads(result_with().model_dump_json())
    del document["facts"]
    document["details"] = {
        "truth": "given to oracle",
        "saw_the_truth": ["a report", "another"],
        "suspect": ["worker_lost: killed"],
        "firmware_ended": ["after 1.0 s"],
        "services": [use.model_dump() for use in SERVED.uses],
        "agent_exit_code": -9,
        "timing": TIMING.model_dump(),
        "arithmetic": {"processor": "x", "libm": "y", "blas": "z"},
        "isolation": "landlock",
        "network": "own",
        "leaves_open": ["udp"],
    }
    result = SessionResult.model_validate_json(json.dumps(document))
    assert result.facts == facts_of(
        TruthGiven(agent="given to oracle"),
        TruthSightings(texts=("a report", "another")),
        SuspectEnds(texts=("worker_lost: killed",)),
        FirmwareEnds(texts=("after 1.0 s",)),
        SERVED,
        AgentExit(code=-9),
        TIMING,
        Arithmetic(processor="x", libm="y", blas="z"),
    )


def test_words_of_others_are_shown_whole() -> None:
    """What agents, firmware and files wrote into a fact cannot clear a terminal."""
    fact = read_back(result_with(SuspectEnds(texts=("\x1b[2J",)))).fact(SuspectEnds)
    assert fact == SuspectEnds(texts=("\\x1b[2J",))


def test_the_schema_describes_what_is_written() -> None:
    """Every kind by its key, with the documents inside them, and no reference to what is not there."""
    schema = SessionResult.model_json_schema()
    facts = schema["properties"]["facts"]["properties"]
    for fact in (BOXED, SERVED, TIMING):
        described = facts[fact.key]
        described = (
            schema["$defs"][described["$ref"].rpartition("/")[2]] if "$ref" in described else described
        )
        assert described["properties"].keys() == fact.model_dump().keys()
    references = set(re.findall(r'"#/\$defs/(\w+)"', json.dumps(schema)))
    assert "ServiceUse" in references <= schema["$defs"].keys()
