"""Four times the runs are four times the work, for their scores and for the rows of the report."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from growth import lines_of, steep
from made_campaign import AGENTS, Made, make_campaign

from bench.reporting import load_report_data

SCENES = 6


def test_scores_and_rows_grow_with_the_runs(tmp_path: Path) -> None:
    made, read = [], []
    for scenes in (1, SCENES, 4 * SCENES):
        folder = tmp_path / str(scenes)
        made.append(lines_of(partial(make_campaign, folder, Made(scenes=scenes))))
        read.append(lines_of(partial(load_report_data, folder)))
    runs = SCENES * len(AGENTS)
    assert steep(made[1], made[2], runs) == {}
    assert steep(read[1], read[2], runs) == {}
