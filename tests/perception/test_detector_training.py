"""How the detector that ships is trained and measured: equal seeds, equal weights; and frames of missions."""

from __future__ import annotations

import itertools
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from examples.training._evaluation import CONDITIONS
from examples.training._samples import CROP_PX, FRAMES_OF_SCENE, open_samples
from examples.training._scenes import LabelledFrame, Split, generator_of, mission_frames, random_conditions

needs_torch = pytest.mark.skipif(
    not all(find_spec(name) for name in ("torch", "onnx")), reason="examples/training/requirements.txt"
)


def missions(seed: int, split: Split = Split.EVALUATION, condition: str = "") -> list[LabelledFrame]:
    """Two frames of the first situation."""
    conditions = CONDITIONS[condition] if condition else None
    return list(itertools.islice(mission_frames(split, seed, 2, (320, 240), conditions), 2))


def test_equal_seeds_give_equal_scenes_under_all_conditions() -> None:
    first, again = missions(5), missions(5)
    rain = missions(5, condition="rain level 9")

    for frame, repeated, rainy in zip(first, again, rain, strict=True):
        assert (frame.bgr == repeated.bgr).all()
        assert (frame.boxes_px == repeated.boxes_px).all()
        assert (frame.boxes_px == rainy.boxes_px).all()
        assert (frame.bgr != rainy.bgr).any()


def test_no_split_and_no_seed_has_a_scene_of_another() -> None:
    draws = [
        generator_of(seed, split, scene).random() for seed in (5, 6) for split in Split for scene in (0, 1)
    ]
    assert len(set(draws)) == len(draws)
    assert (missions(5)[0].bgr != missions(6)[0].bgr).mean() > 0.5


def test_training_sees_every_condition_and_campaigns_most() -> None:
    draws = [random_conditions(generator_of(3, Split.TRAINING, scene)) for scene in range(2000)]
    elevations = np.degrees([c.sun_elevation_rad for c in draws])
    levels = np.array([(c.rain_level, c.fog_level, c.dust_level) for c in draws])
    mild = (elevations > 5.0) & (levels <= (3.0, 4.0, 0.0)).all(axis=1)

    assert 0.35 < mild.mean() < 0.6
    for share in (levels[:, 0] > 6, levels[:, 1] > 6, levels[:, 2] > 6, elevations < -6, elevations < 6):
        assert share.mean() > 0.02
    assert ((levels[:, 0] > 0) & (levels[:, 1] > 0)).mean() > 0.2


@needs_torch
def test_equal_seeds_give_equal_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice with one seed, once with another; the second pass over the crops, with its repeats, is in it."""
    monkeypatch.setenv("TORCHINDUCTOR_CACHE_DIR", str(tmp_path))
    from examples.training._export import write_onnx
    from examples.training._learning import Plan, train
    from examples.training._network import layers_of

    samples = open_samples(tmp_path / "cache", 3, 1)
    assert samples.pictures.shape == (3 * FRAMES_OF_SCENE, CROP_PX, CROP_PX, 3)
    layers = layers_of(11)
    files: list[bytes] = []
    for seed in (1, 1, 2):
        (checkpoint,) = train(
            layers, samples, Plan(4, 8, batch=4), np.random.default_rng(seed), lambda _: None
        )
        assert (checkpoint.steady_steps, checkpoint.falling_steps) == (4, 8)
        path = tmp_path / f"{len(files)}.onnx"
        write_onnx(layers, checkpoint.weights, path)
        files.append(path.read_bytes())
    assert files[0] == files[1] != files[2]
