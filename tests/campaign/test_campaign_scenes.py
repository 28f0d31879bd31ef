"""Scenes written without being flown: judged, the same by one process and by several, and refused where judge
and places differ.
"""

from __future__ import annotations

import math
import multiprocessing
import multiprocessing.connection
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest
from campaign_fakes import Script, small_campaign

from bench.campaign import (
    CampaignAgent,
    CampaignFolder,
    load_measurable_decomposition,
    open_journal,
    write_scenes,
)
from bench.campaign._parallel import WorkersUnusable, open_helpers
from bench.campaign.execution._flight import fly_here
from bench.campaign.planning._plan import plan_campaign
from bench.campaign.storage._files import digest_of
from bench.contracts import Outcome
from bench.documents import dump_json, validate_document
from bench.errors import Fault, SetupError
from bench.realization import Design, PlacementUnsound, check_placement, place, realize
from bench.simspec import AgentSpec, SimSpec

AREA = {"corners": [{"east_m": e, "north_m": n} for e, n in ((0, 0), (60, 0), (60, 60), (0, 60))]}


def base(**placement: Any) -> SimSpec:
    people = {"id": "people", "asset": "civilian", "role": "bystander", "count": 2, "placement": placement}
    return validate_document({"name": "yard", "world": {"area": AREA}, "actors": [people]}, SimSpec)


def written(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted((folder / "simspecs").iterdir())}


def test_any_number_of_workers_writes_the_same(tmp_path: Path) -> None:
    """Two processes write what one does, tell the same scenes apart as having no room, and all of it passes the check."""
    spread = {"name": "spread", "levels": [2.0, 200.0], "sets": ["actors[people].placement.spread_m"]}
    design = validate_document({"factors": [spread], "seed": 3, "replicates": 110}, Design)
    plans = realize(
        base(spread_m=1.0), design, [AgentSpec(), AgentSpec(manifest="reference-bystander-aware")]
    )

    alone = write_scenes(plans, CampaignFolder(tmp_path / "one"), 1)
    together = write_scenes(plans, CampaignFolder(tmp_path / "two"), 2)

    assert together == alone
    assert len(alone.infeasible) == 220
    assert all("proved" in reason for reason in alone.infeasible.values())
    assert written(tmp_path / "two") == written(tmp_path / "one")
    assert len(written(tmp_path / "one")) == 220
    for text in list(written(tmp_path / "one").values())[:5]:
        assert check_placement(SimSpec.model_validate_json(text)) == []


def test_places_that_come_along_are_judged_before_they_are_flown(tmp_path: Path) -> None:
    """A realized SimSpec in which somebody was moved is refused with what it breaks, and nothing is flown."""
    placed = place(base(near=None))
    assert placed.realized is not None
    first, second = placed.realized.actors
    onto = second.model_copy(update={"east_m": first.east_m, "north_m": first.north_m})
    broken = placed.model_copy(
        update={"realized": placed.realized.model_copy(update={"actors": (first, onto)})}
    )

    result = fly_here(broken, load_measurable_decomposition("search-and-report"), tmp_path / "run", "x")

    assert result.outcome is Outcome.SETUP_INVALID
    assert "people-1 and people-2: are 0.000 m apart" in result.reason
    assert not (tmp_path / "run" / "recording.mcap").exists()


