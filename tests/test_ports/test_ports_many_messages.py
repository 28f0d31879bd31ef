"""An agent may send very many messages: the cost of every measure grows with their number, not with its square."""

from __future__ import annotations

import operator
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from random_run import LABELS, random_simspec, random_tape

from bench.campaign import load_measurable_decomposition, measure_all, measures_of
from bench.contracts import Decision, SimTime, Tape, TargetReport, Timed, load_plugin
from bench.simspec import SimSpec
from test_ports.perception import answers, track_messages
from test_ports.reports.places import PlaceGrid, has_same_place, same_place

ACTIONS = ("report", "mark", "withhold_mark", "search", "degraded", "restored")
REPORTS, DECISIONS = 60, 240


def crowded(tape: Tape, spec: SimSpec, times: int) -> Tape:
    """The tape with `times` as many messages: about actors, at one empty place and all over the area."""
    random = np.random.default_rng(times)
    names = [item.id for item in spec.intelligence]

    def moments(count: int) -> list[float]:
        return [float(time_s) for time_s in np.sort(random.uniform(1.0, tape.end_s, count))]

    reports, decisions = [], []
    for number, time_s in enumerate(moments(times * REPORTS)):
        actor = int(random.integers(len(tape.cast)))
        place = (
            tape.actors_at(time_s)[actor][:2] + random.normal(0.0, 3.0, 2),
            np.array([33.0, 44.0]),
            random.uniform(-300.0, 300.0, 2),
        )[number % 3]
        reports.append(
            TargetReport(
                id=f"r{number}",
                time_s=time_s,
                # What stands all over the area is of no adversary's class: it would be guesses round every one of them.
                class_label=(tape.cast[actor].class_label, LABELS[0], "hangar")[number % 3],
                east_m=float(place[0]),
                north_m=float(place[1]),
                confidence=float(random.random()),
                mark=bool(number % 2),
                intelligence_id=names[number % len(names)],
                bystanders_seen=1,
                position_sigma_m=5.0,
                evidence=(time_s,),
            )
        )
    for number, time_s in enumerate(moments(times * DECISIONS)):
        action = ACTIONS[int(random.integers(len(ACTIONS)))]
        # Few subjects for many decisions: every report that names such intelligence is the subject of them all.
        subject = "detections" if action in ACTIONS[-2:] else ("gps", *names)[number % (1 + len(names))]
        decisions.append(Decision(time_s=time_s, action=action, subject=subject, reason="as it must be"))
    return replace(
        tape,
        reports=tuple(Timed(SimTime(round(report.time_s * 1e9)), report) for report in reports),
        decisions=tuple(Timed(SimTime(round(decision.time_s * 1e9)), decision) for decision in decisions),
    )


def calls_of(work: Callable[[], object]) -> int:
    """How many calls of functions `work` makes, of Python's and of C's."""
    count = 0

    def note(frame: Any, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    # A debugger or a coverage tool may have its own profile function.
    previous = sys.getprofile()
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(previous)
    return count


@pytest.mark.parametrize("seed", [19, 28])
def test_eight_times_the_messages_are_eight_times_the_calls(seed: int) -> None:
    """Linear cost has a factor of about 8 (14 where few of the fewer reports count), quadratic one of up to 64."""
    spec = random_simspec(seed)
    empty = random_tape(spec, seed)
    requests = measures_of(load_measurable_decomposition("search-and-report-full"))
    # Options do not matter here: each measure once.
    measures = {name: {name: (name, options)} for name, options in requests.values()}
    few, many = (crowded(empty, spec, times) for times in (1, 8))
    # Imports and caches of the process belong to no measure.
    measure_all({name: request[name] for name, request in measures.items()}, replace(few), spec)
    counts = {
        name: tuple(calls_of(partial(measure_all, request, tape, spec)) for tape in (few, many))
        for name, request in measures.items()
    }
    steep = {name: (low, high) for name, (low, high) in counts.items() if high > 16 * (low + REPORTS)}
    assert steep == {}
    assert sum(high > 4 * low for low, high in counts.values()) >= 20, "too few measures read the messages"


@pytest.mark.parametrize("within_m", [0.0, 10.0, 20.0])
def test_look_ups_match_a_search_through_all_places(within_m: float) -> None:
    """On a lattice, so that many distances are exactly the limit, zero included."""
    random = np.random.default_rng(int(within_m))
    places = [
        TargetReport(id=f"r{number}", time_s=0.0, class_label=LABELS[number % 2], east_m=east_m, north_m=north_m,
                     confidence=0.5, mark=False)
        for number, (east_m, north_m) in enumerate(random.integers(-8, 8, (300, 2)) * 5.0)
    ]  # fmt: skip
    grid = PlaceGrid(within_m)
    added: list[TargetReport] = []
    for place in places:
        wanted = next((row for row, other in enumerate(added) if same_place(place, other, within_m)), None)
        assert grid.first_match(place) == wanted
        if wanted is None or place.id.endswith("7"):
            grid.add(place)
            added.append(place)
    assert 10 < len(grid) == len(added) < len(places)

    few, others = places[:100], places[280:]
    wanted_near = [any(same_place(place, other, within_m) for other in others) for place in few]
    assert has_same_place(few, others, within_m) == wanted_near
    assert 0 < sum(wanted_near) < len(few) or within_m > 0.0
    assert has_same_place(few, [], within_m) == [False] * len(few)


def test_a_run_without_any_state_of_the_vehicle_is_measured() -> None:
    """As a recording of another bench may be, or one that is cut off."""
    spec = random_simspec(28)
    assert spec.vehicle.failures
    tape = replace(random_tape(spec, 28), condition=())
    (observation,) = measure_all({"OBS-1": ("failsafe_honoured", {})}, tape, spec)
    assert not observation.considered


@pytest.mark.parametrize("seed", [19, 28])
def test_many_batches_give_what_one_gives(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent that sends more tracks than the host's memory holds is measured as any other."""
    spec = random_simspec(seed)
    tape = random_tape(spec, seed)
    assert tape.tracks
    assert tape.detections
    requests = measures_of(load_measurable_decomposition("search-and-report-full"))
    whole = measure_all(requests, replace(tape), spec)
    for module in (track_messages, answers):
        monkeypatch.setattr(module, "BATCH_PAIRS", 3)
    assert measure_all(requests, replace(tape), spec) == whole


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
