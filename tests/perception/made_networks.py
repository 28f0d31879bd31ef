"""Small ONNX detectors, put together by hand: they see red and blue squares, and say so in the layout asked for.

The bytes are those of protocol buffers (field numbers of onnx.proto3), so that no test needs the package onnx.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from bench.arrays import Floats
from bench.perception.adapters._layouts import Layout

CELL_PX = 16
RED_ID, BLUE_ID = 0, 1
BLUE_BGR, RED_BGR = (255, 0, 0), (0, 0, 255)
_FLOAT, _INT64 = 1, 7


def _varint(number: int) -> bytes:
    result = bytearray()
    while number > 0x7F:
        result.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*result, number])


def _field(number: int, value: int | str | bytes) -> bytes:
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    data = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _tensor(name: str, values: np.ndarray[tuple[int, ...], np.dtype[np.generic]]) -> bytes:
    whole = values.dtype.kind == "i"
    data = values.astype("<i8" if whole else "<f4").tobytes()
    dims = b"".join(_field(1, size) for size in values.shape)
    return dims + _field(2, _INT64 if whole else _FLOAT) + _field(8, name) + _field(9, data)


def _node(kind: str, inputs: Sequence[str], output: str, **attributes: int | Sequence[int]) -> bytes:
    parts = [_field(1, name) for name in inputs]
    parts += [_field(2, output), _field(3, output), _field(4, kind)]
    for name, value in attributes.items():
        if isinstance(value, int):
            parts.append(_field(5, _field(1, name) + _field(3, value) + _field(20, 2)))
        else:
            numbers = b"".join(_field(8, number) for number in value)
            parts.append(_field(5, _field(1, name) + numbers + _field(20, 7)))
    return b"".join(parts)


def _value(name: str, sizes: Sequence[int], kind: int = _FLOAT) -> bytes:
    shape = b"".join(_field(1, _field(1, size)) for size in sizes)
    return _field(1, name) + _field(2, _field(1, _field(1, kind) + _field(2, shape)))


def _model(nodes: Sequence[bytes], tensors: Sequence[bytes], given: bytes, results: Sequence[bytes]) -> bytes:
    graph = b"".join(_field(1, node) for node in nodes) + _field(2, "squares")
    graph += b"".join(_field(5, tensor) for tensor in tensors)
    graph += _field(11, given) + b"".join(_field(12, result) for result in results)
    return _field(1, 8) + _field(8, _field(1, "") + _field(2, 13)) + _field(7, graph)


def cells(width_px: int, height_px: int) -> Floats:
    """(n, 4) left, top, right, bottom of the cells of an input, row by row."""
    tops, lefts = np.meshgrid(
        np.arange(0, height_px, CELL_PX), np.arange(0, width_px, CELL_PX), indexing="ij"
    )
    corner = np.stack([lefts.reshape(-1), tops.reshape(-1)], axis=1).astype(np.float64)
    return np.concatenate([corner, corner + CELL_PX], axis=1)


def write_network(
    path: Path, layout: Layout, width_px: int, height_px: int, *, names: Mapping[str, str] | None = None
) -> Path:
    """A detector for an RGB input from 0 to 1 of this size: score = red - green - blue of a cell, or blue - red - green.

    `names` renames results.
    """
    boxes = cells(width_px, height_px)
    count = len(boxes)
    middles = np.concatenate([(boxes[:, :2] + boxes[:, 2:]) / 2.0, boxes[:, 2:] - boxes[:, :2]], axis=1)
    weights = np.zeros((3, 3, CELL_PX, CELL_PX))
    for class_id, channel in ((RED_ID, 0), (BLUE_ID, 2)):
        weights[class_id] = -1.0 / CELL_PX**2
        weights[class_id, channel] = 1.0 / CELL_PX**2
    given = _value("picture", (1, 3, height_px, width_px))
    rename = dict(names or {})

    def convolution(classes: int, factor: float = 1.0) -> tuple[list[bytes], list[bytes]]:
        nodes = [
            _node("Conv", ["picture", "weights"], "cells", kernel_shape=[CELL_PX] * 2, strides=[CELL_PX] * 2)
        ]
        return nodes, [_tensor("weights", factor * weights[:classes])]

    if layout == "yolo":
        nodes, tensors = convolution(2)
        nodes += [
            _node("Reshape", ["cells", "shape"], "scores"),
            _node("Concat", ["boxes", "scores"], "output0", axis=1),
        ]
        tensors += [_tensor("shape", np.array([1, 2, count])), _tensor("boxes", middles.T[None])]
        results = [_value("output0", (1, 6, count))]
    elif layout == "detr":
        # The third class is none: a score of 0 loses against a coloured cell and wins over a grey one.
        nodes, tensors = convolution(3, 20.0)
        logits, pred_boxes = rename.get("logits", "logits"), rename.get("pred_boxes", "pred_boxes")
        nodes += [
            _node("Reshape", ["cells", "shape"], "columns"),
            _node("Transpose", ["columns"], logits, perm=[0, 2, 1]),
            _node("Identity", ["shares"], pred_boxes),
        ]
        shares = middles / np.array([width_px, height_px, width_px, height_px])
        tensors += [_tensor("shape", np.array([1, 3, count])), _tensor("shares", shares[None])]
        results = [_value(logits, (1, count, 3)), _value(pred_boxes, (1, count, 4))]
    else:
        nodes, tensors = convolution(2)
        outputs = [rename.get(name, name) for name in ("boxes", "scores", "labels")]
        nodes += [
            _node("Identity", ["both"], outputs[0]),
            _node("Reshape", ["cells", "shape"], outputs[1]),
            _node("Identity", ["ids"], outputs[2]),
        ]
        tensors += [
            _tensor("shape", np.array([2 * count])),
            _tensor("both", np.concatenate([boxes, boxes])),
            _tensor("ids", np.repeat(np.array([RED_ID, BLUE_ID]), count)),
        ]
        results = [
            _value(outputs[0], (2 * count, 4)),
            _value(outputs[1], (2 * count,)),
            _value(outputs[2], (2 * count,), _INT64),
        ]
    path.write_bytes(_model(nodes, tensors, given, results))
    return path
