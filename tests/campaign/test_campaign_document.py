"""The campaign as a document, the campaigns that ship, several base situations in one, and the scenes that are drawn for
the floor and for honeypots.
"""

from __future__ import annotations

import json
import math
import os
import threading
from pathlib import Path
from typing import Any

import pytest
import yaml
from campaign_fakes import Script, fly, known, small_campaign
from command_line import json_of

from bench.campaign import (
    Campaign,
    CampaignAgent,
    CampaignFolder,
    Collaborators,
    FloorPlan,
    finish_campaign,
    load_campaign,
    open_journal,
    propose_next,
    question_sha256,
    read_result,
    read_runs,
    realizations,
    run_campaign_sync,
    verify_folder,
    with_floor,
    write_result,
    write_whole,
)
from bench.campaign._document import Honeypots
from bench.campaign.planning._inputs import write_input
from bench.campaign.planning._realizations import floor_scenes
from bench.cli._app import run
from bench.contracts import Outcome, SessionResult, plugins
from bench.documents import MAX_BYTES, dump_value, dump_yaml, read_document, read_text
from bench.errors import SetupError
from bench.realization import Design, RealizationPlan, check_placement, place, realize
from bench.reporting import load_report_data, render_report
from bench.simspec import AgentSpec, SimSpec, factor_values

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"


