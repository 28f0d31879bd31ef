"""Surrogates of the reference agents for `fidelity: overhead`: a ground plan, thousands of missions a second.

    batch = pack([place(simspec) for simspec in simspecs])
    observed = observe(batch, {"OBS-204": ("mission_flown", {})})
    observed.of(0)  # the observations of the first mission, as the scorer takes them

docs/fidelity.md says what it leaves out and how well it predicts the full simulation.
"""

from __future__ import annotations

from ._observe import Measures as Measures
from ._observe import Observed as Observed
from ._observe import ReferenceSurrogate as ReferenceSurrogate
from ._observe import computed as computed
from ._observe import observe as observe
from ._observe import reference_surrogate as reference_surrogate
from .batch._batch import Batch as Batch
from .batch._batch import pack as pack
from .batch._unfit import BYSTANDER_AWARE as BYSTANDER_AWARE
from .batch._unfit import unfit as unfit
