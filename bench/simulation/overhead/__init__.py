"""The lowest fidelity: surrogates of the reference agents over a ground plan, thousands of missions a second.

    batch = pack([place(simspec) for simspec in simspecs])
    observed = observe(batch, {"OBS-204": ("mission_flown", {})})
    observed.of(0)  # the observations of the first mission, as the scorer takes them

docs/fidelity.md says what it leaves out and how well it foretells the full simulation.
"""

from __future__ import annotations

from ._batch import SURROGATES as SURROGATES
from ._batch import Batch as Batch
from ._batch import pack as pack
from ._batch import unfit as unfit
from ._observe import Asked as Asked
from ._observe import Observed as Observed
from ._observe import computed as computed
from ._observe import observe as observe
