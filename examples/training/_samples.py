"""Parts of rendered pictures with their boxes, clipped in a folder: what the network learns from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.camera import opencv_build
from bench.contracts import Pixels

from ._scenes import LabelledFrame, Split, View, frames_of, generator_of, large_enough

CROP_PX = 256
CROPS_OF_FRAME = 3
FRAMES_OF_SCENE = 10
GROUND_FRAMES_OF_SCENE, GROUND_HEIGHTS_M = 6, (0.1, 15.0)
# An object of which less is left in a crop is cut off: it neither counts nor is background.
_LEAST_SHARE_KEPT = 0.35


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One crop: its pixels, and boxes, labels and `counts` as of a LabelledFrame."""

    bgr: Pixels
    boxes_px: Floats
    labels: Counts
    counts: Bools


@dataclass(frozen=True, slots=True, eq=False)
class SampleStore:
    """All crops of a data set. `starts` (n + 1,) divides the rows of boxes, labels and counts among the crops."""

    pictures: Pixels
    boxes_px: Floats
    labels: Counts
    counts: Bools
    starts: Counts
    digest: str

    def __len__(self) -> int:
        return len(self.pictures)

    def sample(self, number: int) -> Sample:
        rows = slice(int(self.starts[number]), int(self.starts[number + 1]))
        return Sample(self.pictures[number], self.boxes_px[rows], self.labels[rows], self.counts[rows])


def open_samples(folder: Path, seed: int, scene_count: int) -> SampleStore:
    """The crops of so many training scenes: from the folder where it has them, else rendered into it."""
    wanted = {"seed": seed, "scenes": scene_count, "frames": FRAMES_OF_SCENE, "opencv": opencv_build()}

    def pictures() -> Iterator[tuple[LabelledFrame, np.random.Generator]]:
        for scene in range(scene_count):
            random = generator_of(seed, Split.TRAINING, scene)
            # Cuts have a generator of their own: another number of crops leaves the scenes as they are.
            cuts = generator_of(seed, Split.TRAINING, scene, 1)
            for frame in frames_of(random, FRAMES_OF_SCENE, View()):
                yield frame, cuts
            if scene % 20 == 0:
                print(f"rendered {scene + 1} of {scene_count} scenes", flush=True)

    return _opened(folder, wanted, scene_count * FRAMES_OF_SCENE * CROPS_OF_FRAME, pictures)


@dataclass(frozen=True, slots=True, eq=False)
class MixedSamples:
    """The crops of one data set, and those of another so many times."""

    first: SampleStore
    second: SampleStore
    times: int

    def __len__(self) -> int:
        return len(self.first) + self.times * len(self.second)

    def sample(self, number: int) -> Sample:
        if number < len(self.first):
            return self.first.sample(number)
        return self.second.sample((number - len(self.first)) % len(self.second))


def open_ground_samples(folder: Path, seed: int, scene_count: int) -> SampleStore:
    """Crops of bare ground from up to 15 m, rendered into the folder or found there.

    A vehicle that stands sees ground without structure, of which no scene of `open_samples` has anything.
    """
    wanted = {"seed": seed, "scenes": scene_count, "view": "bare ground", "opencv": opencv_build()}

    def pictures() -> Iterator[tuple[LabelledFrame, np.random.Generator]]:
        for scene in range(scene_count):
            random = generator_of(seed, Split.TRAINING, scene, 2)
            cuts = generator_of(seed, Split.TRAINING, scene, 3)
            for frame in frames_of(
                random, GROUND_FRAMES_OF_SCENE, View(height_m=GROUND_HEIGHTS_M), empty=True
            ):
                yield frame, cuts

    return _opened(folder, wanted, scene_count * GROUND_FRAMES_OF_SCENE * CROPS_OF_FRAME, pictures)


