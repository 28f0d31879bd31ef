"""What networks say, in the layouts that exporters write, as boxes with the number of a class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Floats, Narrow

Layout = Literal["yolo", "boxes-scores-labels", "detr"]


class LayoutMismatch(Exception):
    """The results do not have the stated layout. The text says what they have instead, and what to do."""


@dataclass(frozen=True, slots=True, eq=False)
class RawBoxes:
    """boxes (n, 4) left, top, right, bottom in pixels of the network's input; scores (n,); class ids (n,).

    `classes` is how many there are, None where the layout does not say.
    """

    boxes_px: Floats
    scores: Floats
    class_ids: NDArray[np.int64]
    classes: int | None


def decode(
    layout: Layout, results: Mapping[str, Narrow], input_px: tuple[int, int], min_score: float
) -> RawBoxes:
    """All boxes with at least this score. Raises LayoutMismatch."""
    if layout == "yolo":
        raw = _decode_yolo(results)
    elif layout == "detr":
        raw = _decode_detr(results, input_px)
    else:
        raw = _decode_lists(results)
    # Comparisons with NaN are false: what has no score is no detection.
    sure = raw.scores >= min_score
    return RawBoxes(raw.boxes_px[sure], raw.scores[sure], raw.class_ids[sure], raw.classes)


def _decode_yolo(results: Mapping[str, Narrow]) -> RawBoxes:
    """Ultralytics YOLOv8 and later, without end-to-end suppression: (1, 4 + classes, boxes), boxes by middle and sides
    in pixels of the input, scores as probabilities."""
    result = next(iter(results.values()))
    if len(results) != 1 or result.ndim != 3 or result.shape[0] != 1 or result.shape[1] < 5:
        raise LayoutMismatch(
            f"yolo is one result of (1, 4 + classes, boxes), the network has {_shapes(results)}; "
            "export it from Ultralytics with nms=False, or choose another layout"
        )
    # As many numbers a box as a network has boxes: the axes are exchanged, as in YOLOv5 and in end-to-end exports.
    if result.shape[1] > result.shape[2]:
        raise LayoutMismatch(
            f"yolo is (1, 4 + classes, boxes), the network has {_shapes(results)}, which looks like (1, boxes, numbers) "
            "of YOLOv5 or of an end-to-end export; export it in the layout of YOLOv8"
        )
    table: Floats = result[0].T.astype(np.float64)
    shares = table[:, 4:]
    best = shares.argmax(axis=1)
    return RawBoxes(
        _edges(table[:, :4]), shares[np.arange(len(best)), best], best.astype(np.int64), shares.shape[1]
    )


def _decode_detr(results: Mapping[str, Narrow], input_px: tuple[int, int]) -> RawBoxes:
    """DETR as Hugging Face exports it: `logits` (1, boxes, classes + 1), the last class being none, and `pred_boxes`
    (1, boxes, 4), middle and sides as shares of the input (Carion et al. 2020)."""
    logits, shares = results.get("logits"), results.get("pred_boxes")
    if (
        logits is None
        or shares is None
        or logits.ndim != 3
        or logits.shape[2] < 2
        or shares.shape != (1, logits.shape[1], 4)
    ):
        raise LayoutMismatch(
            "detr is logits (1, boxes, classes + 1) and pred_boxes (1, boxes, 4), the network has "
            f"{_shapes(results)}; name the results so when you export it, or choose another layout"
        )
    powers = np.exp(logits[0].astype(np.float64) - logits[0].max(axis=1, keepdims=True))
    probabilities = (powers / powers.sum(axis=1, keepdims=True))[:, :-1]
    best = probabilities.argmax(axis=1)
    boxes = shares[0].astype(np.float64) * np.array([*input_px, *input_px], dtype=np.float64)
    return RawBoxes(
        _edges(boxes),
        probabilities[np.arange(len(best)), best],
        best.astype(np.int64),
        probabilities.shape[1],
    )


def _decode_lists(results: Mapping[str, Narrow]) -> RawBoxes:
    """torchvision's detectors: `boxes` (n, 4) by their edges in pixels of the input, `scores` (n,), `labels` (n,)."""
    # Batches of one have an axis more in some exports.
    lists = {name: result[0] if result.shape[:1] == (1,) else result for name, result in results.items()}
    boxes, scores, labels = (lists.get(name) for name in ("boxes", "scores", "labels"))
    if boxes is None or scores is None or labels is None:
        raise LayoutMismatch(
            f"boxes-scores-labels is three results of these names, the network has {_shapes(results)}; "
            "name the results so when you export it, or choose another layout"
        )
    count = scores.size
    if boxes.size != 4 * count or labels.size != count:
        raise LayoutMismatch(
            f"boxes-scores-labels is boxes (n, 4), scores (n,) and labels (n,), the network has {_shapes(results)}"
        )
    with np.errstate(invalid="ignore"):
        class_ids = np.nan_to_num(labels.reshape(-1), nan=-1.0).astype(np.int64)
    return RawBoxes(
        boxes.reshape(-1, 4).astype(np.float64), scores.reshape(-1).astype(np.float64), class_ids, None
    )


def _edges(middles_and_sides: Floats) -> Floats:
    middle, half = middles_and_sides[:, :2], middles_and_sides[:, 2:] / 2.0
    return np.concatenate([middle - half, middle + half], axis=1)


def _shapes(results: Mapping[str, Narrow]) -> str:
    return ", ".join(f"{name} {tuple(result.shape)}" for name, result in results.items()) or "no result"
