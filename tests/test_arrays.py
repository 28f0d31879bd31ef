"""The product of small arrays: that of NumPy, with the bits of sums written out."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import bench
from bench.arrays import Floats, Narrow, product

# Every form that a flight or a picture uses, and stacks of both.
SHAPES = [
    ((3,), (3,)),
    ((5, 3), (3,)),
    ((4, 6, 3), (3,)),
    ((3,), (3, 4)),
    ((7, 3), (3, 3)),
    ((8, 3), (5, 3, 3)),
    ((5, 9, 3), (5, 3, 3)),
    ((5, 2, 2), (5, 2, 1)),
    ((4, 4), (4, 4)),
    ((6, 1), (1, 2)),
    ((0, 3), (3, 3)),
]


@pytest.mark.parametrize(("first", "second"), SHAPES)
def test_a_product_is_that_of_numpy(first: tuple[int, ...], second: tuple[int, ...]) -> None:
    draw = np.random.default_rng(len(first) * 10 + len(second))
    for _ in range(20):
        a, b = draw.normal(size=first), draw.normal(size=second)
        assert np.shape(product(a, b)) == np.shape(a @ b)
        np.testing.assert_allclose(product(a, b), a @ b, rtol=0.0, atol=1e-13)


def test_each_element_is_summed_from_the_first_term_to_the_last() -> None:
    """Bit for bit what plain Python adds, which no fused multiply-add rounds otherwise."""
    draw = np.random.default_rng(5)
    a, b = draw.normal(size=(50, 3)), draw.normal(size=(3, 40))
    rows, columns = a.tolist(), b.T.tolist()
    sums = [[(x * u + y * v) + z * w for u, v, w in columns] for x, y, z in rows]
    assert product(a, b).tolist() == sums
    assert product(a, b[:, 0].copy()).tolist() == [row[0] for row in sums]


def test_a_narrow_product_stays_narrow() -> None:
    wide: Floats = np.linspace(0.1, 0.9, 12).reshape(4, 3)
    narrow: Narrow = wide.astype(np.float32)
    assert product(narrow, narrow[0]).dtype == np.float32
    assert math.isclose(float(product(narrow, narrow[0])[1]), float(product(wide, wide[0])[1]), rel_tol=1e-6)


ROOT = Path(bench.__file__).parents[1]
# What a session in lockstep computes. The rest of bench/camera/ is OpenGL, whose driver rounds as it likes, and sheets.
FLOWN = [
    *ROOT.glob("bench/simulation/**/*.py"),
    *ROOT.glob("bench/contracts/*.py"),
    *(path for path in ROOT.glob("bench/camera/*.py") if path.name != "sheet.py"),
    *ROOT.glob("bench/perception/*.py"),
    *ROOT.glob("vehicle_models/**/*.py"),
]
BLAS = {"dot", "vdot", "inner", "matmul", "tensordot", "linalg", "matvec", "vecmat", "vecdot", "polyfit"}


def test_no_flight_calls_blas() -> None:
    """OpenBLAS rounds as its kernel for the processor does: with it, equal sessions differ between processors."""
    assert len(FLOWN) > 100
    assert [
        f"{path.relative_to(ROOT)}:{line}" for path in FLOWN for line in blas_lines(path.read_text())
    ] == []
    assert sorted(blas_lines("a @ b\nnp.linalg.norm(c)\na @= b\nx.dot(y)\n")) == [1, 2, 3, 4]


def blas_lines(text: str) -> Iterator[int]:
    """Lines with a matrix product or another call of BLAS."""
    for node in ast.walk(ast.parse(text)):
        operator = isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult)
        if operator or (isinstance(node, ast.Attribute) and node.attr in BLAS):
            assert isinstance(node, ast.expr | ast.stmt)
            yield node.lineno
