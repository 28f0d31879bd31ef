"""What the network should say about a sample: the object map with its soft peaks, and boxes and labels at centres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Counts, Narrow
from bench.perception.pixels._decoding import CELL_PX

from ._samples import Sample

# Peaks are soft over this share of a box's side. TTFNet (Liu et al. 2020) has 0.09; with that, and the cell of the centre
# as the only one to be found, 12,000 crops taught nothing about objects of 32 pixels and more.
_SOFT_SHARE = 0.14
_LEAST_SOFT_CELLS = 0.6
# Cells where a peak has at least this height are the middle of their object: each is to be found, and has its box.
_LEAST_PEAK_OF_MIDDLE = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Of a batch of n samples on maps of (h, w) cells.

    peaks (n, h, w): 1 at centres, falling to 0. weights (n, h, w): 0 where nothing may be learned from.
    The rest has m rows, one for each cell in the middle of an object: cells (m, 3) sample, row and column; boxes_px
    (m, 4) centre and sides; labels (m,); shares (m,), which sum to 1 over the cells of an object.
    """

    peaks: Narrow
    weights: Narrow
    cells: Counts
    boxes_px: Narrow
    labels: Counts
    shares: Narrow


def targets_of(samples: Sequence[Sample]) -> Targets:
    """The targets of one batch; all samples have one size."""
    height, width = (side // CELL_PX for side in samples[0].bgr.shape[:2])
    peaks = np.zeros((len(samples), height, width), np.float32)
    weights = np.ones_like(peaks)
    cells, boxes, labels, shares = [], [], [], []
    for number, sample in enumerate(samples):
        left, top, right, bottom = (sample.boxes_px / CELL_PX).T
        for place in np.flatnonzero(~sample.counts).tolist():
            rows = slice(int(top[place]), int(np.ceil(bottom[place])))
            weights[number, rows, int(left[place]) : int(np.ceil(right[place]))] = 0.0
        middles = np.stack((left + right, top + bottom), axis=1) / 2.0
        sides = np.stack((right - left, bottom - top), axis=1)
        # Small boxes last: they keep the cells that they share with a large one.
        nearest = np.full((height, width), -1, np.int64)
        strength = np.zeros((height, width), np.float32)
        counting = np.flatnonzero(sample.counts)
        for place in counting[np.argsort(-sides[counting].prod(axis=1), kind="stable")].tolist():
            rows, columns, peak = _peak(middles[place], sides[place], height, width)
            window = peaks[number, rows, columns]
            np.maximum(window, peak, out=window)
            weights[number, rows, columns][peak >= _LEAST_PEAK_OF_MIDDLE] = 1.0
            claimed = (peak >= _LEAST_PEAK_OF_MIDDLE) & (peak >= strength[rows, columns])
            nearest[rows, columns][claimed] = place
            strength[rows, columns][claimed] = peak[claimed]
        claims = np.argwhere(nearest >= 0)
        owners = nearest[nearest >= 0]
        cells.append(np.concatenate((np.full((len(claims), 1), number), claims), axis=1))
        boxes.append(np.concatenate((middles[owners], sides[owners]), axis=1) * CELL_PX)
        labels.append(sample.labels[owners])
        shares.append(1.0 / np.bincount(owners, minlength=1)[owners] if len(owners) else np.zeros(0))
    return Targets(
        peaks,
        weights,
        np.concatenate(cells),
        np.concatenate(boxes).astype(np.float32),
        np.concatenate(labels),
        np.concatenate(shares).astype(np.float32),
    )


def _peak(middle: Narrow, sides: Narrow, height: int, width: int) -> tuple[slice, slice, Narrow]:
    """Rows, columns and values of one soft peak, with exactly 1 in the cell of the centre."""
    spread = np.maximum(_SOFT_SHARE * sides, _LEAST_SOFT_CELLS)
    reach = np.ceil(3.0 * spread).astype(int)
    column, row = min(int(middle[0]), width - 1), min(int(middle[1]), height - 1)
    rows = slice(max(0, row - reach[1]), min(height, row + reach[1] + 1))
    columns = slice(max(0, column - reach[0]), min(width, column + reach[0] + 1))
    down = np.exp(-0.5 * ((np.arange(rows.start, rows.stop) - row) / spread[1]) ** 2)
    across = np.exp(-0.5 * ((np.arange(columns.start, columns.stop) - column) / spread[0]) ** 2)
    return rows, columns, np.outer(down, across).astype(np.float32)
