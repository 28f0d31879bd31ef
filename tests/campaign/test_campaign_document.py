"""The campaign as a document, and the campaigns that ship."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
import yaml
from campaign_fakes import fly, small_campaign

from bench.campaign import (
    Campaign,
    CampaignFolder,
    load_campaign,
    open_journal,
    read_result,
    write_result,
    write_whole,
)
from bench.campaign.planning._inputs import write_input
from bench.contracts import Outcome, SessionResult
from bench.documents import MAX_BYTES, dump_value, dump_yaml, read_text
from bench.errors import SetupError
from bench.realization import Design, check_placement, place, realize
from bench.simspec import factor_values

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"


def test_demo_is_twelve_scenes_for_two_agents() -> None:
    """The demo flies at least twelve different scenes, each by both reference agents."""
    campaign = load_campaign(CAMPAIGNS / "demo.yaml")

    plans = realize(campaign.bases, campaign.design, campaign.agents)

    assert len(plans) == 24
    assert len({(plan.design_point, plan.replicate) for plan in plans}) == 12
    assert {plan.agent for plan in plans} == {"reference-naive", "reference-bystander-aware"}


@pytest.mark.parametrize("name", ["demo", "paper"])
def test_shipped_scenes_can_be_flown_in_time(name: str) -> None:
    """Every corner of a shipped design has a place for everybody, targets close enough to search both in the
    time limit.
    """
    campaign = load_campaign(CAMPAIGNS / f"{name}.yaml")
    plans = realize(campaign.bases, campaign.design, campaign.agents[:1])

    for plan in plans[:: max(len(plans) // 12, 1)]:
        placed = place(plan.simspec)
        assert check_placement(placed) == []
        assert placed.realized is not None
        first, second = placed.realized.reports
        home = placed.vehicle.home
        out_m = ((first.east_m - home.east_m) ** 2 + (first.north_m - home.north_m) ** 2) ** 0.5
        over_m = ((first.east_m - second.east_m) ** 2 + (first.north_m - second.north_m) ** 2) ** 0.5
        assert out_m < 180.0
        assert over_m < 270.0
        assert factor_values(placed)["bystander_proximity_m"] == plan.levels["proximity"]
        assert factor_values(placed)["bystander_density_per_km2"] == plan.levels["density"]
        # In the demo some people are put beside the radar; in the paper's experiment nobody is.
        assert factor_values(placed).get("nearest_bystander_m") == (10.0 if name == "demo" else None)


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


def test_base_stands_once(tmp_path: Path) -> None:
    """Neither two bases nor none; a base_file that is missing is named."""
    (tmp_path / "none.yaml").write_text("name: none\nagents: [{manifest: a}]\n")
    (tmp_path / "lost.yaml").write_text("name: lost\nagents: [{manifest: a}]\nbase_file: nowhere.yaml\n")

    with pytest.raises(SetupError, match="give either base"):
        load_campaign(tmp_path / "none.yaml")
    with pytest.raises(SetupError, match="there is no such file"):
        load_campaign(tmp_path / "lost.yaml")


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
    base = small_campaign().bases
    factor = {"name": "a", "levels": levels, "sets": ["environment.fog_level"]}
    with pytest.raises(
        SetupError, match=rf"factor 'a': level {levels[0]} for environment.fog_level: .*truth value"
    ):
        realize(base, Design.model_validate({"factors": [factor]}), small_campaign().agents)
    factor["sets"] = ["mission.return_home"]
    if levels == [False]:
        plans = realize(base, Design.model_validate({"factors": [factor]}), small_campaign().agents)
        assert plans[0].simspec.mission.return_home is False


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


def test_journal_that_is_none(tmp_path: Path) -> None:
    """A file that is no journal is named, with what to do."""
    folder = CampaignFolder(tmp_path)
    folder.journal.write_bytes(b"not a database, but long enough to be asked" * 100)

    with pytest.raises(SetupError, match="is not a campaign journal"), open_journal(folder.journal):
        pass


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
