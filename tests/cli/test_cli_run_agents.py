"""`rebar run CAMPAIGN --agent`: other agents in place of the campaign's, and a word about those that report nothing."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from bench.campaign import realizations
from bench.cli._app import run
from bench.cli._campaign_end import show_scores
from bench.cli._run_request import CampaignChanges, RunRequest
from bench.errors import SetupError

DEMO = Path(__file__).parents[2] / "campaigns" / "demo.yaml"


def test_agents_are_named_by_folder_manifest_or_entry_point(tmp_path: Path) -> None:
    folder = tmp_path / "scout"
    assert run(["agent", "new", str(folder)]) == 0
    other = folder / "other.yaml"
    other.write_text((folder / "scout.yaml").read_text())
    campaign = CampaignChanges(agents=[str(folder), str(other), "null-idle"]).load(DEMO)
    manifests = [agent.manifest for agent in campaign.agents]
    assert manifests == [str(folder / "scout.yaml"), str(other), "null-idle"]
    unchanged = CampaignChanges().load(DEMO)
    assert unchanged.design == campaign.design
    assert {agent.label for agent in unchanged.agents} == {"reference-naive", "reference-bystander-aware"}


def test_an_agent_of_the_campaign_keeps_its_options_beside_others() -> None:
    panel = DEMO.parent / "panel.yaml"
    whole = CampaignChanges().load(panel)
    by_name = {spec.label: spec for spec in whole.agents}
    some = CampaignChanges(agents=["panel-dim", "null-idle", "panel-hasty"]).load(panel)
    assert by_name["panel-hasty"].options
    assert (some.agents[0], some.agents[2]) == (by_name["panel-dim"], by_name["panel-hasty"])
    assert (some.agents[1].manifest, some.agents[1].options) == ("null-idle", {})


@pytest.mark.parametrize(
    ("points", "shard", "flown"), [(1, "1/12", 1), (5, "1/2", 6), (12, "1/1", 12), (99, "1/1", 12)]
)
def test_a_campaign_is_tried_on_a_few_of_its_points(points: int, shard: str, flown: int) -> None:
    """At least as many as asked, where there are so many, from all over the design and by all agents; in a folder of their own."""
    changes = CampaignChanges(points=points)
    campaign = changes.load(DEMO)
    assert campaign.shard == shard
    plans = realizations(campaign)
    assert len({plan.design_point for plan in plans}) == flown
    assert len(plans) == 2 * flown
    assert RunRequest(changes=changes).folder(campaign) == Path("out") / f"demo-{shard.replace('/', '-of-')}"
    with pytest.raises(SetupError, match="--points: chooses a shard"):
        CampaignChanges(points=points, shard="1/2").load(DEMO)


def test_a_folder_without_a_manifest_of_its_name_is_told(tmp_path: Path) -> None:
    (tmp_path / "scout").mkdir()
    with pytest.raises(SetupError, match=r"holds no scout\.yaml"):
        CampaignChanges(agents=[str(tmp_path / "scout")]).load(DEMO)


@pytest.mark.parametrize("silent", [(), ("scout", "wing")])
def test_the_end_of_a_campaign_begins_with_agents_that_reported_nothing(
    silent: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    class EndsHere(Exception):
        pass

    class Scores(SimpleNamespace):
        @property
        def summary(self) -> Any:
            raise EndsHere

    scores = Scores(silent=silent, saw_truth=("run-1",))
    campaign = SimpleNamespace(fidelity="full")
    with pytest.raises(EndsHere):
        show_scores(cast(Any, campaign), Path("out"), cast(Any, None), cast(Any, scores), ())
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("REPORTED NOTHING in any run: scout, wing;" if silent else "SAW THE TRUTH")
