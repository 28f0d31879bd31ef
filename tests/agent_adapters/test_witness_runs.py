"""No observable without a seeded run that achieves it and one that fails it (witness_runs.yaml)."""

from __future__ import annotations

import pytest
from flown_scenes import DECOMPOSITION
from shipped_agents import Published, observations_of
from test_unruly_agent import FAILED as FAILED_BY_THE_UNRULY
from witness_runs import Witness, listed, verdicts

from bench.campaign import load_measurable_decomposition


def test_every_observable_has_a_run_that_achieves_it_and_one_that_fails_it() -> None:
    shown = {verdict for witness in listed() for verdict in witness.verdicts}
    shown |= {(name, False) for name in FAILED_BY_THE_UNRULY}
    names = set(load_measurable_decomposition(DECOMPOSITION).observables)
    assert {(name, achieved) for name in names for achieved in (True, False)} - shown == set()


@pytest.mark.parametrize("witness", listed(), ids=lambda witness: f"{witness.campaign}-{witness.run}")
def test_a_witness_shows_what_the_list_says(witness: Witness) -> None:
    """It is one of the runs that are kept, of which test_shipped_agents.py flies a sample again."""
    row = Published(witness.campaign).rows()[witness.run]
    assert witness.verdicts - verdicts(observations_of(row)) == set()
