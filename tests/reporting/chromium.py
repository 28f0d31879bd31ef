"""A page as Chromium makes it, for tests of the scripts in it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

_CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(_CHROMIUM is None, reason="no Chromium on this machine")
_OPTIONS = (
    "headless no-sandbox disable-gpu disable-quic no-first-run disable-sync disable-background-networking "
    "disable-component-update window-size=1280,900 virtual-time-budget=5000"
)


def dom_of(page: str, folder: Path, fragment: str = "") -> str:
    """The document once its scripts have run. The page and the browser's profile are written to `folder`."""
    path = folder / "browsed.html"
    path.write_text(page)
    options = [f"--{option}" for option in _OPTIONS.split()]
    command = [str(_CHROMIUM), *options, f"--user-data-dir={folder / 'profile'}", "--dump-dom"]
    return subprocess.run(
        [*command, f"file://{path}{fragment}"], capture_output=True, text=True, timeout=120, check=True
    ).stdout


def with_script(page: str, script: str) -> str:
    """The page with one more script at its end."""
    # The page allows no script but its own.
    page, count = re.subn(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page)
    assert count == 1
    return page.replace("</body>", f"<script>{script}</script></body>")
