"""What is known to be wrong with a campaign is told before anything is placed or flown, all of it at once."""

from __future__ import annotations

import json
from pathlib import Path

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
    run_campaign_sync,
    takeoff_faults,
)
from bench.campaign.planning._realizations import realizations
from bench.cli._run_request import CampaignChanges
from bench.documents import dump_yaml
from bench.errors import SetupError
from bench.realization import DesignFactor
from bench.simspec import ActorGroup, Pace, SimSpec, VehicleSpec

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


OPTIONS = RunOptions(Script(), workers=1)  # type: ignore[arg-type]


def fly(folder: Path, document: Campaign) -> None:
    run_campaign_sync(document, folder, OPTIONS)


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
        fly(tmp_path / "out", campaign(*agents))

    faults = [str(fault) for fault in refusal.value.faults]
    assert len(faults) == 4, faults
    for fault, name in zip(faults, ("'slow'", "'slower'", "no-such-agent", "no-such-program"), strict=True):
        assert name in fault
    assert "fly with --pace realtime" in faults[0]
    assert not (tmp_path / "out" / "simspecs").exists()


def test_every_level_of_a_factor_is_looked_at(tmp_path: Path) -> None:
    """Of three ticks two are no whole number of controller steps: two faults; the third would fly."""
    document = campaign(manifest(tmp_path, "agent"))
    ticks = DesignFactor(name="tick", levels=(0.1, 0.103, 0.11), sets=("pace.tick_s",))
    document = document.model_copy(
        update={"design": document.design.model_copy(update={"factors": (ticks,), "replicates": 1})}
    )
    faults = takeoff_faults(plan.simspec for plan in realizations(document))
    assert [fault.what.split(" s ")[0] for fault in faults] == ["0.103", "0.11"]


def test_levels_that_nobody_defines_as_assets_are_faults(tmp_path: Path) -> None:
    """Two of three: they were found only when the scenes were placed."""
    group = ActorGroup.model_validate({"id": "cars", "asset": "van", "role": "bystander", "count": 1})
    document = campaign(manifest(tmp_path, "agent"), actors=(group,))
    assets = DesignFactor(name="kind", levels=("van", "submarine", "zeppelin"), sets=("actors[cars].asset",))
    document = document.model_copy(
        update={"design": document.design.model_copy(update={"factors": (assets,), "replicates": 1})}
    )
    faults = takeoff_faults(plan.simspec for plan in realizations(document))
    assert [f"{fault.where}: {fault.what}" for fault in faults] == [
        f"actors[0].asset: there is no asset '{name}'" for name in ("submarine", "zeppelin")
    ]


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        (VehicleSpec(model="zeppelin"), "zeppelin"),
        (VehicleSpec(parameters={"NO_SUCH_PARAMETER": 1.0}), "NO_SUCH_PARAMETER"),
    ],
)
def test_vehicles_are_opened_once_to_know_their_faults(
    tmp_path: Path, vehicle: VehicleSpec, words: str
) -> None:
    """A model or a parameter that does not exist."""
    document = campaign(manifest(tmp_path, "agent"), vehicle=vehicle)
    faults = takeoff_faults(plan.simspec for plan in realizations(document))
    assert len(faults) == 1
    assert words in str(faults[0])


def test_a_pace_for_all_runs_lets_a_realtime_agent_join(tmp_path: Path) -> None:
    """The same campaign with its pace overridden has no fault; every SimSpec has the pace, and so has the
    manifest. Resumed without the option, the folder keeps it; another pace is another campaign.
    """
    document = campaign(
        manifest(tmp_path, "slow", "realtime"), manifest(tmp_path, "quick", "lockstep, realtime")
    )
    document = document.model_copy(update={"budgets": document.budgets.model_copy(update={"wall_s": 60.0})})
    assert document.base is not None
    assert document.base.pace == Pace(mode="lockstep")
    out = tmp_path / "out"
    flown = document.model_copy(update={"pace": "realtime"})
    for made in (flown, document):
        fly_fakes(out, made)
        paces = {
            SimSpec.model_validate_json(path.read_bytes()).pace.mode
            for path in (out / "simspecs").glob("*.json")
        }
        assert paces == {"realtime"}
        assert json.loads(CampaignFolder(out).manifest.read_text())["pace"] == "realtime"
    assert takeoff_faults(plan.simspec for plan in realizations(flown)) == []
    with pytest.raises(SetupError, match="not in this campaign"):
        fly_fakes(out, document.model_copy(update={"pace": "lockstep"}))


def fly_fakes(folder: Path, document: Campaign) -> None:
    run_campaign_sync(
        document, folder, OPTIONS, Collaborators(jobs=Jobs(JOB), open_executor=open_in_process())
    )


def test_an_agent_with_a_pace_of_its_own_goes_before_the_campaign(tmp_path: Path) -> None:
    """Of three agents two have one: their runs have it, the third has the campaign's; a resumed folder keeps all. A folder
    flown with --pace keeps that for all, and another pace of an agent is another campaign.
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
    stated = campaign(own, other, agents[2])
    overridden = tmp_path / "campaign.yaml"
    overridden.write_text(dump_yaml(stated))
    all_at_one_pace = CampaignChanges(pace="realtime").load(overridden)
    for made in (all_at_one_pace, stated):
        fly_fakes(tmp_path / "overridden", made)
        assert set.union(*flown_paces(tmp_path / "overridden").values()) == {"realtime"}


def flown_paces(folder: Path) -> dict[str, set[str]]:
    """The paces in the SimSpecs of a folder, by agent."""
    paces: dict[str, set[str]] = {}
    for path in (folder / "simspecs").glob("*.json"):
        spec = SimSpec.model_validate_json(path.read_bytes())
        paces.setdefault(spec.agent.label, set()).add(spec.pace.mode)
    return paces
