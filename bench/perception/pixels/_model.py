"""The trained network as it ships: an ONNX file, and a document beside it that says what it is and where it is from."""

from __future__ import annotations

import hashlib
import math
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Literal, Self

import cv2
import numpy as np
from pydantic import Field, model_validator

from bench.arrays import Floats, Narrow
from bench.documents import Document, read_json_document
from bench.errors import SetupError
from bench.temporary_folders import temporary_folder

from ._decoding import RawDetections, cells_of, decode

DOCUMENT_NAME, WEIGHTS_NAME = "small.json", "small.onnx"


class Calibration(Document):
    """What makes frequencies of the network's numbers, fitted on scenes that it was not trained on."""

    object_slope: float = Field(1.0, gt=0.0, description="Factor on the logit of an object.")
    object_offset: float = Field(0.0, description="Added to it afterwards.")
    label_slope: float = Field(1.0, gt=0.0, description="Factor on the logits of labels.")


class Provenance(Document):
    """From what the network came: the same on the same machine with the same versions gives it again."""

    seed: int
    scenes: int = Field(ge=1, description="Random scenes that were rendered for training.")
    crops: int = Field(ge=1, description="Parts of pictures, of 256 x 256 pixels.")
    data_sha256: str = Field(description="Digest of all crops and their boxes.")
    steady_steps: int = Field(ge=0, description="Steps of training at a steady rate.")
    falling_steps: int = Field(ge=0, description="Steps at a falling rate after them.")
    batch: int = Field(description="Crops in each step.")
    torch: str = Field(description="Version of torch.")
    opencv: str = Field(description="Build of OpenCV that rendered the crops.")


class ModelDocument(Document):
    """The document beside the weights."""

    format: Literal["rebar.pixel-detector/1"] = "rebar.pixel-detector/1"
    weights_sha256: str
    labels: tuple[str, ...] = Field(description="Class labels in the order of the network's result.")
    size_multiple_px: int = Field(
        ge=8, description="Pictures are continued to multiples of this, to the right and below."
    )
    calibration: Calibration
    provenance: Provenance

    @model_validator(mode="after")
    def _labels_differ(self) -> Self:
        if len(set(self.labels)) != len(self.labels):
            raise ValueError("a label stands twice in labels: name each once")
        return self


class NetworkModel:
    """The network behind one document. Not for two threads at a time: OpenCV keeps what it works on."""

    def __init__(self, document: ModelDocument, weights: bytes) -> None:
        self.document = document
        self._net = _network_of(weights)

    def find(
        self, bgr: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], least_object: float
    ) -> RawDetections:
        """The peaks in a picture (h, w, 3) of which at least this share are objects, before duplicates are removed."""
        self._net.setInput(cells_of(bgr, self.document.size_multiple_px))
        numbers: Narrow = np.asarray(self._net.forward(), np.float32)
        calibration = self.document.calibration
        least_logit = math.log(least_object / (1.0 - least_object))
        return decode(numbers, (least_logit - calibration.object_offset) / calibration.object_slope)

    def object_shares(self, peaks: RawDetections) -> Floats:
        """(n,) the share of such peaks that are objects."""
        calibration = self.document.calibration
        logits = calibration.object_slope * peaks.object_logits + calibration.object_offset
        shares: Floats = 1.0 / (1.0 + np.exp(-logits))
        return shares

    def label_shares(self, peaks: RawDetections) -> Floats:
        """(n, labels) the share of such objects that have each label."""
        logits = self.document.calibration.label_slope * peaks.label_logits
        powers = np.exp(logits - logits.max(axis=1, keepdims=True, initial=-np.inf))
        shares: Floats = powers / powers.sum(axis=1, keepdims=True)
        return shares


def _network_of(weights: bytes) -> cv2.dnn.Net:
    """The network on OpenCV 5's older engine, that of OpenCV 4: it takes three quarters of the time."""
    engine = getattr(cv2.dnn, "ENGINE_CLASSIC", None)
    if engine is None:
        return cv2.dnn.readNetFromONNX(np.frombuffer(weights, np.uint8))
    # OpenCV 5.0.0 heeds the choice of an engine for files alone: from memory the newer one is taken whatever is asked.
    with temporary_folder("model") as folder:
        path = folder / WEIGHTS_NAME
        path.write_bytes(weights)
        return cv2.dnn.readNetFromONNX(str(path), engine=engine)


def load_model(folder: Traversable | None = None) -> NetworkModel:
    """The network in a folder, by default the one that ships.

    Raises SetupError when the weights are not those that the document names.
    """
    folder = folder or files(__package__)
    document = read_json_document(
        (folder / DOCUMENT_NAME).read_text(encoding="utf-8"), ModelDocument, str(folder / DOCUMENT_NAME)
    )
    weights = (folder / WEIGHTS_NAME).read_bytes()
    digest = hashlib.sha256(weights).hexdigest()
    if digest != document.weights_sha256:
        raise SetupError(
            str(folder / WEIGHTS_NAME),
            f"has SHA-256 {digest[:12]}..., and {DOCUMENT_NAME} names {document.weights_sha256[:12]}...",
            "install the package again, or train both files anew",
        )
    return NetworkModel(document, weights)
