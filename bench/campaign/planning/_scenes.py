"""Places scenes and writes their realized SimSpecs, without flying them.

Many scenes are shared between processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path

from bench.documents import dump_json
from bench.realization import PlacementInfeasible, RealizationPlan, place

from .._parallel import open_helpers
from ..storage._files import sync_files_below, write_whole
from ..storage._folder import CampaignFolder

FEW_SCENES = 200
"""With fewer scenes one process is done before a second one has started."""

_BATCHES_PER_PROCESS = 32
"""Small batches: whoever is done first waits for the others, which may have two of them. Chosen, not measured."""

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
    """Write the realized SimSpec of every plan for which there is room: the same bytes for any number of workers.

    `with_infeasible` also writes the SimSpecs of plans that have no room, without places. Plans of one scene follow each
    other, else it is placed again. Raises as `place` does.
    """
    with open_scene_writer(plans, folder, workers, with_infeasible=with_infeasible) as write:
        return write()


@contextmanager
def open_scene_writer(
    plans: Sequence[RealizationPlan],
    folder: CampaignFolder,
    workers: int = 1,
    *,
    with_infeasible: bool = False,
) -> Iterator[Callable[[], WrittenScenes]]:
    """Yield what writes the scenes, as `write_scenes` does. For many scenes, other processes start at once: they import
    while the caller does what comes before. Nothing is written to the folder before.
    """
    scenes = [
        list(scene) for _, scene in groupby(plans, key=lambda plan: (plan.design_point, plan.replicate))
    ]
    if len(scenes) < FEW_SCENES:
        workers = 1
    size = max(1, -(-len(scenes) // (workers * _BATCHES_PER_PROCESS)))
    batches = [scenes[start : start + size] for start in range(0, len(scenes), size)]
    job = partial(_write, path=folder.path, with_infeasible=with_infeasible)
    # This process places as well.
    with open_helpers(min(workers, len(batches)) - 1, partial(job, [])) as helpers:

        def write() -> WrittenScenes:
            placed = helpers.share(job, batches)
            # They end while the files become safe.
            helpers.dismiss()
            return _joined(placed, folder)

        yield write


def _joined(batches: Iterable[WrittenScenes], folder: CampaignFolder) -> WrittenScenes:
    written = WrittenScenes({}, {})
    for batch in batches:
        written.digests.update(batch.digests)
        written.infeasible.update(batch.infeasible)
    if written.digests:
        sync_files_below(folder.path / "simspecs")
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
