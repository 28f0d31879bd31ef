"""Places scenes and writes their realized SimSpecs, without flying them.

Many scenes are shared between processes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import groupby
from pathlib import Path

from bench.documents import dump_json
from bench.realization import PlacementInfeasible, RealizationPlan, place

from ..execution._parallel import map_in_processes
from ..storage._files import write_whole
from ..storage._folder import CampaignFolder

FEW_SCENES = 200
"""With fewer scenes one process is done before a second one has started."""

_BATCHES_PER_PROCESS = 8
"""More than one, so that the other processes do not wait for the slowest batch. Chosen, not measured."""

Scene = Sequence[RealizationPlan]


def write_scenes(
    plans: Sequence[RealizationPlan], folder: CampaignFolder, workers: int = 1
) -> dict[str, str]:
    """Write the realized SimSpec of every plan for which there is room: the same bytes for any number of
    workers.

    Returns the reasons of the plans that have no room, by id. Raises as `place` does.
    """
    scenes = [
        list(scene) for _, scene in groupby(plans, key=lambda plan: (plan.design_point, plan.replicate))
    ]
    if workers == 1 or len(scenes) < FEW_SCENES:
        return _write(scenes, folder.path)
    size = -(-len(scenes) // (workers * _BATCHES_PER_PROCESS))
    batches = [scenes[start : start + size] for start in range(0, len(scenes), size)]
    reasons: dict[str, str] = {}
    for batch_reasons in map_in_processes(partial(_write, path=folder.path), batches, workers):
        reasons |= batch_reasons
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
            write_whole(
                folder.simspec(plan.id), dump_json(plan.simspec.model_copy(update={"realized": realized}))
            )
    return reasons
