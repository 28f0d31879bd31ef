"""Before anything is flown: what is known to be wrong with a campaign is told, all of it at once; scenes are judged, written
the same by one process and by several, and refused where judge and places differ.
"""

from __future__ import annotations

import json
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
from campaign_fakes import JOB, Script, small_campaign
from in_process_executor import open_in_process

from bench.campaign import (
    Campaign,
    CampaignAgent,
    CampaignFolder,
    Collaborators,
    Jobs,
    RunOptions,
    load_measurable_decomposition,
    open_journal,
    run_campaign_sync,
    takeoff_faults,
    write_scenes,
)
from bench.campaign._parallel import WorkersUnusable, open_helpers
from bench.campaign.execution._flight import fly_here
from bench.campaign.planning._plan import plan_campaign
from bench.campaign.planning._realizations import realizations
from bench.campaign.storage._files import digest_of
from bench.cli._run_request import CampaignChanges
from bench.contracts import Outcome
from bench.documents import dump_json, dump_yaml, validate_document
from bench.errors import Fault, SetupError
from bench.realization import Design, DesignFactor, PlacementUnsound, check_placement, place, realize
from bench.simspec import ActorGroup, AgentSpec, SimSpec, VehicleSpec

MANIFEST = """
format: rebar.agent/1
name: {name}
command: [sh, "-c", "exit 0"]
pace: [{pace}]
zenoh: false
mavlink: [{{name: onboard, kind: udp_out, streams: {streams}}}]
"""


def manifest(folder: Path, name: str, pace: str = "lockstep", streams: str = "onboard") -> CampaignAgent:
    path = folder / f"{name}.yaml"
    path.write_text(MANIFEST.format(name=name, pace=pace, streams=streams))
    return CampaignAgent(manifest=str(path))


def campaign(*agents: CampaignAgent, **base: object) -> Campaign:
    made = small_campaign(points=2, replicates=2)
    assert made.base is not None
    situation = made.base.model_copy(update={"vehicle": VehicleSpec(model="still"), **base})
    return made.model_copy(update={"agents": agents, "base": situation})


VANS = ActorGroup.model_validate({"id": "cars", "asset": "van", "role": "bystander", "count": 1})
OPTIONS = RunOptions(Script(), workers=1)  # type: ignore[arg-type]


def test_all_faults_of_all_agents_come_at_once_and_nothing_is_placed(tmp_path: Path) -> None:
    """Two agents that cannot follow the pace, one that does not exist and one without its program: four
    faults, each once although every agent has four runs.
    """
    gone = manifest(tmp_path, "gone")
    path = Path(gone.manifest)
    path.write_text(path.read_text().replace("[sh,", "[no-such-program,"))
    agents = (
        manifest(tmp_path, "slow", "realtime"),
        manifest(tmp_path, "slower", "realtime"),
        CampaignAgent(manifest="no-such-agent"),
        gone,
    )
    with pytest.raises(SetupError) as refusal:
        run_campaign_sync(campaign(*agents), tmp_path / "out", OPTIONS)

    faults = [str(fault) for fault in refusal.value.faults]
    assert len(faults) == 4, faults
    for fault, name in zip(faults, ("'slow'", "'slower'", "no-such-agent", "no-such-program"), strict=True):
        assert name in fault
    assert "fly with --pace realtime" in faults[0]
    assert not (tmp_path / "out" / "simspecs").exists()


@pytest.mark.parametrize(
    ("base", "sets", "levels", "expected"),
    [
        # Two of three are no whole number of controller steps.
        ({}, "pace.tick_s", (0.1, 0.103, 0.11), ["0.103 s", "0.11 s"]),
        # Two of three were once found only when the scenes were placed.
        (
            {"actors": (VANS,)},
            "actors[cars].asset",
            ("van", "submarine", "zeppelin"),
            [f"actors[0].asset: there is no asset '{name}'" for name in ("submarine", "zeppelin")],
        ),
        # A vehicle is opened once to know its faults.
        ({"vehicle": VehicleSpec(model="zeppelin")}, "environment.fog_level", (0.0, 1.0), ["zeppelin"]),
        (
            {"vehicle": VehicleSpec(parameters={"NO_SUCH_PARAMETER": 1.0})},
            "environment.fog_level",
            (0.0, 1.0),
            ["NO_SUCH_PARAMETER"],
        ),
    ],
)
def test_every_level_of_a_factor_is_looked_at(
    tmp_path: Path, base: dict[str, Any], sets: str, levels: tuple[Any, ...], expected: list[str]
) -> None:
    """One fault for each level that cannot fly, or for what all of them have; the others would fly."""
    document = campaign(manifest(tmp_path, "agent"), **base)
    factor = DesignFactor(name="factor", levels=levels, sets=(sets,))
    design = document.design.model_copy(update={"factors": (factor,), "replicates": 1})
    document = document.model_copy(update={"design": design})
    faults = takeoff_faults(plan.simspec for plan in realizations(document))
    assert len(faults) == len(expected), faults
    assert all(words in str(fault) for words, fault in zip(expected, faults, strict=True))


