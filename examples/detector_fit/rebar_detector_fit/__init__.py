"""An error model fitted to recordings: the detections of a run against the truth about its frames.

It joins the bench from outside: the command `rebar fit-detector`, and the document that this writes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._document import DetectorFit as DetectorFit
    from ._fit import fit_detector as fit_detector

# `rebar --help` imports the command: it shall not wait for SciPy.
__getattr__ = lazy_names(__name__)
