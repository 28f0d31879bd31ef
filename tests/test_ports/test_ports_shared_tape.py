"""What measures keep with a tape is kept for their SimSpec and their options alone."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from random_run import random_simspec, random_tape

from bench.campaign import load_measurable_decomposition, measure_all, measures_of
from bench.contracts import load_plugin
from bench.simspec import SimSpec


def variant(seed: int) -> SimSpec:
    """The situation with other rules and fewer reports and orders, for an agent that perceives by itself."""
    document = random_simspec(seed).model_dump(mode="json")
    document["rules"] |= {"no_mark_within_m": 70.0, "max_altitude_m": 33.0}
    document["mission"]["altitude_m"] = 30.0
    document["intelligence"] = document["intelligence"][:1]
    document["orders"] = [order for order in document["orders"] if order["intelligence"] is None]
    document["perception"]["source"] = "agent"
    return SimSpec.model_validate(document)


def scaled(name: str, options: Mapping[str, Any], unit: str) -> tuple[str, dict[str, Any]]:
    """A measure with half of each limit of one unit, so that nothing else tells the two apart."""
    declared = {option.name: option.default for option in load_plugin("rebar.measures", name).options}
    limits = {
        key: value / 2.0
        for key, value in {**declared, **options}.items()
        if isinstance(value, float) and key.rpartition("_")[2] == unit
    }
    return name, {**options, **limits}


@pytest.mark.parametrize("seed", [28])
def test_measures_of_one_tape_do_not_answer_each_other(seed: int) -> None:
    """Two situations and two sets of options, asked in turn, against a tape of its own for each question."""
    tape = random_tape(random_simspec(seed), seed)
    requests = measures_of(load_measurable_decomposition("search-and-report-full"))
    questions = [requests]
    for unit in ("m", "s", "iou", "confidence"):
        questions.append({observable: scaled(*request, unit) for observable, request in requests.items()})
    situations, answers = (random_simspec(seed), variant(seed)), []
    for asked in questions:
        for spec in situations:
            shared = measure_all(asked, tape, spec)
            alone = [measure_all({name: request}, replace(tape), spec) for name, request in asked.items()]
            assert shared == tuple(observation for (observation,) in alone)
            answers.append(shared)
    differing = [sum(map(operator.ne, answers[0], later)) for later in answers[1:6]]
    assert min(differing) > 10, "the questions are too much alike to tell what is kept for which"
