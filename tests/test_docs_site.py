"""The site of the docs is built without a warning, holds the public faces, and asks nobody for anything."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MISSING = [name for name in ("furo", "myst_parser", "sphinx") if find_spec(name) is None]


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)} (make docs installs them)")
def test_the_site_is_whole(tmp_path: Path) -> None:
    site = tmp_path / "site"
    command = "-m sphinx --builder html --fail-on-warning --keep-going --quiet --conf-dir docs/site ."
    built = subprocess.run(
        [sys.executable, *command.split(), str(site)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (built.returncode, built.stderr) == (0, "")
    assert "docs/site/index.html" in (site / "index.html").read_text()
    start = (site / "docs" / "site" / "index.html").read_text()
    # Every page is reached from the start.
    for page in (*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")):
        address = page.relative_to(ROOT).with_suffix(".html")
        assert (site / address).exists()
        assert f"../../{address}".replace("../../docs/", "../") in start
    names = re.findall(r'id="([\w.]+)"', (site / "docs" / "site" / "api.html").read_text())
    for name in (
        "bench.contracts.Tape",
        "bench.contracts.Measure.__call__",
        "bench.streams.RosNode.publisher",
    ):
        assert name in names
    assert "agent_adapters.client.open_bench" in names
    for page in site.rglob("*.html"):
        assert not re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="https?:[^"]*"', page.read_text()), page
