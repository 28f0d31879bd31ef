from __future__ import annotations

from pathlib import Path

import pytest
from client_programs import flown as flown


@pytest.fixture(autouse=True)
def folder_for_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MAVSDK leaves a folder among the temporary files whenever it ends; here it goes with the test's."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
