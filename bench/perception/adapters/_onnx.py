"""Any detector in an ONNX file, through OpenCV or onnxruntime."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from bench.arrays import Floats, Narrow
from bench.contracts import Detection, Pixels
from bench.documents import Document
from bench.errors import DetectorFault
from bench.simspec import SimSpec

from ._layouts import Layout, LayoutMismatch, RawBoxes, decode
from ._options import file_digest, option_fault, read_options, require_class_labels, surest_detections
from ._runtimes import Runtime, open_runtime

_GREY = 114
"""Ultralytics and its forerunners fill what a letterbox leaves with this; their networks know it from training."""

Side = Annotated[int, Field(ge=32, le=4096)]
Colour = tuple[float, float, float]


class OnnxOptions(Document):
    """`perception.detector_options` of the detector `onnx`."""

    weights: str = Field(
        min_length=1, description="The ONNX file; a relative path starts where rebar was started."
    )
    labels: dict[Annotated[int, Field(ge=0)], str] = Field(
        min_length=1,
        description="Class label of the catalogue for each class id of the network (in quotes: '0': civilian). Other ids are left out.",
    )
    layout: Layout = Field(
        "yolo",
        description=(
            "Of the results. yolo: (1, 4 + classes, boxes) as YOLOv8; boxes-scores-labels: as torchvision; "
            "detr: logits and pred_boxes as DETR."
        ),
    )
    input_px: tuple[Side, Side] = Field((640, 640), description="Width and height of the network's input.")
    letterbox: bool = Field(
        True,
        description="Whether the picture keeps its shape, with grey beside it, or is stretched to the input.",
    )
    channels: Literal["rgb", "bgr"] = Field("rgb", description="Order of the network's colours.")
    scale: float = Field(
        1.0 / 255.0, gt=0.0, description="Factor on levels of 0 to 255, before mean and deviation."
    )
    mean: Colour = Field(
        (0.0, 0.0, 0.0), description="Subtracted after the factor, in the order of `channels`."
    )
    deviation: Colour = Field((1.0, 1.0, 1.0), description="Divided by, in the same order.")
    min_score: float = Field(0.25, gt=0.0, lt=1.0, description="Least score of a detection.")
    most_overlap: float | None = Field(
        0.45,
        gt=0.0,
        le=1.0,
        description=(
            "Of two boxes of one label that share more (intersection over union) the surer stays; null: both, for "
            "networks that do this themselves."
        ),
    )
    max_detections: int = Field(300, ge=1, le=1000, description="The surest so many of a picture.")
    runtime: Literal["opencv", "onnxruntime"] = Field(
        "opencv", description="The library that computes the network."
    )

    @field_validator("labels")
    @classmethod
    def _labels_are_known(cls, labels: dict[int, str], info: ValidationInfo) -> dict[int, str]:
        require_class_labels(labels.values(), info)
        return labels

    @field_validator("deviation")
    @classmethod
    def _deviation_divides(cls, deviation: Colour) -> Colour:
        if min(deviation) <= 0.0:
            raise ValueError("each number must be above 0")
        return deviation


@dataclass(frozen=True, slots=True)
class _Fit:
    """How a picture lies in the network's input: input pixel = factor * pixel + offset, for x and y."""

    factor: tuple[float, float]
    offset_px: tuple[float, float]

    def in_picture(self, boxes_px: Floats) -> Floats:
        """(n, 4) boxes of the input, in the picture."""
        result: Floats = (boxes_px - np.array(self.offset_px * 2)) / np.array(self.factor * 2)
        return result


