"""Scenes placed and written without being flown: each once, whichever agents it is for, by several processes where there are many."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import groupby
from pathlib import Path

from bench.documents import dump_json
from bench.realization import PlacementInfeasible, RealizationPlan, place

from ..storage._folder import CampaignFolder, write_whole

FEW_SCENES = 200
"""Scenes that are placed sooner than a second process has begun."""

_SHARES = 8
"""Parts for each process, so that a slow one keeps nobody waiting for long."""

Scene = Sequence[RealizationPlan]


def write_scenes(plans: Sequence[RealizationPlan], folder: CampaignFolder, workers: int = 1) -> dict[str, str]:
    """Write the realized SimSpec of every plan that has room, the same bytes for any number of workers.

    Returns why the others have none, by their ids. Raises as `place`.
    """
    scenes = [list(scene) for _, scene in groupby(plans, key=lambda plan: (plan.design_point, plan.replicate))]
    if workers == 1 or len(scenes) < FEW_SCENES:
        return _write(scenes, folder.path)
    size = -(-len(scenes) // (workers * _SHARES))
    parts = [scenes[start : start + size] for start in range(0, len(scenes), size)]
    # Spawned, not forked: libraries that were imported here have threads of their own.
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        reasons: dict[str, str] = {}
        for some in pool.map(_write, parts, [folder.path] * len(parts)):
            reasons |= some
        return reasons


def _write(scenes: Sequence[Scene], path: Path) -> dict[str, str]:
    folder = CampaignFolder(path)
    reasons: dict[str, str] = {}
    for scene in scenes:
        try:
            realized = place(scene[0].simspec).realized
        except PlacementInfeasible as error:
            reasons |= {plan.id: str(error) for plan in scene}
            continue
        for plan in scene:
            write_whole(folder.simspec(plan.id), dump_json(plan.simspec.model_copy(update={"realized": realized})))
    return reasons
