"""How well a detector does on scenes that it was not trained on: what was there, what was found, and as what."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from bench.arrays import Bools, Counts, Floats
from bench.camera import Conditions
from bench.contracts import Detection, PixelDetector
from bench.perception.pixels._decoding import overlap, without_duplicates
from bench.perception.pixels._model import Calibration, NetworkModel

from ._scenes import LABELS, LabelledFrame, Split, View, frames_of, generator_of, mission_frames, weather

SMALL_PX = 16
"""Longest side of a small object. A box of 6 pixels that is off by one and a half at two edges has an IoU of 0.5, so
small objects are found from an IoU of 0.3 on."""
LEAST_OVERLAP, LEAST_OVERLAP_OF_SMALL = 0.5, 0.3

# A detection that lies this far within objects that do not count is neither right nor wrong.
_EXCUSED_SHARE = 0.5

# A peak below this is no detection at any threshold.
_LEAST_OBJECT = 0.01

VGA_PX, HD_PX = (640, 480), (1280, 720)
_FOCAL_PX = 320.0 / math.tan(math.radians(35.0))
VGA = View(640, 480, (_FOCAL_PX, _FOCAL_PX), 0.0, (20.0, 100.0), (30.0, 90.0))
"""A field of view of 70 degrees, as the default camera has it, in the usual heights of a mission."""
HD = replace(VGA, width_px=1280, height_px=720, focal_px=(2.0 * _FOCAL_PX, 2.0 * _FOCAL_PX))

CONDITIONS: Mapping[str, Conditions] = {
    "clear day": weather(),
    "sun at 8 deg": weather(8.0, 280.0),
    "dusk, sun at -3 deg": weather(-3.0, 300.0),
    "night": weather(-20.0, 340.0),
    "fog level 5": weather(fog_level=5.0),
    "fog level 9": weather(fog_level=9.0),
    "rain level 4": weather(rain_level=4.0),
    "rain level 9": weather(rain_level=9.0),
    "dust level 5": weather(dust_level=5.0),
    "dust level 9": weather(dust_level=9.0),
    "noise x 5": replace(weather(), noise=5.0),
    "dirty lens 0.7": replace(weather(), lens_dirt=0.7),
    "shutter 1/40 s": replace(weather(), shutter_s=1.0 / 40.0),
    "exposure -1.5 EV": replace(weather(), exposure_ev=-1.5),
    "exposure +1.5 EV": replace(weather(), exposure_ev=1.5),
}


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """What there was and what was found, over any number of pictures.

    Of objects that count: labels (n,), sizes_px (n,) longest sides, detection_labels (n,) the label under which
    each was found, or -1. Of detections that are not excused: reports (m,) labels, scores (m,), object_labels (m,) the
    label of the object that each found, or -1.
    """

    labels: Counts
    sizes_px: Floats
    detection_labels: Counts
    reports: Counts
    scores: Floats
    object_labels: Counts
    pictures: int


def joined(parts: Sequence[Matches]) -> Matches:
    """All pictures of several."""
    columns: dict[str, Any] = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(Matches)[:-1]
    }
    return Matches(**columns, pictures=sum(part.pictures for part in parts))


def match(frame: LabelledFrame, detections: Sequence[Detection]) -> Matches:
    """Each detection, strongest first, finds the free object that it overlaps most, if it overlaps enough."""
    boxes = np.array([detection.box for detection in detections]).reshape(-1, 4)
    counting = np.flatnonzero(frame.counts)
    owners, excused = assign(frame, boxes)
    reports = np.array([LABELS.index(d.class_label) for d in detections], dtype=np.int64)
    detection_labels = np.full(len(frame.labels), -1)
    detection_labels[owners[owners >= 0]] = reports[owners >= 0]
    sides = (frame.boxes_px[:, 2:] - frame.boxes_px[:, :2]).max(axis=1, initial=0.0)
    object_labels = np.where(owners >= 0, np.append(frame.labels, -1)[owners], -1)
    scores = np.array([detection.score for detection in detections], dtype=np.float64)
    return Matches(
        frame.labels[counting],
        sides[counting],
        detection_labels[counting],
        reports[~excused],
        scores[~excused],
        object_labels[~excused],
        1,
    )


def assign(frame: LabelledFrame, boxes_px: Floats) -> tuple[Counts, Bools]:
    """(m,) the object that each box finds, or -1; and (m,) whether it is excused. The boxes come strongest first."""
    overlaps = overlap(boxes_px, frame.boxes_px)
    sides = (frame.boxes_px[:, 2:] - frame.boxes_px[:, :2]).max(axis=1, initial=0.0)
    least = np.where(sides < SMALL_PX, LEAST_OVERLAP_OF_SMALL, LEAST_OVERLAP)
    free = frame.counts.copy()
    owners = np.full(len(boxes_px), -1)
    excused = np.zeros(len(boxes_px), dtype=bool)
    for place, box in enumerate(boxes_px):
        candidates = np.where(free & (overlaps[place] >= least), overlaps[place], 0.0)
        if candidates.max(initial=0.0) > 0.0:
            owners[place] = int(candidates.argmax())
            free[owners[place]] = False
        else:
            excused[place] = _share_within(box, frame.boxes_px[~frame.counts]) >= _EXCUSED_SHARE
    return owners, excused


def _share_within(box: Floats, others_px: Floats) -> float:
    """The largest share of a box that lies within another."""
    low, high = np.maximum(others_px[:, :2], box[:2]), np.minimum(others_px[:, 2:], box[2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=1)
    return float(shared.max(initial=0.0) / max(1e-9, float((box[2:] - box[:2]).prod())))


def frames_under(
    conditions: Conditions | None, seed: int, frame_count: int, size_px: tuple[int, int] = VGA_PX
) -> Iterator[LabelledFrame]:
    """Held-out frames of each situation of campaigns/standard, without `conditions` in its own."""
    return mission_frames(Split.EVALUATION, seed, frame_count, size_px, conditions)


def random_frames(split: Split, seed: int, scene_count: int, frame_count: int) -> Iterator[LabelledFrame]:
    """Frames of random scenes with all assets, under random conditions."""
    for scene in range(scene_count):
        yield from frames_of(generator_of(seed, split, scene), frame_count, View())


def evaluate(detectors: Sequence[PixelDetector], frames: Iterable[LabelledFrame]) -> tuple[Matches, ...]:
    """What each detector makes of the same frames."""
    parts = [[match(frame, d.detect(frame.bgr)) for d in detectors] for frame in frames]
    return tuple(joined(column) for column in zip(*parts, strict=True))


def _peaks_of(
    model: NetworkModel, frames: Iterable[LabelledFrame]
) -> tuple[Floats, Bools, Floats, Counts, int]:
    """Of peaks that are not excused: logits, whether each is an object; of these label logits and labels; and pictures."""
    logits, hits, label_logits, labels = [], [], [], []
    for frame in frames:
        peaks = model.find(frame.bgr, _LEAST_OBJECT)
        peaks = peaks.pick(without_duplicates(peaks.boxes_px, 0.55))
        owners, excused = assign(frame, peaks.boxes_px)
        logits.append(peaks.object_logits[~excused])
        hits.append(owners[~excused] >= 0)
        label_logits.append(peaks.label_logits[owners >= 0])
        labels.append(frame.labels[owners[owners >= 0]])
    parts: list[Any] = [np.concatenate(part) for part in (logits, hits, label_logits, labels)]
    return parts[0], parts[1], parts[2], parts[3], len(logits)


def calibrate(
    model: NetworkModel, seed: int, scene_count: int, frame_count: int, report: Callable[[str], None]
) -> Calibration:
    """Platt's scaling of the object's logit, and one temperature for the labels, by greatest likelihood.

    The first on frames of the standard's situations, in their own conditions and, a third of them, in all of CONDITIONS;
    the second, which needs all labels, on random scenes. `model` must be without calibration.
    """
    scenes = random_frames(Split.CALIBRATION, seed, scene_count, frame_count)
    *_, z, t, _ = _peaks_of(model, scenes)
    frames = [mission_frames(Split.CALIBRATION, seed, 2 * len(CONDITIONS), VGA_PX)]
    frames += [mission_frames(Split.CALIBRATION, seed + 1, 1, VGA_PX, c) for c in CONDITIONS.values()]
    x, hits, _, _, pictures = _peaks_of(model, itertools.chain.from_iterable(frames))
    y = hits.astype(np.float64)

    def object_loss(parameters: Floats) -> float:
        margin = math.exp(parameters[0]) * x + parameters[1]
        return float(np.mean(np.logaddexp(0.0, margin) - y * margin))

    def label_loss(slope: float) -> float:
        scaled = slope * z
        return float(np.mean(np.logaddexp.reduce(scaled, axis=1) - scaled[np.arange(len(t)), t]))

    # A network that has learned nothing would make the slope zero.
    bounds = ((-2.0, 2.0), (-10.0, 10.0))
    fitted = minimize(object_loss, np.zeros(2), method="Nelder-Mead", bounds=bounds).x
    slope = minimize_scalar(label_loss, bounds=(0.2, 5.0), method="bounded").x
    result = Calibration(
        object_slope=round(math.exp(float(fitted[0])), 4),
        object_offset=round(float(fitted[1]), 4),
        label_slope=round(float(slope), 4),
    )
    margin = result.object_slope * x + result.object_offset
    report(f"{len(x)} peaks in {pictures} pictures, {int(y.sum())} of them objects: {result}")
    margin = result.object_slope * x + result.object_offset
    for threshold in (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6):
        chosen = margin > math.log(threshold / (1.0 - threshold))
        alarms = (chosen & ~hits).sum() / pictures
        report(f"  from {threshold}: {alarms:.3f} false in a picture, {int(y[chosen].sum())} objects")
    return result
