"""The detector on pixels that ships, a small network through OpenCV: docs/pixel-detector.md.

detector = open_small_detector(simspec)
detections = detector.detect(frame.bgr)

Imports cv2, so import this room where pixels are worked on, and nowhere else.
"""

from __future__ import annotations

from ._detector import SmallDetector as SmallDetector
from ._detector import SmallDetectorOptions as SmallDetectorOptions
from ._detector import open_small_detector as open_small_detector
from ._model import NetworkModel as NetworkModel
from ._model import load_model as load_model
