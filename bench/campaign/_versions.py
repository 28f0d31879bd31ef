"""Versions of the software that results depend on, for recordings and manifests."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version

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