def fly_fakes(folder: Path, document: Campaign) -> None:
    run_campaign_sync(
        document, folder, OPTIONS, Collaborators(jobs=Jobs(JOB), open_executor=open_in_process())
    )


def test_an_agent_with_a_pace_of_its_own_goes_before_the_campaign(tmp_path: Path) -> None:
    """Of three agents two have one: their runs have it, the third has the campaign's; a resumed folder keeps all, and
    another pace of an agent is another campaign.
    """
    agents = [manifest(tmp_path, name, "lockstep, realtime, warp") for name in ("own", "other", "plain")]
    own, other = (
        agent.model_copy(update={"pace": pace})
        for agent, pace in zip(agents, ("realtime", "lockstep"), strict=False)
    )
    document = campaign(own, other, agents[2]).model_copy(update={"pace": "warp"})
    out = tmp_path / "out"
    for _ in range(2):
        fly_fakes(out, document)
        assert flown_paces(out) == {"own": {"realtime"}, "other": {"lockstep"}, "plain": {"warp"}}
    assert len({plan.simspec.seeds.root for plan in realizations(document)}) == 4
    with pytest.raises(SetupError, match="not in this campaign"):
        fly_fakes(out, campaign(agents[0], other, agents[2]).model_copy(update={"pace": "warp"}))


def test_a_pace_for_all_runs_lets_a_realtime_agent_join(tmp_path: Path) -> None:
    """With --pace the campaign has no fault; every SimSpec has the pace, also of an agent that states another one, and so
    has the manifest. Resumed without the option, the folder keeps it; another pace is another campaign.
    """
    agents = manifest(tmp_path, "slow", "realtime"), manifest(tmp_path, "quick", "lockstep, realtime")
    stated = campaign(agents[0], agents[1].model_copy(update={"pace": "lockstep"}))
    file = tmp_path / "campaign.yaml"
    file.write_text(dump_yaml(stated))
    overridden = CampaignChanges(pace="realtime").load(file)
    assert takeoff_faults(plan.simspec for plan in realizations(overridden)) == []
    out = tmp_path / "out"
    for made in (overridden, stated):
        fly_fakes(out, made)
        assert flown_paces(out) == {"slow": {"realtime"}, "quick": {"realtime"}}
        assert json.loads(CampaignFolder(out).manifest.read_text())["pace"] == "realtime"
    with pytest.raises(SetupError, match="not in this campaign"):
        fly_fakes(out, stated.model_copy(update={"pace": "lockstep"}))


def flown_paces(folder: Path) -> dict[str, set[str]]:
    """The paces in the SimSpecs of a folder, by agent."""
    paces: dict[str, set[str]] = {}
    for path in (folder / "simspecs").glob("*.json"):
        spec = SimSpec.model_validate_json(path.read_bytes())
        paces.setdefault(spec.agent.label, set()).add(spec.pace.mode)
    return paces


AREA = {"corners": [{"east_m": e, "north_m": n} for e, n in ((0, 0), (60, 0), (60, 60), (0, 60))]}


def base(**placement: Any) -> SimSpec:
    people = {"id": "people", "asset": "civilian", "role": "bystander", "count": 2, "placement": placement}
    return validate_document({"name": "yard", "world": {"area": AREA}, "actors": [people]}, SimSpec)


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


def test_any_number_of_processes_plans_and_writes_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The journals have the same digests, also where a scene has no room and a SimSpec was lost in between; and all that
    has room passes the check.
    """
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

    alone, together = (
        write_scenes(plans, CampaignFolder(tmp_path / f"written-{workers}"), workers) for workers in (1, 2)
    )
    assert together == alone
    assert len(alone.infeasible) == len(alone.digests) == 4
    assert all("proved" in reason for reason in alone.infeasible.values())
    for name in alone.digests:
        text = CampaignFolder(tmp_path / "written-2").simspec(name).read_bytes()
        assert check_placement(SimSpec.model_validate_json(text)) == []


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
