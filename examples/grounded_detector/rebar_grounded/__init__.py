"""Grounding DINO with SAM as a detector of the bench, from outside."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._detector import GroundedDetector as GroundedDetector
    from ._detector import open_grounded_detector as open_grounded_detector
    from ._options import GroundedOptions as GroundedOptions

# torch and transformers take seconds to import.
__getattr__ = lazy_names(__name__)
