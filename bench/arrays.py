"""Names for the kinds of NumPy arrays that the bench computes with.

Shapes stand in the docstrings of their users.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Narrow = NDArray[np.float32]
Bools = NDArray[np.bool_]
Counts = NDArray[np.int64]
Seeds = NDArray[np.uint64]
Objects = NDArray[np.object_]
