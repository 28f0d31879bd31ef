"""Methods of design in general: which ones grow, how even they are, and that they depend on nothing but the document."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any, get_args

import pytest
from design_plans import FORBID, TANGLED, design, levels, ranges, rated

from bench.documents import validate_document
from bench.realization import Design, DesignPoint, Method
from bench.realization.design._design import GROWING


@pytest.mark.parametrize("kind", ["halton", "sobol"])
def test_sequences_grow_without_reshuffling(kind: str) -> None:
    """More points begin with the earlier ones, forbidden or not, over blocks drawn at once too."""
    factors, forbid = [*ranges(2), levels("a", "x", "y")], ["f0 > 0.9 and a == 'x'"]
    shorter, longer = (
        design(factors, forbid=forbid, method={"kind": kind, "points": count}).points() for count in (5, 600)
    )

    assert longer[:5] == shorter
    assert len(longer) == 600


def test_every_method_that_says_so_grows() -> None:
    """Which methods claim to take more points later; two other tests hold them to it."""
    kinds = {
        method.model_fields["kind"].default: issubclass(method, GROWING)
        for method in get_args(get_args(Method)[0])
    }

    assert {kind for kind, grows in kinds.items() if grows} == {"halton", "sobol", "stratified"}
    assert len(kinds) == 13


def test_further_points_follow_those_that_are_there() -> None:
    """`then` numbers on, whatever the methods, and leaves points, draws and scenes of the first."""
    factors = [levels("a", 1, 2, 3), levels("b", 1, 2, 3)]
    stated: dict[str, Any] = {"replicates": 2, "method": {"kind": "full_factorial", "take": 7}, "seed": 3}
    first = design(factors, **stated)
    grown = design(factors, **stated, then=[{"kind": "sobol", "points": 4}] * 2)

    assert grown.pairs()[:7] == first.pairs()
    assert [point.id for point, _ in grown.pairs()[7:]] == [f"p{n:03d}" for n in range(10, 18) for _ in "12"]
    blocks = [[point.levels for point in grown.points()[at : at + 4]] for at in (9, 13)]
    assert blocks[0] != blocks[1]


def test_stratified_designs_are_even_and_grow() -> None:
    """Rare configurations get as many points as common ones, and more points keep the first."""

    def points(count: int) -> list[DesignPoint]:
        method = {"kind": "stratified", "points": count, "candidates": 300}
        return design([*ranges(2), levels("a", "x", "y")], method=method, seed=1).points(rated)

    values = Counter(tuple(rated(point.levels).values()) for point in points(22))
    assert sorted(values.values()) == [5, 5, 6, 6]
    assert points(22)[:9] == points(9)


def test_stratified_designs_keep_to_a_range_of_difficulty() -> None:
    """The easier end is outside, the harder one inside; what has no difficulty is outside any range."""

    def drawn(difficulty: Callable[[float], float | None], **method: object) -> set[float]:
        document = {
            "method": {"kind": "stratified", "points": 4, "candidates": 200, "band": 100, **method},
            "factors": [{"name": "fog", "levels": [0, 20, 40, 60, 80], "sets": ["environment.fog_level"]}],
        }
        points = Design.model_validate(document).points(
            lambda levels: {"KA": difficulty(float(levels["fog"]))}
        )
        return {float(point.levels["fog"]) for point in points}

    assert drawn(lambda fog: fog, above=0, up_to=60) == {0.0, 20.0, 40.0, 60.0}
    assert drawn(lambda fog: fog, above=20, up_to=60, points=2) == {40.0, 60.0}
    assert drawn(lambda fog: fog if fog > 40 else None, above=0, points=2) == {60.0, 80.0}
    with pytest.raises(ValueError, match="only 2 different points above 20 up to 60 are among"):
        drawn(lambda fog: fog, above=20, up_to=60)
    for above, up_to in ((60, 20), (60, 60)):
        with pytest.raises(ValueError, match=f"nothing is above {above} and up to {up_to}"):
            drawn(lambda fog: fog, above=above, up_to=up_to)


def test_a_design_is_drawn_by_one_scale() -> None:
    measured = {"kind": "stratified", "points": 4, "scale": "measured"}
    document = {
        "method": measured,
        "then": [{**measured, "scale": "published"}],
        "factors": [{"name": "fog", "range": {"low": 0, "high": 9}, "sets": ["environment.fog_level"]}],
    }
    with pytest.raises(ValueError, match="have one scale"):
        Design.model_validate(document)
    assert Design.model_validate({**document, "then": [measured]}).scales == {"measured"}


def test_stratified_designs_that_cannot_be() -> None:
    """More configurations than points, and too few candidates, are message; bands make few of many."""
    method = {"kind": "stratified", "points": 6, "candidates": 100}

    def smooth(chosen: Any) -> dict[str, float]:
        return {"KA-1": 100.0 * chosen["f0"]}

    with pytest.raises(ValueError, match="100 difficulty configurations, more than points 6"):
        design(ranges(1), method=method).points(smooth)
    banded = design(ranges(1), method={**method, "band": 20.0}).points(smooth)
    assert sorted(Counter(int(float(point.levels["f0"]) * 5) for point in banded).values()) == [1, 1, 1, 1, 2]
    with pytest.raises(ValueError, match="only 2 different points"):
        design([levels("a", 1, 2)], method=method).points(lambda _: {"KA-1": 1.0})


_SCRIPT = """
import json, sys
from bench.realization import Design
print([Design.model_validate(one).points() for one in json.load(sys.stdin)])
"""


def test_designs_are_the_same_in_another_process() -> None:
    """With another hash seed the same points are drawn, for every method that draws or searches."""
    methods: list[dict[str, Any]] = [
        {"kind": "latin_hypercube", "points": 12},
        {"kind": "nearly_orthogonal_latin_hypercube", "points": 12},
        {"kind": "orthogonal_latin_hypercube"},
        {"kind": "sobol", "points": 12},
        {"kind": "nested", "points": 12, "high": 4, "fidelity": "rate"},
    ]
    factors = [levels("rate", 1, 2), *ranges(3)]
    documents = [{"factors": factors, "method": method, "seed": 9} for method in methods]
    covering = {"kind": "covering_array", "strength": 3}
    documents.append({"factors": TANGLED, "forbid": FORBID, "method": covering})
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    digests = subprocess.run(
        [sys.executable, "-c", _SCRIPT],
        input=json.dumps(documents),
        env={"PYTHONHASHSEED": seed},
        capture_output=True,
        text=True,
        check=True,
    )

    assert digests.stdout.strip() == str([validate_document(point, Design).points() for point in documents])
