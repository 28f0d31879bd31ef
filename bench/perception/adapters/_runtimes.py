"""What computes an ONNX network: OpenCV, which the bench has anyway, or onnxruntime, which knows more operators."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np

from bench.arrays import Narrow
from bench.errors import DetectorFault

from ._options import option_fault


class Runtime(Protocol):
    """A loaded network."""

    @property
    def version(self) -> str:
        """Of the library that computes."""

    def run(self, pictures: Narrow) -> dict[str, Narrow]:
        """Every result by its name, for (1, 3, h, w) pictures. Raises DetectorFault when it cannot be computed."""


def open_runtime(name: str, weights: Path) -> Runtime:
    """Load a network. Raises SetupError when the file is no network, or the library is not installed."""
    return OnnxRuntime(weights) if name == "onnxruntime" else OpenCvRuntime(weights)


class OpenCvRuntime:
    """Not for two threads at a time: OpenCV keeps what it works on."""

    def __init__(self, weights: Path) -> None:
        import cv2

        from bench.camera import opencv_build

        try:
            # Read here and not by OpenCV, which tells no more of a file than that it could not be parsed.
            self._net = cv2.dnn.readNetFromONNX(np.frombuffer(weights.read_bytes(), np.uint8))
        except cv2.error as error:
            raise option_fault(
                "weights",
                f"OpenCV cannot read {weights} as an ONNX network: {_first_line(error)}",
                "export it with fixed sizes and without operators of its own, or set runtime: onnxruntime",
            ) from error
        self._names = list(self._net.getUnconnectedOutLayersNames())
        self._error = cv2.error
        self.version = opencv_build()

    def run(self, pictures: Narrow) -> dict[str, Narrow]:
        try:
            self._net.setInput(pictures)
            results = self._net.forward(self._names)
        except self._error as error:
            raise DetectorFault(
                f"OpenCV cannot compute the network for an input of {pictures.shape}: {_first_line(error)}"
            ) from error
        return {
            name: np.asarray(result, np.float32) for name, result in zip(self._names, results, strict=True)
        }


class OnnxRuntime:
    """On the CPU and one thread: sessions already run one on each core, and sums keep their order."""

    def __init__(self, weights: Path) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise option_fault(
                "runtime",
                "onnxruntime is not installed",
                "install it (pip install onnxruntime), or leave runtime out for OpenCV",
            ) from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        # Its warnings would go to the worker's standard error in every session.
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(
                str(weights), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime's errors have no root but Exception
            raise option_fault(
                "weights",
                f"onnxruntime cannot read {weights}: {_first_line(error)}",
                "give an ONNX file with its weights inside",
            ) from error
        inputs = self._session.get_inputs()
        if len(inputs) != 1:
            raise option_fault(
                "weights",
                f"the network reads {len(inputs)} inputs ({', '.join(put.name for put in inputs)})",
                "export it with the picture as its only input",
            )
        self._input = inputs[0].name
        # torchvision's detectors take a list of pictures, so an export of one has no axis for the batch.
        self._single = len(inputs[0].shape) == 3
        self._names = [output.name for output in self._session.get_outputs()]
        self.version = f"onnxruntime {onnxruntime.__version__}"

    def run(self, pictures: Narrow) -> dict[str, Narrow]:
        try:
            results = self._session.run(None, {self._input: pictures[0] if self._single else pictures})
        except Exception as error:  # as above
            raise DetectorFault(
                f"onnxruntime cannot compute the network for an input of {pictures.shape}: {_first_line(error)}"
            ) from error
        return {
            name: np.asarray(result, np.float32) for name, result in zip(self._names, results, strict=True)
        }


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0][:300] if lines else type(error).__name__