def test_judge_and_places_that_disagree_are_a_fault_of_the_bench(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such a scene is neither handed out nor written, and the error names what is broken."""
    import bench.realization.placement._placement as placement

    monkeypatch.setattr(
        placement, "check_placement", lambda _: [Fault("realized: people-1", "stands outside its region")]
    )
    plans = realize(base(), validate_document({"factors": [], "seed": 1}, Design), [AgentSpec()])

    with pytest.raises(PlacementUnsound, match=r"broke its rules in .*people-1: stands outside its region"):
        write_scenes(plans, CampaignFolder(tmp_path), 1)
    assert not (tmp_path / "simspecs").exists()


def test_judge_answers_for_actors_of_no_group() -> None:
    """A stray actor in the places is a fault, not a crash, also where sight is looked along."""
    placed = place(base(visible_from={"point": {"east_m": 1.0, "north_m": 1.0}}))
    assert placed.realized is not None
    stray = placed.realized.actors[0].model_copy(update={"id": "stray-1", "group": "stray", "east_m": 50.0})
    known = placed.realized.actors
    more = placed.model_copy(
        update={"realized": placed.realized.model_copy(update={"actors": (*known, stray)})}
    )

    assert "realized: group stray: has 1 members (0 are required)" in [
        str(fault) for fault in check_placement(more)
    ]
    assert dump_json(more)


_SCRIPT = """
import math
from bench.campaign._parallel import map_in_processes
print(map_in_processes(math.sqrt, [4.0, 9.0], 2))
"""


def test_a_script_without_a_guard_may_use_several_processes(tmp_path: Path) -> None:
    """multiprocessing would run the script again in each of them, and refuse."""
    (tmp_path / "script.py").write_text(_SCRIPT)
    done = subprocess.run([sys.executable, str(tmp_path / "script.py")], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("[2.0, 3.0]\n", 0), done.stderr


def test_several_processes_plan_what_one_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The journals have the same digests, also where a scene has no room and a SimSpec was lost in between."""
    monkeypatch.setattr("bench.campaign.planning._scenes.FEW_SCENES", 1)
    spread = {"name": "spread", "levels": [2.0, 200.0], "sets": ["actors[people].placement.spread_m"]}
    campaign = small_campaign().model_copy(
        update={
            "base": base(spread_m=1.0),
            "design": validate_document({"factors": [spread], "seed": 3, "replicates": 2}, Design),
            "agents": (CampaignAgent(manifest="first"), CampaignAgent(manifest="second")),
        }
    )
    digests = []
    for workers in (1, 2, 2):
        folder = CampaignFolder(tmp_path / str(workers))
        with open_journal(folder.journal) as journal:
            plans = plan_campaign(campaign, folder, journal, cast(Any, Script()), workers=workers)
            digests.append([(entry.id, entry.simspec_sha256) for entry in journal.entries()])
        assert all(digest_of(folder.simspec(name)) == digest for name, digest in digests[-1])
        folder.simspec(plans[0].id).unlink()
        folder.simspec(plans[-1].id).write_text("{}")
    assert digests[0] == digests[1] == digests[2]
    assert len(digests[0]) == 8


def test_faults_before_takeoff_end_the_processes_that_were_to_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They import while the check looks; of a campaign that is refused nothing is written, and nobody stays."""
    monkeypatch.setattr("bench.campaign.planning._scenes.FEW_SCENES", 1)
    before = multiprocessing.active_children()
    placing: list[multiprocessing.process.BaseProcess] = []

    def check_takeoff(simspecs: object) -> list[Fault]:
        placing.extend(process for process in multiprocessing.active_children() if process not in before)
        return [Fault("agents", "the first is missing"), Fault("agents", "the second is missing")]

    folder = CampaignFolder(tmp_path / "out")
    with open_journal(tmp_path / "journal") as journal, pytest.raises(SetupError, match="second is missing"):
        plan_campaign(small_campaign(), folder, journal, cast(Any, Script()), check_takeoff, workers=2)

    assert [process.is_alive() for process in placing] == [False]
    assert not folder.path.exists()


def test_helpers_and_this_process_raise_what_one_process_raises() -> None:
    """All items in their order; of several that fail the first, whoever came upon it; and a helper that was killed."""
    with open_helpers(1, partial(math.sqrt, 1.0)) as helpers:
        assert helpers.share(int, [str(number) for number in range(40)]) == list(range(40))
        with pytest.raises(ValueError, match="'second'"):
            helpers.share(int, ["1", "second", *(["3"] * 20), "last"])
        processes = multiprocessing.active_children()
        helpers.dismiss()
        # Not `join`: a thread of the pool waits for it as well, and only one of them learns how it ended.
        assert multiprocessing.connection.wait([process.sentinel for process in processes])
    with pytest.raises(WorkersUnusable, match="was killed"), open_helpers(1, partial(os._exit, 3)) as helpers:
        helpers.share(int, ["1"] * 40)
    assert multiprocessing.active_children() == []
