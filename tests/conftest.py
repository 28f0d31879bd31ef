"""Markers by place, so that a test says by its folder or file what it costs; `pytest -m "not flight"` leaves
whole flights out.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from leftovers import Leftovers
from real_table import RealTable

HERE = Path(__file__).parent

# A test must not fail because the host is busy: no deadline for an example, and slow drawing of data is no
# fault.
settings.register_profile("any host", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any host")

# A folder, or the beginning of a file's path below tests/, and the marker of every test in it.
MARKED_PLACES = {
    "agent_adapters/test_full_campaign": "flight",
    "agent_adapters/test_agent_flight": "flight",
    "agent_adapters/test_agent_mission": "flight",
    "agent_adapters/test_agent_process": "process",
    "campaign/test_campaign_runner": "process",
    "campaign/test_campaign_flight": "flight",
    "cli/": "process",
    "clients/": "flight",
    "plugins/": "process",
    "simulation/test_session": "flight",
    "vehicle_models/": "flight",
}


def pytest_configure(config: pytest.Config) -> None:
    """A run leaves nothing among the temporary files. One of real autopilots ends with a table."""
    config.pluginmanager.register(Leftovers(config))
    if config.option.markexpr == "real":
        config.pluginmanager.register(RealTable())


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test by its place."""
    for item in items:
        place = item.path.relative_to(HERE).as_posix()
        for beginning, marker in MARKED_PLACES.items():
            if place.startswith(beginning):
                item.add_marker(marker)
