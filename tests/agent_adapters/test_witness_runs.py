"""No observable without a seeded run that achieves it and one that fails it (witness_runs.yaml)."""

from __future__ import annotations

import pytest
from flown_scenes import DECOMPOSITION, fly, scene
from test_unruly_agent import FAILED as FAILED_BY_THE_UNRULY
from witness_runs import Witness, listed, verdicts

from bench.campaign import load_measurable_decomposition


def assert_shown(witness: Witness) -> None:
    _, _, observations = fly(scene(witness.campaign, witness.scene, witness.replicate), witness.agent)
    assert witness.verdicts - verdicts(observations) == set()


def test_every_observable_has_a_run_that_achieves_it_and_one_that_fails_it() -> None:
    shown = {verdict for witness in listed() for verdict in witness.verdicts}
    shown |= {(name, False) for name in FAILED_BY_THE_UNRULY}
    names = set(load_measurable_decomposition(DECOMPOSITION).observables)
    assert {(name, achieved) for name in names for achieved in (True, False)} - shown == set()


@pytest.mark.flight
def test_the_first_witness_shows_what_the_list_says() -> None:
    assert_shown(listed()[0])


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(600)
@pytest.mark.parametrize("index", range(1, len(listed())))
def test_the_other_witnesses_show_what_the_list_says(index: int) -> None:
    assert_shown(listed()[index])
