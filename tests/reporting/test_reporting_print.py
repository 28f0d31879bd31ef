"""The report on paper, in a browser: whatever a screen shows on request is printed, and put away afterwards."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import made_campaign
import pytest
from made_campaign import AGENTS, Made, make_campaign

from bench.reporting import write_report

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
# Notes what is shown before printing, on paper and afterwards, where the DOM that is dumped holds it.
OBSERVER = """
<script>
const shown = () => [...document.querySelectorAll(".mapbox")].filter((box) => !box.hidden).map((box) => box.id);
window.addEventListener("load", () => {
  const state = [shown().join(" ")];
  window.dispatchEvent(new Event("beforeprint"));
  setTimeout(() => {
    state.push(shown().join(" "), String(new Set([...document.querySelectorAll(
      ".mapbox:not([hidden]) .figure > svg")].map((svg) => svg.closest(".mapbox").id)).size));
    window.dispatchEvent(new Event("afterprint"));
    state.push(shown().join(" "));
    document.body.dataset.states = state.join("|");
  }, 0);
});
</script>
"""


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_every_map_is_printed(tmp_path: Path) -> None:
    """Two runs have a map: a screen shows the first, paper both with their figures, then the screen the first again."""
    folder = make_campaign(tmp_path / "campaign", Made(scenes=1))
    for agent in AGENTS:
        simspec = made_campaign.made_simspec(0, agent)
        path = folder / "runs" / f"p000-r0-{agent}" / "recording.mcap"
        made_campaign.write_recording(path, simspec, made_campaign.made_tape(simspec))
    page = write_report(folder).read_text()
    # The page allows no script but its own.
    page, count = re.subn(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page)
    assert count == 1
    (tmp_path / "report.html").write_text(page.replace("</body>", f"{OBSERVER}</body>"))
    dom = subprocess.run(
        [
            *(
                str(CHROMIUM),
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--no-first-run",
                "--disable-sync",
            ),
            *("--disable-background-networking", "--disable-component-update"),
            *(f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=5000"),
            *("--dump-dom", f"file://{tmp_path / 'report.html'}"),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout
    states = re.search(r'data-states="([^"]*)"', dom)
    assert states is not None
    boxes = re.findall(r'<div class="mapbox" id="([^"]+)"', dom)
    assert len(boxes) == 2
    assert states[1].split("|") == [boxes[0], " ".join(boxes), "2", boxes[0]]
