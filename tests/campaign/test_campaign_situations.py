"""A campaign over several base situations: one design, one folder, one report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from campaign_fakes import fly, small_campaign
from command_line import json_of

from bench.campaign import (
    Campaign,
    Collaborators,
    finish_campaign,
    load_campaign,
    open_journal,
    propose_next,
    read_runs,
    realizations,
    run_campaign_sync,
    verify_folder,
    with_floor,
)
from bench.cli._app import run
from bench.documents import dump_yaml, read_document
from bench.errors import SetupError
from bench.simspec import SimSpec

ROOT = Path(__file__).parents[2]


def yard(**changes: Any) -> SimSpec:
    """The situation of `small_campaign`, with changes."""
    base = small_campaign(1).base
    assert base is not None
    return base.model_copy(update=changes)


def two(**changes: Any) -> Campaign:
    """Two yards, one of them with another id of its people and more of them."""
    crowd = yard().actors[0].model_copy(update={"id": "crowd", "count": 6})
    fog = {"name": "fog", "levels": [0.0, 2.0, 4.0], "sets": ["environment.fog_level"]}
    return Campaign.model_validate(
        {
            "name": "two",
            "situations": [
                {"name": "quiet", "base": yard(), "tension": 1},
                {"name": "busy", "base": yard(actors=(crowd,))},
            ],
            "agents": [{"manifest": "first"}, {"manifest": "second"}],
            "design": {"factors": [fog], "seed": 7},
            **changes,
        }
    )


def test_each_situation_meets_each_level_with_its_own_actors() -> None:
    plans = realizations(two())

    levels = [(plan.levels["situation"], plan.levels["fog"]) for plan in plans]
    assert sorted(set(levels)) == [(name, fog) for name in ("busy", "quiet") for fog in (0.0, 2.0, 4.0)]
    assert len(plans) == 12
    for plan in plans:
        (people,) = plan.simspec.actors
        assert (people.id, people.count) == {"quiet": ("people", 4), "busy": ("crowd", 6)}[
            str(plan.levels["situation"])
        ]
        assert plan.simspec.environment.fog_level == plan.levels["fog"]


def test_a_design_may_name_the_situation() -> None:
    """In a condition of a factor that only one situation has, in `forbid`, and in `take`."""
    crowd = {
        "name": "crowd",
        "levels": [5, 9],
        "sets": ["actors[crowd].count"],
        "when": "situation == 'busy'",
    }
    conditional = realizations(two(design={"factors": [crowd]}))
    assert {(str(plan.levels["situation"]), plan.simspec.actors[0].count) for plan in conditional} == {
        ("quiet", 4),
        ("busy", 5),
        ("busy", 9),
    }
    fog = {"name": "fog", "levels": [0.0, 2.0], "sets": ["environment.fog_level"]}
    forbidden = realizations(two(design={"factors": [fog], "forbid": ["situation == 'quiet' and fog > 1"]}))
    assert len({plan.design_point for plan in forbidden}) == 3
    drawn = realizations(two(design={"replicates": 3, "method": {"kind": "full_factorial", "take": 5}}))
    assert len({(plan.design_point, plan.replicate) for plan in drawn}) == 5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"base": yard()}, "give either base"),
        ({"situations": [{"name": "a", "base": yard()}, {"name": "a", "base": yard()}]}, "are called 'a'"),
        ({"situations": [{"name": "a"}]}, "situation 'a': give either base"),
        (
            {"design": {"factors": [{"name": "place", "levels": ["quiet"], "sets": ["base"]}]}},
            r"its levels \['quiet'\] are not the situations",
        ),
        (
            {"design": {"factors": [{"name": "n", "levels": [1, 2], "sets": ["actors[crowd].count"]}]}},
            "situation 'quiet': design: factor 'n': path .*has no member 'crowd'",
        ),
        (
            {
                "design": {
                    "factors": [
                        {
                            "name": "n",
                            "levels": [1, 2],
                            "sets": ["actors[crowd].count"],
                            "when": "situation == 'quiet'",
                        }
                    ]
                }
            },
            "does not exist in this situation .narrow the `when` of factor 'n'",
        ),
        (
            {"design": {"factors": [{"name": "n", "levels": ["quiet", "busy"], "sets": ["base", "name"]}]}},
            "takes no other path",
        ),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises((SetupError, ValueError), match=message):
        realizations(two(**changes))


def test_one_base_has_no_situation_to_choose() -> None:
    campaign = small_campaign(1).model_dump(mode="json")
    campaign["design"]["factors"] = [{"name": "place", "levels": ["quiet"], "sets": ["base"]}]
    with pytest.raises(SetupError, match="no field 'base'"):
        realizations(Campaign.model_validate(campaign))


def test_situations_in_files_of_their_own(tmp_path: Path) -> None:
    """Read beside the campaign; the faults of all files come at once."""
    for name in ("north", "south"):
        (tmp_path / f"{name}.yaml").write_text(dump_yaml(yard(description=name)))
    document = {
        "name": "files",
        "agents": [{"manifest": "first"}],
        "situations": [{"name": name, "base_file": f"{name}.yaml"} for name in ("north", "south")],
    }
    path = tmp_path / "campaign.yaml"
    path.write_text(yaml.safe_dump(document))
    plans = realizations(load_campaign(path))
    assert {(plan.levels["situation"], plan.simspec.description) for plan in plans} == {
        ("north", "north"),
        ("south", "south"),
    }
    for name in ("north", "south"):
        (tmp_path / f"{name}.yaml").write_text("nmae: wrong\n")
    with pytest.raises(SetupError) as refusal:
        load_campaign(path)
    assert {Path(fault.where.split(":")[0]).name for fault in refusal.value.faults} == {
        "north.yaml",
        "south.yaml",
    }


def test_journal_resume_and_situations_added_later(tmp_path: Path) -> None:
    campaign = two(design={})
    assert fly(tmp_path, campaign).flown == 4

    with open_journal(tmp_path / "journal.sqlite") as journal:
        noted = {entry.levels["situation"] for entry in journal.entries()}
    assert noted == {"quiet", "busy"}
    assert fly(tmp_path, load_campaign(tmp_path / "campaign.yaml")).flown == 0
    third = {"name": "third", "base": yard()}
    more = two(design={}, situations=[*campaign.situations, third])
    assert fly(tmp_path, more).flown == 2
    with pytest.raises(SetupError, match="realizations that are not in this campaign"):
        fly(tmp_path, two(design={}, situations=[third, *campaign.situations]))


def test_scores_report_comparison_and_the_next_campaign(tmp_path: Path, capsys: Any) -> None:
    """By surrogates: the campaign of two situations ends like any other, and `situation` is a factor in it."""
    demo = load_campaign(ROOT / "campaigns" / "demo.yaml")
    assert demo.base is not None
    foggy = demo.base.model_copy(
        update={"environment": demo.base.environment.model_copy(update={"fog_level": 4.0})}
    )
    document = demo.model_dump(mode="json") | {
        "base": None,
        "fidelity": "overhead",
        "situations": [{"name": "clear", "base": demo.base}, {"name": "foggy", "base": foggy}],
        "design": {"replicates": 3, "seed": 3},
    }
    campaign = Campaign.model_validate(
        json.loads(json.dumps(document, default=lambda x: x.model_dump(mode="json")))
    )
    folder = tmp_path / "out"
    collaborators = Collaborators(finish=lambda paths: finish_campaign(paths.path) and None)
    run_campaign_sync(campaign, folder, collaborators=collaborators)

    assert verify_folder(folder) == []
    assert len(read_runs(folder).runs) == 12
    page = (folder / "report.html").read_text()
    assert "clear, foggy" in page
    assert run(["compare", str(folder)]) == 0
    proposal = propose_next(folder)
    proposed = read_document(proposal.text, Campaign)
    assert proposed.situations == campaign.situations
    assert [factor.name for factor in proposed.design.factors] == ["situation"]
    # A comment wraps at 80 columns, wherever that falls.
    text = " ".join(proposal.text.replace("#", "").split())
    assert "situation: stays: which situations a campaign is about is for a person to decide" in text
    capsys.readouterr()


def test_dry_run_floor_and_difficulty_over_all_situations(tmp_path: Path, capsys: Any) -> None:
    demo = load_campaign(ROOT / "campaigns" / "demo.yaml")
    assert demo.base is not None
    longer = demo.base.model_copy(
        update={"mission": demo.base.mission.model_copy(update={"time_limit_s": 400.0})}
    )
    path = tmp_path / "pair.yaml"
    document = demo.model_dump(mode="json") | {
        "base": None,
        "situations": [
            {"name": name, "base": base.model_dump(mode="json"), **built}
            for name, base, built in (("short", demo.base, {"tension": 1}), ("long", longer, {}))
        ],
        "design": {"seed": 3},
    }
    path.write_text(yaml.safe_dump(document))
    assert run(["run", str(path), "--dry-run"]) == 0
    text = capsys.readouterr().out
    assert "4 realizations of 2 design points" in text
    assert "(300 to 400 s each)" in text
    assert "situation short: tension 2, built for 1" in text
    assert "situation long: tension 2\n" in text

    assert json_of(["run", str(path), "--dry-run", "--json"], capsys)["tensions"] == {
        "short": [2],
        "long": [2],
    }

    floor = realizations(with_floor(load_campaign(path)))
    assert {plan.levels["situation"] for plan in floor if plan.agent == "null-idle"} == {"short", "long"}
