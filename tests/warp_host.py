"""What a host needs for `pace: warp`."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.errors import SetupError
from bench.simulation.warp._library import built_library


def library_or_skip() -> Path:
    """The library for warp; the test is skipped, with the reason, where it cannot be built."""
    try:
        return built_library()
    except SetupError as error:
        pytest.skip(str(error))
