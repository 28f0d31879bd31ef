"""The plug-in for ONNX files of others, and what adapters of other networks share (docs/detectors.md).

detector = open_onnx_detector(simspec)
detections = detector.detect(frame.bgr)

What it needs (OpenCV, onnxruntime) is imported when a detector opens, not before.
"""

from __future__ import annotations

from ._onnx import OnnxDetector as OnnxDetector
from ._onnx import OnnxOptions as OnnxOptions
from ._onnx import open_onnx_detector as open_onnx_detector
from ._options import file_digest as file_digest
from ._options import option_fault as option_fault
from ._options import read_options as read_options
from ._options import require_class_labels as require_class_labels
from ._options import surest_detections as surest_detections
