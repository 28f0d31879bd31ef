"""An error model fitted to recordings: the detections of a run against the truth about its frames."""

from __future__ import annotations

from ._document import DetectorFit as DetectorFit
from ._fit import fit_detector as fit_detector
