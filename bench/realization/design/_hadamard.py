"""Hadamard, Jacobsthal and conference matrices, on which screening designs rest.

Paley, R. E. A. C. (1933), "On orthogonal matrices", Journal of Mathematics and Physics 12, 311-320.
"""

from __future__ import annotations

import itertools

import numpy as np

from bench.arrays import Counts


def conference_matrix(order: int) -> Counts | None:
    """C with 0 on the diagonal, else -1 and +1, and C'C = (order - 1) I; None where none is constructed."""
    field = _jacobsthal_matrix(order - 1)
    if field is not None:
        # Symmetric for a field of 4 k + 1 elements, else skew-symmetric: -1 is a square only in the former.
        border = 1 if (order - 1) % 4 == 1 else -1
        square = np.ones((order, order), dtype=np.int64)
        square[0, 0], square[1:, 0], square[1:, 1:] = 0, border, field
        return square
    # A doubling for skew-symmetric matrices, tried when Paley's construction does not apply.
    half = conference_matrix(order // 2) if order % 4 == 0 else None
    if half is None or not np.array_equal(half.T, -half):
        return None
    unit = np.eye(order // 2, dtype=np.int64)
    return np.block([[half, half + unit], [half - unit, -half]])


def hadamard_matrix(order: int) -> Counts | None:
    """A Hadamard matrix, first row and column +1 up to sign; None where neither Paley nor doubling gives one.

    From Paley's first kind the rest of it is cyclic, with the rows that Plackett and Burman printed for 8,
    12, 20 and 24 runs.
    """
    if order in (1, 2):
        return np.array([[1, 1], [1, -1]], dtype=np.int64)[:order, :order]
    prime = order - 1
    # The first kind goes first: its cyclic rows are those that tables of Plackett-Burman designs print.
    if prime % 4 == 3 and _is_prime(prime):
        square = np.ones((order, order), dtype=np.int64)
        residues = _quadratic_character(prime)
        residues[0] = 1
        square[:-1, 1:] = -np.array([np.roll(residues, turn) for turn in range(prime)])
        return square
    if order % 2 == 0 and (half := hadamard_matrix(order // 2)) is not None:
        return np.block([[half, half], [half, -half]])
    field = _jacobsthal_matrix(order // 2 - 1) if order % 4 == 0 and (order // 2 - 1) % 4 == 1 else None
    if field is None:
        return None
    core = np.pad(field, ((1, 0), (1, 0)), constant_values=1)
    core[0, 0] = 0
    unit = np.eye(order // 2, dtype=np.int64)
    return np.block([[core + unit, core - unit], [core - unit, -core - unit]])


def _jacobsthal_matrix(size: int) -> Counts | None:
    """Jacobsthal's matrix of the field of an odd prime or its square: +1 where a difference is a square, else -1, and 0 on
    the diagonal. Elements are a + b x with x x = n, no square of the prime's field; of a prime's own field b is 0.
    """
    root = round(size**0.5)
    prime = root if root * root == size else size
    # Fields of higher prime powers (27, 125) have no construction here.
    if prime == 2 or not _is_prime(prime):
        return None
    # Any non-square will do; the smallest makes the matrix the same every time.
    odd = int(np.flatnonzero(_quadratic_character(prime) < 0)[0])
    pairs = list(itertools.product(range(prime), range(size // prime)))
    signs = np.full((prime, size // prime), -1, dtype=np.int64)
    for a, b in pairs:
        signs[(a * a + odd * b * b) % prime, 2 * a * b % prime] = 1
    signs[0, 0] = 0
    return np.array([[signs[(a - c) % prime, (b - d) % prime] for a, b in pairs] for c, d in pairs])


def _quadratic_character(prime: int) -> Counts:
    """For each remainder 0, or +1 where it is a square, else -1."""
    signs = np.full(prime, -1, dtype=np.int64)
    signs[[n * n % prime for n in range(1, prime)]] = 1
    signs[0] = 0
    return signs


def _is_prime(number: int) -> bool:
    return number > 1 and all(number % factor for factor in range(2, int(number**0.5) + 1))
