"""Perception: frames by the truth or an error model, and a tracker."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._box_tracks import TrackerSettings as TrackerSettings
    from ._detectors import open_detector as open_detector
    from ._detectors import open_detectors as open_detectors
    from ._draws import seeds_of_camera as seeds_of_camera
    from ._labels import false_labels as false_labels
    from ._labels import posterior_score as posterior_score
    from ._odds import DetectionOdds as DetectionOdds
    from ._picture_detector import PictureDetector as PictureDetector
    from ._tracker import BegunTracks as BegunTracks
    from ._tracker import KalmanTracker as KalmanTracker
    from ._tracker import ground_homography as ground_homography
    from ._tracker import ground_warp as ground_warp
    from ._tracks import TRACK_GAP_S as TRACK_GAP_S

__getattr__ = lazy_names(__name__)
