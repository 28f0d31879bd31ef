"""Versions of the software that results depend on, for recordings and manifests, and the arithmetic of this host."""

from __future__ import annotations

import hashlib
import math
import platform
import random
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

PACKAGES = (
    "rebar-bench",
    "jsbsim",
    "pymavlink",
    "eclipse-zenoh",
    "mcap",
    "zstandard",
    "numpy",
    "pydantic",
    "shapely",
)


# Those by which glibc, OpenBLAS, NumPy, OpenCV and ONNX Runtime choose between their kernels.
_FEATURES = frozenset(
    [
        "sse4_1",
        "sse4_2",
        "avx",
        "avx2",
        "fma",
        "fma4",
        "avx512f",
        "avx512vl",
        "avx512_vnni",
        "avx512_vbmi2",
        "avx512_bf16",
        "amx_tile",
        "asimd",
        "asimdhp",
        "sve",
    ]
)
_CPU_INFO = Path("/proc/cpuinfo")


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of every package that recordings depend on."""
    installed = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            installed[package] = "not installed"
    return installed


@cache
def arithmetic() -> dict[str, str]:
    """What the last bits of numbers depend on here beside `versions`: processor, mathematical library, linear algebra.

    For results and manifests, not for recordings: two hosts that differ here often give the same recording, and it must
    then have the same digest.
    """
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return {
        "processor": " ".join((platform.machine(), *sorted(_FEATURES.intersection(_processor_flags())))),
        "libm": f"{' '.join(platform.libc_ver()).strip() or 'unknown'}, results {_libm_results()}",
        "blas": f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip(),
    }


def _processor_flags(cpu_info: Path = _CPU_INFO) -> list[str]:
    """The features that the kernel lists of the first core; none where it lists none."""
    try:
        with cpu_info.open(encoding="utf-8", errors="replace") as lines:
            return next((line.split() for line in lines if line.startswith(("flags", "Features"))), [])
    except OSError:
        return []


def _libm_results() -> str:
    """A digest of what the mathematical library answers: glibc has variants of its functions, one with fused
    multiply-adds, and takes one by the processor.
    """
    # The variants differ in some seven of 10,000 answers (glibc 2.36), so in about ten of these.
    draw = random.Random(0)
    values = [draw.uniform(-10.0, 10.0) for _ in range(4000)]
    results = [function(value) for function in (math.sin, math.cos, math.exp) for value in values]
    results += [math.pow(abs(base), power) for base, power in zip(values, reversed(values), strict=True)]
    return hashlib.sha256(np.array(results).tobytes()).hexdigest()[:8]
