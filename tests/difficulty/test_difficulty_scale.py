"""The scale as a document: what it says of a situation, and that it explains itself."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.difficulty import DifficultyScale, Feature, load_scale, shipped_scale
from bench.documents import dump_yaml
from bench.errors import SetupError
from decompositions import load_decomposition, shipped_decompositions

ABILITIES = {"able": -2.0, "usual": 0.0, "poor": 1.0}


def scale(weights: dict[str, float], unproved: str = "", **changes: object) -> DifficultyScale:
    """A scale of one node, KA-03, over features of mean 1 and deviation 2 that the panel flew from -3 to 5."""
    feature = {"mean": 1.0, "deviation": 2.0, "low": -3.0, "high": 5.0}
    node = {"trials": 90, "failures": 40, "abilities": ABILITIES, "weights": weights, "unproved": unproved}
    return DifficultyScale.model_validate(
        {
            "decomposition": "search-and-report-full",
            "decomposition_sha256": load_decomposition("search-and-report-full").digest,
            "fitted_to": [
                {"name": "panel", "scenes": 30, "scenes_sha256": "", "runs": 90, "agents": list(ABILITIES)}
            ],
            "features": dict.fromkeys(weights, feature),
            "nodes": {"KA-03": node},
            **changes,
        }
    )


def at(**values: float) -> dict[str, Feature]:
    return {name: Feature(value, f"{name} is {value:g}") for name, value in values.items()}


def share_of(log_odds: float) -> float:
    """The panel's mean failure share, anew."""
    return float(np.mean([1.0 / (1.0 + math.exp(-(ability + log_odds))) for ability in ABILITIES.values()]))


@pytest.mark.parametrize("seed", range(6))
def test_difficulty_is_the_logit_of_the_panels_share_and_the_sum_of_its_parts(seed: int) -> None:
    """50 + 10 logit; the average situation and the contributions add up to it."""
    random = np.random.default_rng(seed)
    weights = dict(zip("abc", random.normal(0.0, 0.6, 3).tolist(), strict=True))
    values = dict(zip("abc", random.uniform(-3.0, 5.0, 3).tolist(), strict=True))
    measured = scale(weights).measure("KA-03", at(**values))
    share = share_of(sum(weights[name] * (values[name] - 1.0) / 2.0 for name in "abc"))
    assert measured.failure_share == pytest.approx(share)
    assert measured.difficulty == pytest.approx(50.0 + 10.0 * math.log(share / (1.0 - share)))
    parts = sum(part.points for part in measured.contributions)
    assert measured.average + parts == pytest.approx(measured.difficulty)
    sizes = [abs(part.points) for part in measured.contributions]
    assert sizes == sorted(sizes, reverse=True)


def test_parts_that_cancel_keep_their_size() -> None:
    """Two opposite causes: the difficulty is the average, and both are named."""
    measured = scale({"a": 1.0, "b": -1.0}).measure("KA-03", at(a=3.0, b=3.0))
    assert measured.difficulty == pytest.approx(measured.average)
    assert [part.points > 5.0 for part in measured.contributions] in ([True, False], [False, True])


@pytest.mark.parametrize("weight", [4.0, 1e6])
@pytest.mark.parametrize(("value", "difficulty"), [(5.0, 100.0), (-3.0, 0.0)])
def test_the_scale_ends_at_0_and_100(value: float, difficulty: float, weight: float) -> None:
    """Clipped, the parts say by how much; also where no chance of failure is left to compute with, or only that."""
    measured = scale({"a": weight}).measure("KA-03", at(a=value))
    assert measured.difficulty == difficulty
    assert measured.failure_share == pytest.approx(difficulty / 100.0, abs=0.01 if weight < 1e6 else 0.0)
    assert math.isfinite(measured.contributions[0].points)


def test_what_the_panel_never_flew_counts_as_the_nearest_that_it_did() -> None:
    """No extrapolation."""
    half = scale({"a": 0.5})
    assert half.log_odds("KA-03", at(a=50.0)) == half.log_odds("KA-03", at(a=5.0)) == pytest.approx(1.0)
    assert half.log_odds("KA-03", at(a=-50.0)) == pytest.approx(-1.0)


def test_the_sentence_has_numbers_words_and_doubt() -> None:
    """The largest parts first, the rest summed up; whole points add up but for rounding."""
    values = at(a=5.0, b=-3.0, c=2.0, d=1.5)
    measured = scale({"a": 0.8, "b": 0.3, "c": 0.6, "d": 0.6}).measure("KA-03", values)
    sentence = measured.sentence(count=2)
    tension = max(1, math.ceil(measured.difficulty / 20.0))
    assert sentence.startswith(f"KA-03: tension {tension}, measured {measured.difficulty:.0f}. ")
    assert sentence.index("a is 5 (+") < sentence.index("b is -3 (-") < sentence.index("all else (+")
    assert "No scale here" not in sentence
    numbers = [float(number) for number in re.findall(r"\(([+-]\d+)\)", sentence)]
    assert measured.average + sum(numbers) == pytest.approx(measured.difficulty, abs=1.5)
    doubtful = scale({"a": 0.8}, "12 failures in 180 runs").measure("KA-03", values)
    assert doubtful.sentence().endswith(" No scale here: 12 failures in 180 runs.")


def test_a_scale_comes_back_from_its_file_and_belongs_to_its_decomposition(tmp_path: Path) -> None:
    """Another version of the decomposition is refused, with the remedy."""
    document, file = scale({"a": 0.5}), tmp_path / "scale.yaml"
    file.write_text(dump_yaml(document))
    assert load_scale(file, load_decomposition("search-and-report-full")) == document
    with pytest.raises(SetupError, match="--fit DIR"):
        load_scale(file, load_decomposition("search-and-report"))


@pytest.mark.parametrize(
    ("node", "damage", "words"),
    [
        ("KA-03", {"weights": {"b": 1.0}}, "KA-03 has a weight for 'b'"),
        ("KA-03", {"abilities": {}}, "abilities"),
        ("KA-99", {}, "'KA-99', which is no key attribute"),
    ],
)
def test_a_damaged_scale_is_refused_with_its_place(
    tmp_path: Path, node: str, damage: dict[str, Any], words: str
) -> None:
    """A weight without a feature, a panel without agents, a node of nothing; a feature of another version when used."""
    document, file = scale({"a": 0.5}).model_dump(mode="json"), tmp_path / "scale.yaml"
    file.write_text(json.dumps(document | {"nodes": {node: document["nodes"]["KA-03"] | damage}}))
    with pytest.raises(SetupError, match=words):
        load_scale(file, load_decomposition("search-and-report-full"))
    with pytest.raises(SetupError, match="weight for 'a' in KA-03"):
        scale({"a": 0.5}).measure("KA-03", at(b=1.0))


def test_the_shipped_scale_is_one_of_the_shipped_decomposition() -> None:
    """Where a decomposition changed, its scale has to be fitted again: `make panel`."""
    shipped = {name: shipped_scale(load_decomposition(name)) for name in shipped_decompositions()}
    assert [name for name in shipped if shipped[name]] == ["search-and-report-full"]
    full = shipped["search-and-report-full"]
    assert full is not None
    panel, held_out = full.fitted_to[0], full.tested_on[0]
    assert len(panel.agents) >= 8
    assert len(held_out.agents) >= 3
    assert not set(panel.agents) & set(held_out.agents)
    assert panel.scenes_sha256 != held_out.scenes_sha256