class OnnxDetector:
    """One network and its options."""

    def __init__(self, options: OnnxOptions, runtime: Runtime, digest: str) -> None:
        self._options, self._runtime = options, runtime
        self.version = f"{Path(options.weights).name}, SHA-256 {digest[:12]}, {runtime.version}"

    def detect(self, bgr: Pixels) -> tuple[Detection, ...]:
        """What is in the picture, surest first. Raises DetectorFault when the network cannot be computed."""
        options = self._options
        pictures, fit = self._input(bgr)
        try:
            raw = decode(options.layout, self._runtime.run(pictures), options.input_px, options.min_score)
        except LayoutMismatch as mismatch:
            raise DetectorFault(str(mismatch)) from mismatch
        named = np.array([class_id in options.labels for class_id in raw.class_ids.tolist()], dtype=bool)
        labels = [options.labels[class_id] for class_id in raw.class_ids[named].tolist()]
        return surest_detections(
            labels,
            raw.scores[named],
            fit.in_picture(raw.boxes_px[named]),
            (bgr.shape[1], bgr.shape[0]),
            options.most_overlap,
            options.max_detections,
        )

    def try_out(self) -> None:
        """Compute one grey picture, so that what does not fit is known before anything flies. Raises SetupError."""
        width_px, height_px = self._options.input_px
        pictures, _ = self._input(np.full((height_px, width_px, 3), _GREY, np.uint8))
        try:
            results = self._runtime.run(pictures)
        except DetectorFault as fault:
            raise option_fault(
                "input_px", str(fault), "give the width and height with which the network was exported"
            ) from fault
        try:
            raw = decode(self._options.layout, results, self._options.input_px, self._options.min_score)
        except LayoutMismatch as mismatch:
            what, _, remedy = str(mismatch).partition("; ")
            raise option_fault("layout", what, remedy or "choose another layout") from mismatch
        self._require_classes(raw)

    def _require_classes(self, raw: RawBoxes) -> None:
        if raw.classes is None:
            return
        missing = sorted(class_id for class_id in self._options.labels if class_id >= raw.classes)
        if missing:
            raise option_fault(
                "labels",
                f"the network has {raw.classes} classes, 0 to {raw.classes - 1}, and no {', '.join(map(str, missing))}",
                "name class ids that it has",
            )

    def _input(self, bgr: Pixels) -> tuple[Narrow, _Fit]:
        """(1, 3, h, w) what the network reads, and how the picture lies in it."""
        import cv2

        options = self._options
        width_px, height_px = options.input_px
        factor_x, factor_y = width_px / bgr.shape[1], height_px / bgr.shape[0]
        if options.letterbox:
            factor_x = factor_y = min(factor_x, factor_y)
        inner = (max(1, round(bgr.shape[1] * factor_x)), max(1, round(bgr.shape[0] * factor_y)))
        left, top = (width_px - inner[0]) // 2, (height_px - inner[1]) // 2
        # Areas when it shrinks, so that small objects do not fall between the samples.
        method = cv2.INTER_AREA if inner[0] < bgr.shape[1] else cv2.INTER_LINEAR
        canvas = np.full((height_px, width_px, 3), _GREY, np.uint8)
        canvas[top : top + inner[1], left : left + inner[0]] = cv2.resize(bgr, inner, interpolation=method)
        colours = canvas if options.channels == "bgr" else canvas[..., ::-1]
        scaled = (colours * np.float32(options.scale) - np.array(options.mean, np.float32)) / np.array(
            options.deviation, np.float32
        )
        pictures: Narrow = np.ascontiguousarray(scaled.transpose(2, 0, 1)[None], dtype=np.float32)
        fit = _Fit((inner[0] / bgr.shape[1], inner[1] / bgr.shape[0]), (float(left), float(top)))
        return pictures, fit


def open_onnx_detector(simspec: SimSpec) -> OnnxDetector:
    """The entry point `onnx` of group `rebar.detectors`.

    Raises SetupError for options that it does not know, a file that is missing or no network, and a network that does
    not have the stated layout, input or classes.
    """
    options = read_options(simspec, OnnxOptions)
    weights = Path(options.weights)
    # First: what reads the weights may wait for ever, and names no reason.
    digest = file_digest(weights, "weights")
    detector = OnnxDetector(options, open_runtime(options.runtime, weights), digest)
    detector.try_out()
    return detector
