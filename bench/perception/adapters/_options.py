"""Options of a plug-in, and boxes that leave an adapter."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationInfo

from bench.arrays import Floats
from bench.contracts import Detection
from bench.documents import Document, open_file, validate_document
from bench.errors import Fault, SetupError
from bench.simspec import CLASS_LABELS, SimSpec

OPTIONS = "perception.detector_options"

D = TypeVar("D", bound=Document)


def read_options(simspec: SimSpec, kind: type[D]) -> D:
    """The options of a plug-in. Raises SetupError with every fault, each named by its path in the SimSpec."""
    try:
        context = {"class_labels": simspec.class_labels}
        return validate_document(dict(simspec.perception.detector_options), kind, context=context)
    except SetupError as error:
        raise SetupError(
            [Fault(_path(fault.where), fault.what, fault.remedy) for fault in error.faults]
        ) from None


def _path(field: str) -> str:
    # pydantic marks a fault of a mapping's key by this.
    return f"{OPTIONS}.{field.removesuffix('.[key]')}" if field else OPTIONS


def option_fault(field: str, what: str, remedy: str) -> SetupError:
    """The error of one option."""
    return SetupError(f"{OPTIONS}.{field}", what, remedy)


def require_class_labels(labels: Iterable[str], info: ValidationInfo) -> None:
    """Raises ValueError for a label that no asset has; for validators of documents that `read_options` reads."""
    known = (info.context or {}).get("class_labels", CLASS_LABELS)
    unknown = sorted(set(labels) - set(known))
    if unknown:
        raise ValueError(f"{', '.join(map(repr, unknown))}: no class label; known: {', '.join(known)}")


def file_digest(path: Path, field: str) -> str:
    """SHA-256 of the file that an option names, in hexadecimal. Raises SetupError when it cannot be read."""
    with open_file(path, f"{OPTIONS}.{field}") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def surest_detections(
    labels: list[str],
    scores: Floats,
    boxes_px: Floats,
    size_px: tuple[int, int],
    most_overlap: float | None,
    max_detections: int,
) -> tuple[Detection, ...]:
    """Detections in a picture of this width and height, surest first.

    boxes_px (n, 4) left, top, right, bottom; what lies outside the picture or has no number is left out. Of two boxes
    of one label that share more than `most_overlap` (intersection over union) the surer one stays.
    """
    width_px, height_px = size_px
    with np.errstate(invalid="ignore"):
        clipped = np.clip(
            boxes_px, 0.0, np.array([width_px, height_px, width_px, height_px], dtype=np.float64)
        )
        # Networks in half precision, or on pictures unlike those they know, do give NaN.
        valid = np.isfinite(scores) & (clipped[:, 2:] > clipped[:, :2]).all(axis=1)
    places = np.flatnonzero(valid)
    if most_overlap is not None and len(places):
        places = places[
            _without_duplicates([labels[p] for p in places], scores[places], clipped[places], most_overlap)
        ]
    order = places[np.argsort(-scores[places], kind="stable")][:max_detections]
    return tuple(
        Detection(labels[place], min(1.0, max(0.0, float(scores[place]))), _box(clipped[place]))
        for place in order
    )


def _without_duplicates(
    labels: list[str], scores: Floats, boxes_px: Floats, most_overlap: float
) -> NDArray[np.intp]:
    import cv2

    # OpenCV takes left, top, width, height.
    rectangles = np.concatenate([boxes_px[:, :2], boxes_px[:, 2:] - boxes_px[:, :2]], axis=1)
    numbers = {label: number for number, label in enumerate(sorted(set(labels)))}
    # The threshold on scores has been applied: here all pass.
    kept = cv2.dnn.NMSBoxesBatched(
        rectangles.tolist(), scores.tolist(), [numbers[label] for label in labels], -np.inf, most_overlap
    )
    return np.sort(np.asarray(kept, dtype=np.intp).reshape(-1))


def _box(edges: Floats) -> tuple[float, float, float, float]:
    left, top, right, bottom = edges.tolist()
    return left, top, right, bottom