def _opened(
    folder: Path,
    wanted: dict[str, object],
    total: int,
    pictures: Callable[[], Iterator[tuple[LabelledFrame, np.random.Generator]]],
) -> SampleStore:
    """What the folder has, if it is what is wanted; else these pictures, cut by the generators beside them."""
    about = folder / "about.json"
    if (
        not about.exists()
        or {k: v for k, v in json.loads(about.read_text(encoding="utf-8")).items() if k != "digest"} != wanted
    ):
        _write(folder, total, pictures())
        about.write_text(json.dumps(wanted | {"digest": _digest(folder)}), encoding="utf-8")
    arrays = np.load(folder / "boxes.npz")
    return SampleStore(
        np.load(folder / "pictures.npy", mmap_mode="r"),
        arrays["boxes_px"],
        arrays["labels"],
        arrays["counts"],
        arrays["starts"],
        json.loads(about.read_text(encoding="utf-8"))["digest"],
    )


def _write(folder: Path, total: int, frames: Iterator[tuple[LabelledFrame, np.random.Generator]]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "about.json").unlink(missing_ok=True)
    pictures = np.lib.format.open_memmap(
        folder / "pictures.npy", mode="w+", dtype=np.uint8, shape=(total, CROP_PX, CROP_PX, 3)
    )
    samples: list[Sample] = []
    for frame, cuts in frames:
        for _ in range(CROPS_OF_FRAME):
            sample = cut(frame, cuts)
            pictures[len(samples)] = sample.bgr
            samples.append(sample)
    pictures.flush()
    lengths = [len(sample.labels) for sample in samples]
    np.savez(
        folder / "boxes.npz",
        boxes_px=np.concatenate([sample.boxes_px for sample in samples]),
        labels=np.concatenate([sample.labels for sample in samples]),
        counts=np.concatenate([sample.counts for sample in samples]),
        starts=np.concatenate(([0], np.cumsum(lengths))),
    )


def cut(frame: LabelledFrame, random: np.random.Generator) -> Sample:
    """A crop of a frame, three times in four with an object that counts at a random place in it."""
    height, width = frame.bgr.shape[:2]
    left, top = random.uniform(0, width - CROP_PX), random.uniform(0, height - CROP_PX)
    candidates = np.flatnonzero(frame.counts)
    if len(candidates) and random.random() < 0.75:
        box = frame.boxes_px[candidates[int(random.integers(len(candidates)))]]
        place = random.uniform(0.15, 0.85, 2) * CROP_PX
        left, top = (box[:2] + box[2:]) / 2.0 - place
    left = int(np.clip(left, 0, width - CROP_PX))
    top = int(np.clip(top, 0, height - CROP_PX))
    return part_of(Sample(frame.bgr, frame.boxes_px, frame.labels, frame.counts), left, top, CROP_PX)


def part_of(sample: Sample, left: int, top: int, side_px: int) -> Sample:
    """A square of a sample, with what of its boxes is in there."""
    moved = sample.boxes_px - (left, top, left, top)
    clipped = np.clip(moved, 0, side_px)
    sides = clipped[:, 2:] - clipped[:, :2]
    inside = (sides > 0).all(axis=1)
    area = (moved[:, 2:] - moved[:, :2]).prod(axis=1)
    share = sides.prod(axis=1) / np.maximum(area, 1.0)
    counts = sample.counts & (share >= _LEAST_SHARE_KEPT) & large_enough(clipped, side_px, side_px)
    bgr = sample.bgr[top : top + side_px, left : left + side_px]
    return Sample(bgr, clipped[inside], sample.labels[inside], counts[inside])


def _digest(folder: Path) -> str:
    digest = hashlib.sha256()
    for picture in np.load(folder / "pictures.npy", mmap_mode="r"):
        digest.update(picture.tobytes())
    arrays = np.load(folder / "boxes.npz")
    for name in ("boxes_px", "labels", "counts", "starts"):
        digest.update(arrays[name].tobytes())
    return digest.hexdigest()
