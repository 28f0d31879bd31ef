"""Scenes with equal factors share a difficulty; whatever changes it is a scene of its own."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from made_run import simspec

from bench.campaign.results._finish import _SceneDifficulty
from bench.scoring import difficulty_of
from bench.simspec import SimSpec
from decompositions import load_decomposition

CHANGES: tuple[dict[str, Any], ...] = (
    {},
    {"environment": {"fog_level": 4.0}},
    {"environment": {"fog_level": 5.0}},
    {"environment": {"wind": {"speed_mps": 4.0}}},
    {"mission": {"time_limit_s": 250.0}},
    {"perception": {"source": "agent"}},
)


def test_every_scene_has_the_difficulty_of_its_own_simspec(tmp_path: Path) -> None:
    decomposition = load_decomposition("search-and-report")
    folder: Any = SimpleNamespace(simspec=lambda name: tmp_path / name)
    scenes = _SceneDifficulty(folder, decomposition)
    seen = []
    for number, change in enumerate((*CHANGES, *CHANGES)):
        document = simspec().model_dump(mode="json")
        spec = SimSpec.model_validate(
            {**document, **{part: document[part] | value for part, value in change.items()}}
        )
        (tmp_path / str(number)).write_text(spec.model_dump_json())
        entry: Any = SimpleNamespace(id=str(number), design_point=f"p{number}", replicate=1)
        seen.append(scenes.of(entry))
        assert seen[-1] == difficulty_of(decomposition, spec)
    assert len({id(difficulty) for difficulty in seen}) == len(CHANGES)
    assert len({str(difficulty) for difficulty in seen}) >= 3
