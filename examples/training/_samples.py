"""Parts of rendered pictures with their boxes, clipped in a folder: what the network learns from."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.camera import opencv_build
from bench.contracts import Pixels

from ._scenes import LabelledFrame, Split, View, frames_of, generator_of, large_enough

CROP_PX = 256
CROPS_OF_FRAME = 3
FRAMES_OF_SCENE = 12
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
    about = folder / "about.json"
    if (
        not about.exists()
        or {k: v for k, v in json.loads(about.read_text(encoding="utf-8")).items() if k != "digest"} != wanted
    ):
        _write(folder, seed, scene_count)
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


def _write(folder: Path, seed: int, scene_count: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "about.json").unlink(missing_ok=True)
    total = scene_count * FRAMES_OF_SCENE * CROPS_OF_FRAME
    pictures = np.lib.format.open_memmap(
        folder / "pictures.npy", mode="w+", dtype=np.uint8, shape=(total, CROP_PX, CROP_PX, 3)
    )
    samples: list[Sample] = []
    for scene in range(scene_count):
        random = generator_of(seed, Split.TRAINING, scene)
        # Cuts have a generator of their own: another number of crops leaves the scenes as they are.
        cuts = generator_of(seed, Split.TRAINING, scene, 1)
        for frame in frames_of(random, FRAMES_OF_SCENE, View()):
            for _ in range(CROPS_OF_FRAME):
                sample = cut(frame, cuts)
                pictures[len(samples)] = sample.bgr
                samples.append(sample)
        if scene % 20 == 0:
            print(f"rendered {scene + 1} of {scene_count} scenes", flush=True)
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
