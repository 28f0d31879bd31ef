"""The table that `make real` ends with: what was asked of each real autopilot, how it ended, and what was measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

KINDS = ("px4", "ardupilot")
_measuring: list[pytest.Item] = []


def measured(what: str, value: object) -> None:
    """Add a figure of the test that runs."""
    for item in _measuring:
        item.user_properties.append((what, str(value)))


class RealTable:
    """A plug-in of pytest."""

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        _measuring[:] = [item]
        return (yield)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """As Markdown, so that it can be sent as it is."""
        rows: dict[str, dict[str, str]] = {}
        for outcome in ("passed", "failed", "error", "skipped"):
            for report in terminalreporter.stats.get(outcome, []):
                name, _, parameters = report.nodeid.rpartition("::")[2].partition("[")
                kind = next((kind for kind in KINDS if kind in parameters), "")
                rows.setdefault(name, {})[kind] = outcome
                for what, value in report.user_properties:
                    rows.setdefault(what, {})[kind] = value
        terminalreporter.write_sep("=", "real autopilots: please send this table")
        terminalreporter.write_line("| | PX4 | ArduCopter |\n| --- | --- | --- |")
        for what, values in rows.items():
            cells = " | ".join(values.get(kind, "not flown") for kind in KINDS)
            terminalreporter.write_line(f"| {what} | {cells} |")
