"""The layouts of the shipped situations, frozen: the same SimSpec and seed give the same places for ever.

A change that moves anybody makes published results impossible to repeat. `python
tests/realization/placement/test_placement_frozen.py` writes the layouts as they are now.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.campaign import load_campaign, realizations
from bench.documents import dump_json, read_document
from bench.errors import PlacementInfeasible
from bench.realization import place
from bench.simspec import SimSpec, load_simspec

ROOT = Path(__file__).parents[3]
FROZEN = Path(__file__).with_name("frozen_layouts.json")
EVERY = 12
"""Of the scenes of a campaign one in so many, so that the test takes seconds."""

LONG = ("campaigns/held_out.yaml", "campaigns/panel.yaml")
"""Large Latin hypercubes of low discrepancy: each takes seconds to draw, and its scenes are of the kinds of the others."""


def shipped(*, long: bool) -> Iterator[tuple[str, SimSpec]]:
    """Every example, every base of the standard, and some scenes of each campaign; or some of the long campaigns."""
    alone = [*ROOT.glob("examples/*.yaml"), *ROOT.glob("campaigns/standard/*.yaml")]
    for path in sorted([] if long else alone):
        if "rebar.simspec/1" in path.read_text():
            yield str(path.relative_to(ROOT)), load_simspec(path)
    for path in sorted(ROOT.glob("campaigns/*.yaml")):
        if (str(path.relative_to(ROOT)) in LONG) is not long:
            continue
        campaign = load_campaign(path)
        scenes = {(plan.design_point, plan.replicate): plan for plan in realizations(campaign)}
        for plan in list(scenes.values())[::EVERY]:
            yield f"{path.relative_to(ROOT)}: {plan.design_point}, {plan.replicate}", plan.simspec


def layout(simspec: SimSpec) -> str:
    """A digest of everybody's place and heading, of the reported places and the method; or of the refusal."""
    try:
        realized = place(simspec).realized
    except PlacementInfeasible as refusal:
        return str(refusal)
    assert realized is not None
    return hashlib.sha256(dump_json(realized).encode()).hexdigest()


@pytest.mark.parametrize("long", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_nobody_has_moved(long: bool) -> None:
    frozen = json.loads(FROZEN.read_text())
    wanted = {name: digest for name, digest in frozen.items() if (name.split(": ")[0] in LONG) is long}
    assert {name: layout(simspec) for name, simspec in shipped(long=long)} == wanted


def test_a_written_situation_is_placed_as_the_one_that_it_was_written_from() -> None:
    """Fields that a SimSpec does not set leave no trace in it, nor in its layout."""
    original = load_simspec(ROOT / "examples" / "governed.yaml")
    written = dump_json(original)
    assert [name for name in ("avoid", "extent_m", "counts") if f'"{name}"' in written] == []
    assert layout(read_document(written, SimSpec)) == layout(original)


if __name__ == "__main__":
    every = itertools.chain(shipped(long=False), shipped(long=True))
    FROZEN.write_text(json.dumps({name: layout(simspec) for name, simspec in every}, indent=1) + "\n")