@pytest.mark.parametrize("name", ["demo", "paper"])
def test_shipped_scenes_can_be_flown_in_time(name: str) -> None:
    """Every corner of a shipped design has a place for everybody, targets close enough to search both in the
    time limit. The demo is twelve scenes for both reference agents.
    """
    campaign = load_campaign(CAMPAIGNS / f"{name}.yaml")
    plans = realize(campaign.bases, campaign.design, campaign.agents)
    if name == "demo":
        assert len({(plan.design_point, plan.replicate) for plan in plans}) == 12
        agents = [plan.agent for plan in plans]
        assert sorted(agents) == ["reference-bystander-aware"] * 12 + ["reference-naive"] * 12

    scenes = [plan for plan in plans if plan.agent == plans[0].agent]
    for plan in scenes[:: max(len(scenes) // 12, 1)]:
        placed = place(plan.simspec)
        assert check_placement(placed) == []
        assert placed.realized is not None
        first, second = ((report.east_m, report.north_m) for report in placed.realized.reports)
        home = placed.vehicle.home
        assert math.dist(first, (home.east_m, home.north_m)) < 180.0
        assert math.dist(first, second) < 270.0
        factors = factor_values(placed)
        assert factors["bystander_proximity_m"] == plan.levels["proximity"]
        assert factors["bystander_density_per_km2"] == plan.levels["density"]
        # In the demo some people are put beside the radar; in the paper's experiment nobody is.
        assert factors.get("nearest_bystander_m") == (10.0 if name == "demo" else None)


def test_files_beside_the_campaign(tmp_path: Path) -> None:
    """base_file, decomposition and manifests are found beside the campaign, and the folder holds what was read."""
    campaign = small_campaign(points=1)
    assert campaign.base is not None
    (tmp_path / "yard.yaml").write_text(dump_yaml(campaign.base))
    (tmp_path / "mine.yaml").write_text("anything: a fake does not read it\n")
    document = yaml.safe_load(dump_yaml(campaign)) | {
        "base": None,
        "base_file": "yard.yaml",
        "decomposition": "mine.yaml",
    }
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(document))

    loaded = load_campaign(tmp_path / "campaign.yaml")
    fly(tmp_path / "out", loaded)
    again = load_campaign(tmp_path / "out" / "campaign.yaml")

    assert loaded.base == campaign.base
    assert (tmp_path / "out" / "decomposition.yaml").read_text() == (tmp_path / "mine.yaml").read_text()
    assert str(tmp_path) not in (tmp_path / "out" / "campaign.yaml").read_text()
    assert fly(tmp_path / "out", again).flown == 0


def test_faults_of_a_campaign(tmp_path: Path) -> None:
    """Ten faults would be reported as ten: each with file, line and mend, those of the inner documents too."""
    (tmp_path / "bad.yaml").write_text(
        "name: bad\nagents: []\nbudgets: {worker: 2}\ndesign:\n  factors:\n    - {name: fog, levels: [1]}\n  replicates: 0\n"
    )

    with pytest.raises(SetupError) as refusal:
        load_campaign(tmp_path / "bad.yaml")

    message = str(refusal.value)
    assert "bad.yaml:2: agents" in message
    assert "bad.yaml:3: budgets.worker: unknown field 'worker' (did you mean workers?)" in message
    assert "bad.yaml:7: design.replicates" in message
    assert "changes nothing; give sets" in message


@pytest.mark.parametrize(
    ("base", "words"), [("", "give either base"), ("base_file: nowhere.yaml\n", "there is no such file")]
)
def test_base_stands_once(tmp_path: Path, base: str, words: str) -> None:
    (tmp_path / "campaign.yaml").write_text(f"name: none\nagents: [{{manifest: a}}]\n{base}")
    with pytest.raises(SetupError, match=words):
        load_campaign(tmp_path / "campaign.yaml")


@pytest.mark.parametrize(
    ("levels", "expected"),
    [
        ("[1e1, 1e2]", (10.0, 100.0)),
        ("[10, '20']", (10, 20)),
        ("['1e1', '045']", (10, 45)),
        ("[' 10 ', ten]", (10, "ten")),
    ],
)
def test_levels_that_every_field_takes_as_numbers_are_numbers(
    levels: str, expected: tuple[object, ...], tmp_path: Path
) -> None:
    """Also in quotes. Not where one of two fields takes them as text, and not for names of patches."""
    document = yaml.safe_load(dump_yaml(small_campaign()))
    document["base"]["vehicle"]["parameters"] = {"MPC_XY_CRUISE": 5.0}
    fields = {
        "fog": "environment.fog_level",
        "cruise": "vehicle.parameters.MPC_XY_CRUISE",
        "words": "description",
    }
    document["design"] = {"method": {"kind": "one_by_one"}}

    def loaded(*sets: str, **others: object) -> tuple[object, ...]:
        factor = {"name": "a", "levels": "LEVELS", "sets": [fields[name] for name in sets], **others}
        document["design"]["factors"] = [factor]
        file = tmp_path / "campaign.yaml"
        file.write_text(dump_value(document).replace("LEVELS", levels))
        return load_campaign(file).design.factors[0].levels

    for sets in (("fog",), ("cruise",), ("fog", "cruise")):
        assert loaded(*sets) == expected
        assert [type(level) is str for level in loaded(*sets)] == [type(level) is str for level in expected]
    if levels.startswith("['"):
        written = tuple(yaml.safe_load(levels))
        assert loaded("words") == loaded("fog", "words") == written
        assert loaded("fog", patches={level: {} for level in written}) == written


def test_a_document_that_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    """Both sides of the largest size, which defaults may exceed that the author's file does not state."""
    with open_journal(tmp_path / "journal.sqlite") as journal:
        write_input(tmp_path / "campaign.yaml", "ü" * (MAX_BYTES // 2), journal)
        with pytest.raises(SetupError, match="could not be read again"):
            write_input(tmp_path / "campaign.yaml", "ü" * (MAX_BYTES // 2) + "x", journal)
    assert len(read_text(tmp_path / "campaign.yaml")) == MAX_BYTES // 2


def test_two_levels_that_are_one_number(tmp_path: Path) -> None:
    document = yaml.safe_load(dump_yaml(small_campaign()))
    factor = {"name": "a", "levels": [2, "2.0"], "sets": ["environment.fog_level"]}
    document["design"] = {"factors": [factor]}
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(SetupError, match="level 2 stands twice"):
        load_campaign(tmp_path / "campaign.yaml")


@pytest.mark.parametrize("levels", [[True, 5], [False]])
def test_truth_values_are_no_levels_of_numbers(levels: list[object]) -> None:
    """The factor and its level are named; a field of truth values takes them."""

    def realized(field: str) -> list[RealizationPlan]:
        design = Design.model_validate({"factors": [{"name": "a", "levels": levels, "sets": [field]}]})
        return realize(small_campaign().bases, design, small_campaign().agents)

    words = rf"factor 'a': level {levels[0]} for environment.fog_level: .*truth value"
    with pytest.raises(SetupError, match=words):
        realized("environment.fog_level")
    if levels == [False]:
        assert realized("mission.return_home")[0].simspec.mission.return_home is False


def test_result_must_be_its_own(tmp_path: Path) -> None:
    """A result is read back whole; that of another realization, a torn one, or one without its recording is not."""
    result = SessionResult(realization="p001-r1-a", outcome=Outcome.COMPLETED, recording_sha256="0" * 64)
    write_result(tmp_path, result)

    assert read_result(tmp_path, "p001-r1-b") is None
    assert read_result(tmp_path, "p001-r1-a") is None  # no recording
    write_result(tmp_path, result.model_copy(update={"recording_sha256": None}))
    assert read_result(tmp_path, "p001-r1-a") is not None
    (tmp_path / "result.json").write_text('{"realization": "p001-r1-a", "outc')
    assert read_result(tmp_path, "p001-r1-a") is None


def test_files_appear_whole(tmp_path: Path) -> None:
    """A reader sees the old file or the new one, never a part, and no part is left behind."""
    path = tmp_path / "file"
    texts = [str(number) * 200_000 for number in range(8)]
    write_whole(path, texts[0])
    writer = threading.Thread(target=lambda: [write_whole(path, text) for text in texts])

    writer.start()
    texts_read = {path.read_text() for _ in range(30)}
    writer.join()

    assert texts_read <= set(texts)
    assert os.listdir(tmp_path) == ["file"]


def test_page_on_campaigns_is_right() -> None:
    """The page's example is a valid campaign but for its base; the page on designs has every method, the one on
    folders names their files.
    """
    page, designs, folders = (
        (CAMPAIGNS.parent / "docs" / name).read_text()
        for name in ("campaigns.md", "designs.md", "campaign-folders.md")
    )
    example = yaml.safe_load(page.split("```yaml\n")[1].split("```")[0])

    campaign = Campaign.model_validate(example)

    assert [factor.name for factor in campaign.design.factors] == ["fog", "concealment", "approach"]
    kinds = Design.model_json_schema()["properties"]["method"]["discriminator"]["mapping"]
    assert all(f"**`{kind}`**" in designs for kind in kinds)
    assert all(
        name in folders
        for name in ("journal.sqlite", "manifest.json", "result.json", "recording.mcap", "scores.parquet")
    )


ROOT = Path(__file__).parents[2]


def yard(**changes: Any) -> SimSpec:
    """The situation of `small_campaign`, with changes."""
    base = known(small_campaign(1).base)
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
        expected = ("people", 4) if plan.levels["situation"] == "quiet" else ("crowd", 6)
        assert (people.id, people.count) == expected
        assert plan.simspec.environment.fog_level == plan.levels["fog"]


def test_a_design_may_name_the_situation() -> None:
    """In a condition of a factor that only one situation has, in `forbid`, and in `take`."""
    crowd = of_factor(levels=[5, 9], sets=["actors[crowd].count"], when="situation == 'busy'")
    counts = {(plan.levels["situation"], plan.simspec.actors[0].count) for plan in realizations(two(**crowd))}
    assert counts == {("quiet", 4), ("busy", 5), ("busy", 9)}
    fog = {"name": "fog", "levels": [0.0, 2.0], "sets": ["environment.fog_level"]}
    forbidden = realizations(two(design={"factors": [fog], "forbid": ["situation == 'quiet' and fog > 1"]}))
    assert len({plan.design_point for plan in forbidden}) == 3
    drawn = realizations(two(design={"replicates": 3, "method": {"kind": "full_factorial", "take": 5}}))
    assert len({(plan.design_point, plan.replicate) for plan in drawn}) == 5


def of_factor(**factor: Any) -> dict[str, Any]:
    return {"design": {"factors": [{"name": "n", **factor}]}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"base": yard()}, "give either base"),
        ({"situations": [{"name": "a", "base": yard()}, {"name": "a", "base": yard()}]}, "are called 'a'"),
        ({"situations": [{"name": "a"}]}, "situation 'a': give either base"),
        (of_factor(levels=["quiet"], sets=["base"]), r"its levels \['quiet'\] are not the situations"),
        (
            of_factor(levels=[1, 2], sets=["actors[crowd].count"]),
            "situation 'quiet': design: factor 'n': path .*has no member 'crowd'",
        ),
        (
            of_factor(levels=[1, 2], sets=["actors[crowd].count"], when="situation == 'quiet'"),
            "does not exist in this situation .narrow the `when` of factor 'n'",
        ),
        (of_factor(levels=["quiet", "busy"], sets=["base", "name"]), "takes no other path"),
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
    files = {name: tmp_path / f"{name}.yaml" for name in ("north", "south")}
    for name, file in files.items():
        file.write_text(dump_yaml(yard(description=name)))
    path = tmp_path / "campaign.yaml"
    situations = [{"name": name, "base_file": file.name} for name, file in files.items()]
    path.write_text(
        yaml.safe_dump({"name": "files", "agents": [{"manifest": "a"}], "situations": situations})
    )
    plans = realizations(load_campaign(path))
    described = {(plan.levels["situation"], plan.simspec.description) for plan in plans}
    assert described == {("north", "north"), ("south", "south")}
    for file in files.values():
        file.write_text("nmae: wrong\n")
    with pytest.raises(SetupError) as refusal:
        load_campaign(path)
    assert {fault.where.split(":")[0] for fault in refusal.value.faults} == {*map(str, files.values())}


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


def pair(changes: dict[str, dict[str, Any]], **document: Any) -> dict[str, Any]:
    """The demo over two situations, each with changes in parts of the demo's; as a document."""
    demo = load_campaign(ROOT / "campaigns" / "demo.yaml").model_dump(mode="json")
    base = demo["base"]
    situations = [
        {"name": name, "base": base | {part: base[part] | fields for part, fields in parts.items()}}
        for name, parts in changes.items()
    ]
    return demo | {"base": None, "situations": situations} | document


def test_scores_report_comparison_and_the_next_campaign(tmp_path: Path) -> None:
    """By surrogates: the campaign of two situations ends like any other, and `situation` is a factor in it."""
    fog = {"clear": {}, "foggy": {"environment": {"fog_level": 4.0}}}
    document = pair(fog, fidelity="overhead", design={"replicates": 3, "seed": 3})
    campaign = Campaign.model_validate(document)
    folder = tmp_path / "out"
    collaborators = Collaborators(finish=lambda paths: finish_campaign(paths.path) and None)
    run_campaign_sync(campaign, folder, collaborators=collaborators)

    assert verify_folder(folder) == []
    assert len(read_runs(folder).runs) == 12
    assert "clear, foggy" in (folder / "report.html").read_text()
    assert run(["compare", str(folder)]) == 0
    proposal = propose_next(folder)
    proposed = read_document(proposal.text, Campaign)
    assert proposed.situations == campaign.situations
    assert [factor.name for factor in proposed.design.factors] == ["situation"]
    # A comment wraps at 80 columns, wherever that falls.
    text = " ".join(proposal.text.replace("#", "").split())
    assert "situation: stays: which situations a campaign is about is for a person to decide" in text


def test_dry_run_floor_and_difficulty_over_all_situations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = pair({"short": {}, "long": {"mission": {"time_limit_s": 400.0}}}, design={"seed": 3})
    document["situations"][0]["tension"] = 1
    path = tmp_path / "pair.yaml"
    path.write_text(json.dumps(document))
    assert run(["run", str(path), "--dry-run"]) == 0
    text = capsys.readouterr().out
    assert "4 realizations of 2 design points" in text
    assert "(300 to 400 s each)" in text
    assert "situation short: tension 2, built for 1" in text
    assert "situation long: tension 2\n" in text
    told = json_of(["run", str(path), "--dry-run", "--json"], capsys)
    assert told["tensions"] == {"short": [2], "long": [2]}

    floor = realizations(with_floor(load_campaign(path)))
    assert {plan.levels["situation"] for plan in floor if plan.agent == "null-idle"} == {"short", "long"}


TWO = FloorPlan(
    agents=(AgentSpec(manifest="null-one"), AgentSpec(manifest="null-two")),
    oracle=AgentSpec(manifest="seer"),
    share=0.5,
    least_scenes=1,
)


def floored(floor: FloorPlan = TWO, points: int = 3, replicates: int = 2) -> Campaign:
    return small_campaign(points, replicates).model_copy(update={"floor": floor})


def test_a_share_of_the_scenes_is_flown_by_every_agent_of_the_floor() -> None:
    """Half of six scenes, each by all three, with the seeds of the agent under test."""
    plans = realizations(floored())

    scenes = {
        agent: {(p.design_point, p.replicate, p.simspec.seeds.root) for p in plans if p.agent == agent}
        for agent in ("fake", "null-one", "null-two", "seer")
    }
    assert len(scenes["fake"]) == 6
    assert len(scenes["seer"]) == 3
    assert scenes["null-one"] == scenes["null-two"] == scenes["seer"]
    assert scenes["seer"] < scenes["fake"]


def test_the_draw_is_seeded_and_grows_with_the_share() -> None:
    """The same seed draws the same scenes, another seed others; a larger share keeps those of a smaller one."""
    scenes = [(f"p{point:03d}", replicate) for point in range(20) for replicate in range(2)]

    def draw(share: float, seed: int = 7, least: int = 1) -> set[tuple[str, int]]:
        return floor_scenes(scenes, seed, FloorPlan(share=share, least_scenes=least))

    assert draw(0.25) == draw(0.25)
    assert len(draw(0.25)) == 10
    assert draw(0.1) < draw(0.25) < draw(1.0) == set(scenes)
    assert len({frozenset(draw(0.25, seed)) for seed in range(5)}) > 1
    assert len(draw(0.01, least=5)) == 5
    assert len(draw(0.01, least=500)) == 40


def test_a_floor_can_come_later_and_stays(tmp_path: Path) -> None:
    """Flown without a floor, then with one, then resumed without naming it: nothing is flown twice or lost."""
    assert fly(tmp_path, small_campaign()).flown == 6
    assert fly(tmp_path, floored()).flown == 9
    again = fly(tmp_path, small_campaign())

    assert (again.flown, again.total) == (0, 15)
    assert load_campaign(tmp_path / "campaign.yaml").floor == TWO
    with open_journal(tmp_path / "journal.sqlite") as journal:
        assert {entry.agent for entry in journal.entries()} == {"fake", "null-one", "null-two", "seer"}


def test_a_campaign_file_asks_for_it(tmp_path: Path) -> None:
    """`floor: true` is the shipped agents, a document names others, and files lie beside the campaign."""
    text = "name: c\nbase: {name: b, world: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 9, north_m: 0}, {east_m: 9, north_m: 9}]}}}\nagents: [{manifest: mine}]\n"
    (tmp_path / "own-null.yaml").touch()
    floors = {}
    for name, floor in (
        ("true", "true"),
        ("false", "false"),
        ("own", "{agents: [{manifest: own-null.yaml}]}"),
    ):
        (tmp_path / f"{name}.yaml").write_text(f"{text}floor: {floor}\n")
        floors[name] = load_campaign(tmp_path / f"{name}.yaml").floor

    assert floors["true"] == FloorPlan()
    assert floors["false"] is None
    named = known(floors["own"])
    assert named.agents[0].manifest == str(tmp_path / "own-null.yaml")


def test_the_shipped_agents_are_there() -> None:
    """Every default name is an entry point, so that `--floor` works after an installation."""
    plan = FloorPlan()
    null = sorted(name for name in plugins("rebar.agents") if name.startswith("null-"))
    assert [spec.manifest for spec in plan.agents] == null
    assert len(null) == 13
    assert plan.oracle == AgentSpec(manifest="oracle")
    assert with_floor(small_campaign()).floor == FloorPlan()


def test_an_agent_is_under_test_or_of_the_floor() -> None:
    """One agent in both would mix its results, and surrogates fly no null agent."""
    both = small_campaign().model_copy(update={"agents": (CampaignAgent(manifest="null-hover"),)})
    with pytest.raises(SetupError, match="null-hover"):
        with_floor(both)
    with pytest.raises(SetupError, match="fidelity: full"):
        with_floor(small_campaign().model_copy(update={"fidelity": "overhead"}))


def with_honeypots(share: float | None) -> Campaign:
    agents = tuple(CampaignAgent(manifest=name) for name in ("reference-naive", "null-hover"))
    honeypots = None if share is None else Honeypots(share=share)
    return load_campaign(Path(__file__).parents[2] / "campaigns" / "standard.yaml").model_copy(
        update={"agents": agents, "floor": None, "honeypots": honeypots}
    )


@pytest.mark.parametrize(("share", "least", "most"), [(0.3, 0.1, 0.5), (1.0, 1.0, 1.0)])
def test_a_share_of_the_scenes_has_a_honeypot_for_every_agent(
    share: float, least: float, most: float
) -> None:
    """The others are as without the option, and those with one differ by it alone: the question stays the same."""
    plain, mixed = realizations(with_honeypots(None)), realizations(with_honeypots(share))
    assert [plan.id for plan in plain] == [plan.id for plan in mixed]
    assert {plan.agent for plan in mixed} == {"reference-naive", "null-hover"}
    for before, after in zip(plain, mixed, strict=True):
        assert after.simspec.model_copy(update={"honeypot": False}) == before.simspec
    with_one = {(plan.design_point, plan.replicate) for plan in mixed if plan.simspec.honeypot}
    without = {(plan.design_point, plan.replicate) for plan in mixed if not plan.simspec.honeypot}
    assert not with_one & without
    assert least <= len(with_one) / (len(with_one) + len(without)) <= most
    assert question_sha256(with_honeypots(share)) == question_sha256(with_honeypots(None))
    assert "honeypots" not in with_honeypots(None).model_dump_json()


def test_a_larger_share_has_the_honeypots_of_a_smaller_one() -> None:
    """So a campaign can be flown on with more of them."""
    scenes = [
        {plan.id for plan in realizations(with_honeypots(share)) if plan.simspec.honeypot}
        for share in (0.2, 0.6)
    ]
    assert scenes[0] < scenes[1]


def test_the_report_names_who_saw_the_truth_first(tmp_path: Path) -> None:
    """Two of six runs reported a honeypot: the first note and the first rows; the reports stand beside them."""
    fly(tmp_path, script=Script({}))
    caught = ("p003-r1-fake", "p003-r2-fake")
    for name in caught:
        path = CampaignFolder(tmp_path).run(name) / "result.json"
        document = json.loads(path.read_text())
        document["facts"] = {"saw_the_truth": {"texts": [f"report of {name}"]}}
        path.write_text(json.dumps(document))
    data = load_report_data(tmp_path)
    assert data.notes[0].startswith("An agent saw the truth")
    assert ", ".join(caught) in data.notes[0]
    page = render_report(data)
    rows = page[page.index('id="all-runs"') :].split("<tr>")[2:8]
    assert ["saw the truth: report of" in row for row in rows] == [True, True, False, False, False, False]
    assert all(f"saw the truth: report of {name}" in row for name, row in zip(caught, rows, strict=False))
