"""The report on paper, in a browser: whatever a screen shows on request is printed, and put away afterwards."""

from __future__ import annotations

import re
from pathlib import Path

import made_campaign
from chromium import dom_of, needs_chromium, with_script
from made_campaign import AGENTS, Made, make_campaign

from bench.reporting import write_report

# Notes what is shown before printing, on paper and afterwards, where the DOM that is dumped holds it.
OBSERVER = """
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
"""


@needs_chromium
def test_every_map_is_printed(tmp_path: Path) -> None:
    """Two runs have a map: a screen shows the first, paper both with their figures, then the screen the first again."""
    folder = make_campaign(tmp_path / "campaign", Made(scenes=1))
    for agent in AGENTS:
        simspec = made_campaign.made_simspec(0, agent)
        path = folder / "runs" / f"p000-r0-{agent}" / "recording.mcap"
        made_campaign.write_recording(path, simspec, made_campaign.made_tape(simspec))
    dom = dom_of(with_script(write_report(folder).read_text(), OBSERVER), tmp_path)
    states = re.search(r'data-states="([^"]*)"', dom)
    assert states is not None
    boxes = re.findall(r'<div class="mapbox" id="([^"]+)"', dom)
    assert len(boxes) == 2
    assert states[1].split("|") == [boxes[0], " ".join(boxes), "2", boxes[0]]
