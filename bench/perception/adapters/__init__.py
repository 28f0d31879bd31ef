"""Plug-ins for detectors of others: ONNX files, and Grounding DINO with SAM (docs/detectors.md).

detector = open_onnx_detector(simspec)  # or open_grounded_detector
detections = detector.detect(frame.bgr)

What they need (OpenCV, onnxruntime, torch and transformers) is imported when a detector opens, not before.
"""

from __future__ import annotations

from ._grounded import GroundedDetector as GroundedDetector
from ._grounded import GroundedOptions as GroundedOptions
from ._grounded import open_grounded_detector as open_grounded_detector
from ._onnx import OnnxDetector as OnnxDetector
from ._onnx import OnnxOptions as OnnxOptions
from ._onnx import open_onnx_detector as open_onnx_detector
