"""The built page is that of its sources, is small, and names nothing outside."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

VIEW = Path(__file__).parents[2] / "bench" / "view"
MAX_BYTES = 250_000


@pytest.mark.skipif(
    shutil.which("node") is None or not (VIEW / "app" / "node_modules").is_dir(),
    reason="needs node and bench/view/app/node_modules: make view",
)
def test_the_page_is_built_from_its_sources(tmp_path: Path) -> None:
    subprocess.run(["node", "build.mjs", str(tmp_path / "app.js")], cwd=VIEW / "app", check=True)
    for name in ("app.js", "LICENSES.txt"):
        assert (tmp_path / name).read_bytes() == (VIEW / "static" / name).read_bytes(), "run make view"


def test_the_page_is_small_and_asks_nobody_else() -> None:
    """Addresses in it are names of namespaces and pages in messages of its parts; none is fetched: the browser's tests see that."""
    text = (VIEW / "static" / "app.js").read_text(encoding="utf-8")
    assert len(text.encode()) < MAX_BYTES
    assert set(re.findall(r"https?://([^/\"'` )]+)", text)) <= {"www.w3.org", "mcap.dev", "github.com"}


def test_the_lock_names_no_registry() -> None:
    lock = json.loads((VIEW / "app" / "package-lock.json").read_text(encoding="utf-8"))
    packages = {name: entry for name, entry in lock["packages"].items() if name}
    assert len(packages) > 5
    assert not [name for name, entry in packages.items() if "resolved" in entry or "integrity" not in entry]
    stated = json.loads((VIEW / "app" / "package.json").read_text(encoding="utf-8"))
    for name, version in (stated["dependencies"] | stated["devDependencies"]).items():
        assert packages[f"node_modules/{name}"]["version"] == version
