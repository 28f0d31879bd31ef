"""The detector behind the plug-in contract: options, scores, and boxes inside the picture."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from bench.camera import opencv_build, use_one_thread
from bench.contracts import Detection, Pixels
from bench.documents import Document
from bench.simspec import SimSpec

from ..adapters._options import read_options, surest_detections
from ._decoding import without_duplicates
from ._model import NetworkModel, load_model

DEFAULT_MIN_OBJECT = 0.5
"""The least of 0.1, 0.15, ... 0.6 with at most 0.3 false detections a picture on the calibration frames of missions (0.27)."""

# Two boxes that share more are one object. People who stand together share less.
_MOST_OVERLAP = 0.55


class SmallDetectorOptions(Document):
    """`perception.detector_options` of the detector `small`."""

    min_object: float = Field(
        DEFAULT_MIN_OBJECT,
        ge=0.01,
        le=0.99,
        description="Least probability that there is an object at all. Lower finds more, and more that is nothing.",
    )
    max_detections: int = Field(
        200, ge=1, le=400, description="At most so many in a picture, those with the highest scores."
    )


class SmallDetector:
    """Finds the catalogue's assets in pictures of any size.

    A picture is worked on as it is, never resized: an object has the same pixels in a small picture and in a large one,
    and time grows with the area.
    """

    def __init__(self, model: NetworkModel, options: SmallDetectorOptions) -> None:
        self._model, self._options = model, options

    @property
    def version(self) -> str:
        """The digests of the weights and of the OpenCV that computes with them."""
        return f"weights {self._model.document.weights_sha256[:12]}, {opencv_build()}"

    def detect(self, bgr: Pixels) -> tuple[Detection, ...]:
        """What is in the picture, highest score first.

        A score is the probability that there is an object of this label, so it is low where an object is plain to see
        and its class is not.
        """
        peaks = self._model.find(bgr, self._options.min_object)
        peaks = peaks.pick(without_duplicates(peaks.boxes_px, _MOST_OVERLAP))
        labels = self._model.label_shares(peaks)
        best = labels.argmax(axis=1)
        scores = self._model.object_shares(peaks) * labels[np.arange(len(best)), best]
        names = self._model.document.labels
        # A peak in the continuation of the picture has no box in it.
        return surest_detections(
            [names[number] for number in best.tolist()],
            scores,
            peaks.boxes_px,
            (bgr.shape[1], bgr.shape[0]),
            None,
            self._options.max_detections,
        )


def open_small_detector(simspec: SimSpec) -> SmallDetector:
    """The entry point `small` of group `rebar.detectors`. OpenCV uses one thread in the whole process from then on."""
    use_one_thread()
    return SmallDetector(load_model(), read_options(simspec, SmallDetectorOptions))
