"""Names for the kinds of NumPy arrays that the bench computes with, and a product of small ones.

Shapes stand in the docstrings of their users.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Narrow = NDArray[np.float32]
Bools = NDArray[np.bool_]
Counts = NDArray[np.int64]
Seeds = NDArray[np.uint64]
Objects = NDArray[np.object_]

Real = TypeVar("Real", Floats, Narrow)


def product(first: Real, second: Real) -> Real:
    """`first @ second` without BLAS: the same bits on every processor.

    first (..., n, k) or (k,), second (..., k, m) or (k,). Each element is summed from the first term to the last. For sums
    of a few terms, which flights and pictures are made of: OpenBLAS adds and rounds them as its kernel for the processor
    does. `np.einsum` calls no BLAS either, unless it is asked to optimize.
    """
    if second.ndim == 1:
        total: Real = first[..., 0] * second[0]
        for term in range(1, len(second)):
            total = total + first[..., term] * second[term]
        return total
    if first.ndim == 1:
        return product(second.T, first)
    total = first[..., 0, None] * second[..., None, 0, :]
    for term in range(1, second.shape[-2]):
        total += first[..., term, None] * second[..., None, term, :]
    return total
