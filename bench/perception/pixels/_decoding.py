"""From the network's numbers to boxes: peaks of the object map, their labels and boxes, and no box twice."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.arrays import Floats, Narrow
from bench.contracts import Pixels

CELL_PX = 4
"""Side of a cell of the object map. A person is 6 to 15 pixels high from 60 to 100 m."""

CELL_CHANNELS = CELL_PX * CELL_PX + 2 * (CELL_PX // 2) ** 2
"""Numbers of a cell: its brightnesses, and its two colour differences at half the resolution, as in JPEG."""

SUBCELLS = 4
"""Cells of the object map in one position of the network's result: two rows of two."""

BOX_NUMBERS = 4
OBJECT, FIRST_BOX, FIRST_LABEL = 0, 1, 1 + BOX_NUMBERS
"""Places in the numbers of a cell: logit of an object's centre, then its box, then a logit for each label."""

# exp of this times a cell is 4900 pixels: larger than any picture, and no overflow.
_LARGEST_LOG_CELLS = 7.1

# Peaks beyond these are no detections in any picture worth having; they bound the work in noise.
_MOST_PEAKS = 400


@dataclass(frozen=True, slots=True, eq=False)
class RawDetections:
    """Peaks of the object map, strongest first.

    boxes_px (n, 4): left, top, right, bottom; object_logits (n,); label_logits (n, labels).
    """

    boxes_px: Floats
    object_logits: Floats
    label_logits: Floats

    def pick(self, places: NDArray[np.intp]) -> RawDetections:
        return RawDetections(self.boxes_px[places], self.object_logits[places], self.label_logits[places])


def cells_of(bgr: Pixels, multiple_px: int) -> Narrow:
    """(1, 24, h/4, w/4) what the network reads: for each cell its 4 x 4 brightnesses, then 2 x 2 of each colour
    difference, all minus 128.

    A picture whose sides are no multiples of `multiple_px` is continued with its last row and column.
    """
    height, width = bgr.shape[:2]
    below, right = -height % multiple_px, -width % multiple_px
    if below or right:
        bgr = np.asarray(cv2.copyMakeBorder(bgr, 0, below, 0, right, cv2.BORDER_REPLICATE), np.uint8)
        height, width = bgr.shape[:2]
    rows, columns = height // CELL_PX, width // CELL_PX
    # Brightness in the first `height` rows, then each colour difference at half the resolution.
    planes = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV_I420), np.uint8)
    sorted_bytes = np.empty((CELL_CHANNELS, rows, columns), np.uint8)
    brightness = planes[:height].reshape(rows, CELL_PX, columns, CELL_PX)
    sorted_bytes[:16].reshape(4, 4, rows, columns)[:] = brightness.transpose(1, 3, 0, 2)
    differences = planes[height:].reshape(2, rows, 2, columns, 2)
    sorted_bytes[16:].reshape(2, 2, 2, rows, columns)[:] = differences.transpose(0, 2, 4, 1, 3)
    cells: Narrow = np.subtract(sorted_bytes, np.float32(128.0), dtype=np.float32)
    return cells[None]


def decode(numbers: Narrow, least_logit: float) -> RawDetections:
    """The peaks above a logit in the network's result (1, 4 * numbers of a cell, h/8, w/8)."""
    _, channels, rows, columns = numbers.shape
    # Rows, subrows, columns, subcolumns: the object map of cells in the order of the picture.
    per_cell = numbers.reshape(2, 2, channels // SUBCELLS, rows, columns)
    objects = np.ascontiguousarray(per_cell[:, :, OBJECT].transpose(2, 0, 3, 1)).reshape(
        2 * rows, 2 * columns
    )
    highest = np.asarray(cv2.dilate(objects, np.ones((3, 3), np.uint8)))
    peaks_y, peaks_x = np.nonzero((objects == highest) & (objects > least_logit))
    order = np.argsort(-objects[peaks_y, peaks_x], kind="stable")[:_MOST_PEAKS]
    peaks_y, peaks_x = peaks_y[order], peaks_x[order]
    at_peaks = per_cell[peaks_y % 2, peaks_x % 2, :, peaks_y // 2, peaks_x // 2].astype(np.float64)
    box = at_peaks[:, FIRST_BOX:FIRST_LABEL]
    middle = CELL_PX * (np.stack((peaks_x, peaks_y), axis=1) + 0.5 + box[:, :2])
    half = 0.5 * CELL_PX * np.exp(np.minimum(box[:, 2:], _LARGEST_LOG_CELLS))
    return RawDetections(
        np.concatenate((middle - half, middle + half), axis=1), at_peaks[:, OBJECT], at_peaks[:, FIRST_LABEL:]
    )


def overlap(boxes_px: Floats, others_px: Floats) -> Floats:
    """(n, m) intersection over union of (n, 4) and (m, 4) boxes."""
    low = np.maximum(boxes_px[:, None, :2], others_px[None, :, :2])
    high = np.minimum(boxes_px[:, None, 2:], others_px[None, :, 2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=-1)
    areas, other_areas = (
        np.clip(b[:, 2:] - b[:, :2], 0.0, None).prod(axis=-1) for b in (boxes_px, others_px)
    )
    union = areas[:, None] + other_areas[None, :] - shared
    result: Floats = shared / np.maximum(union, 1e-9)
    return result


def without_duplicates(boxes_px: Floats, most_overlap: float) -> NDArray[np.intp]:
    """Places of the boxes that overlap no stronger kept box by more; they come strongest first."""
    overlaps = overlap(boxes_px, boxes_px)
    kept: list[int] = []
    for place in range(len(boxes_px)):
        if not kept or overlaps[place, kept].max() <= most_overlap:
            kept.append(place)
    return np.array(kept, dtype=np.intp)
