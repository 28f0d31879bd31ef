"""Places scenes and writes their realized SimSpecs, without flying them.

Many scenes are shared between processes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path

from bench.documents import dump_json
from bench.realization import PlacementInfeasible, RealizationPlan, place

from ..execution._parallel import map_in_processes
from ..storage._files import sync_files_below, write_whole
from ..storage._folder import CampaignFolder

FEW_SCENES = 200
"""With fewer scenes one process is done before a second one has started."""

_BATCHES_PER_PROCESS = 8
"""More than one, so that the other processes do not wait for the slowest batch. Chosen, not measured."""

Scene = Sequence[RealizationPlan]


@dataclass(frozen=True, slots=True)
class WrittenScenes:
    """SHA-256 of each file that was written, and why the plans that have no room have none; both by id."""

    digests: dict[str, str]
    infeasible: dict[str, str]


def write_scenes(
    plans: Sequence[RealizationPlan],
    folder: CampaignFolder,
    workers: int = 1,
    *,
    with_infeasible: bool = False,
) -> WrittenScenes:
    """Write the realized SimSpec of every plan for which there is room: the same bytes for any number of
    workers.

    `with_infeasible` also writes the SimSpecs of plans that have no room, without places. Plans of one scene follow each
    other, else it is placed again. Raises as `place` does.
    """
    scenes = [
        list(scene) for _, scene in groupby(plans, key=lambda plan: (plan.design_point, plan.replicate))
    ]
    if len(scenes) < FEW_SCENES:
        workers = 1
    size = max(1, -(-len(scenes) // (workers * _BATCHES_PER_PROCESS)))
    batches = [scenes[start : start + size] for start in range(0, len(scenes), size)]
    written = WrittenScenes({}, {})
    job = partial(_write, path=folder.path, with_infeasible=with_infeasible)
    for batch in map_in_processes(job, batches, workers):
        written.digests.update(batch.digests)
        written.infeasible.update(batch.infeasible)
    if written.digests:
        sync_files_below(folder.path)
    return written


def _write(scenes: Sequence[Scene], path: Path, *, with_infeasible: bool) -> WrittenScenes:
    folder = CampaignFolder(path)
    written = WrittenScenes({}, {})
    for scene in scenes:
        try:
            realized = place(scene[0].simspec).realized
        except PlacementInfeasible as error:
            written.infeasible.update((plan.id, str(error)) for plan in scene)
            if not with_infeasible:
                continue
            realized = None
        for plan in scene:
            # All of them become safe from a power cut at once, when the last is written.
            written.digests[plan.id] = write_whole(
                folder.simspec(plan.id),
                dump_json(plan.simspec.model_copy(update={"realized": realized})),
                synced=False,
            )
    return written
