"""What the bench is made of, for recordings and manifests."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("rebar-bench", "jsbsim", "pymavlink", "eclipse-zenoh", "mcap", "zstandard", "numpy", "pydantic", "shapely")


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of every package that what is recorded depends on. The same on machines set up alike."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
