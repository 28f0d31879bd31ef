"""A harbour with boats: assets of a file of the user, placed, flown, drawn and scored, with no change to the bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from bench.camera import actors_in, look_of, open_camera
from bench.camera.sheet import pose_towards
from bench.campaign import load_campaign, load_measurable_decomposition, rescore
from bench.campaign.execution._flight import fly_here
from bench.campaign.planning._realizations import realizations
from bench.contracts import Outcome, cast_of
from bench.documents import dump_yaml, read_document
from bench.errors import SetupError
from bench.perception._labels import LabelOdds, false_labels
from bench.realization import check_placement, place
from bench.recording import read_simspec, read_tape
from bench.simspec import ASSETS, ActorGroup, AssetTable, Role, SimSpec, load_simspec
from bench.simspec._assets import packaged_assets
from test_ports.perception.detections import detection_share
from test_ports.reports.targets import targets_reported

BOATS = """
assets:
  speedboat: {class_label: boat, length_m: 9.0, width_m: 2.6, height_m: 1.9, role: adversary, confused_with: [fishing_boat]}
  trawler:
    class_label: fishing_boat
    length_m: 21.0
    width_m: 6.4
    height_m: 7.5
    role: bystander
    confused_with: [boat, building]
    solid: true
    possible_false_alarm: false
    look:
      paints: {body: ["#2040c0"]}
      postures:
        moored:
          - {frustum: [-9, 9, -2, 2, 0, -10, 10, -3, 3, 2], paint: body}
          - {box: [-8, -3, -2, 2, 2, 7], paint: "#f0f0f0"}
"""

HARBOUR = """
format: rebar.simspec/1
name: harbour
world: {area: {corners: [{east_m: -90, north_m: -90}, {east_m: 90, north_m: -90}, {east_m: 90, north_m: 90}, {east_m: -90, north_m: 90}]}}
vehicle: {home: {east_m: -70, north_m: -70}}
assets: boats.yaml
actors:
  - {id: smuggler, asset: speedboat, count: 1, color: red, placement: {at: {east_m: 40, north_m: 30, heading_deg: 90}}}
  - {id: crew, asset: trawler, count: 1, placement: {near: {of: smuggler, min_m: 30, max_m: 70}}}
intelligence: [{id: sighting, about: smuggler, uncertainty_m: 40}]
mission: {altitude_m: 50, time_limit_s: 150}
perception: {mode: perfect}
"""


def written(folder: Path, boats: str = BOATS, harbour: str = HARBOUR) -> Path:
    """The file of the harbour, beside that of its boats."""
    (folder / "boats.yaml").write_text(boats)
    (folder / "harbour.yaml").write_text(harbour)
    return folder / "harbour.yaml"


@pytest.fixture(scope="module")
def harbour(tmp_path_factory: pytest.TempPathFactory) -> SimSpec:
    """The harbour, placed; its file of boats is gone."""
    folder = tmp_path_factory.mktemp("harbour")
    simspec = place(load_simspec(written(folder)))
    (folder / "boats.yaml").unlink()
    return simspec


def test_two_boats_are_placed_with_their_sizes_and_roles(harbour: SimSpec) -> None:
    assert [group.role for group in harbour.actors] == [Role.ADVERSARY, Role.BYSTANDER]
    smuggler, trawler = cast_of(harbour)
    assert (smuggler.class_label, smuggler.length_m) == ("boat", 9.0)
    assert (trawler.class_label, trawler.width_m) == ("fishing_boat", 6.4)
    assert check_placement(harbour) == []


def test_a_placed_simspec_needs_its_file_no_more(harbour: SimSpec) -> None:
    assert SimSpec.model_validate_json(harbour.model_dump_json()) == harbour
    assert [*harbour.assets] == ["speedboat", "trawler"]
    assert "boat" in harbour.class_labels
    assert "boat" not in {asset.class_label for asset in ASSETS.values()}
    assert "boat" in false_labels(harbour)
    assert "fishing_boat" not in false_labels(harbour)
    odds = [LabelOdds.of(harbour.perception.model, member).labels for member in cast_of(harbour)]
    assert odds == [("fishing_boat",), ("boat", "building")]


def test_both_boats_are_flown_over_detected_and_scored(harbour: SimSpec, tmp_path: Path) -> None:
    """With perfect perception the agent finds the boat of the class that it is told, and the recording alone is scored."""
    decomposition = load_measurable_decomposition("search-and-report")
    result = fly_here(harbour, decomposition, tmp_path, "harbour")
    assert result.outcome is Outcome.COMPLETED, result.reason
    simspec, tape = read_simspec(tmp_path / "recording.mcap"), read_tape(tmp_path / "recording.mcap")
    assert simspec == harbour
    assert [member.class_label for member in tape.cast] == ["boat", "fishing_boat"]
    for asset in ("speedboat", "trawler"):
        assert detection_share.find(tape, simspec, role="any", asset=asset).x == pytest.approx(1.0, abs=0.05)
    assert targets_reported.find(tape, simspec).x == 1.0
    assert rescore(tmp_path, decomposition).observations == result.observations


def test_both_boats_are_drawn_in_their_sizes_and_colours(harbour: SimSpec) -> None:
    cast, random = cast_of(harbour), np.random.default_rng(1)
    for member in cast:
        corners = look_of(member, 0.0, random, np.zeros(3)).geometry.corners_m.reshape(-1, 3)
        extent = corners.max(axis=0) - corners.min(axis=0)
        assert extent == pytest.approx((member.length_m, member.width_m, member.height_m))
    assert harbour.realized is not None
    places = np.array([(actor.east_m, actor.north_m, 0.0) for actor in harbour.realized.actors])
    headings = np.radians([actor.heading_deg for actor in harbour.realized.actors])
    middle = places.mean(axis=0)
    pose = pose_towards(middle + np.array((0.0, -60.0, 60.0)), middle)
    frame = open_camera(harbour).capture(pose, places, headings, number=0)
    assert frame is not None
    instances = frame.picture.instances()
    assert [pixels.actor for pixels in actors_in(frame.picture)] == [0, 1]
    red, blue = (frame.bgr[instances == 1 + actor].mean(axis=0) for actor in (0, 1))
    assert red[2] > 1.5 * red[0]
    assert blue[0] > blue[2]


def test_a_look_without_height_is_named(tmp_path: Path) -> None:
    flat = BOATS.replace("2, 2, 7]", "2, 2, 2]").replace("0, -10, 10, -3, 3, 2]", "2, -10, 10, -3, 3, 2]")
    _, trawler = cast_of(place(load_simspec(written(tmp_path, flat))))
    with pytest.raises(SetupError, match=r"assets\.trawler\.look: its solids are flat"):
        look_of(trawler, 0.0, np.random.default_rng(1), np.zeros(3))


def test_an_asset_of_a_simspec_goes_before_the_catalogues(harbour: SimSpec) -> None:
    """So that a name which the catalogue gets later does not change an older recording."""
    document: dict[str, Any] = harbour.model_dump(mode="json") | {"realized": None}
    document["assets"]["house"] = document["assets"]["speedboat"] | {"solid": True}
    document["actors"] = [{"id": "a", "asset": "house", "count": 1}, {"id": "b", "asset": "shed", "count": 1}]
    document["intelligence"] = []
    own = SimSpec.model_validate(document)
    kinds = [(group.role, group.definition.length_m) for group in own.actors]
    assert kinds == [(Role.ADVERSARY, 9.0), (Role.CLUTTER, 5.0)]


def test_a_campaign_keeps_the_assets_of_its_base(tmp_path: Path) -> None:
    written(tmp_path)
    campaign_file = tmp_path / "campaign.yaml"
    campaign_file.write_text(
        "format: rebar.campaign/1\nname: harbour\nbase_file: harbour.yaml\ndecomposition: search-and-report\n"
        "agents: [{manifest: reference-naive}]\n"
        "design: {method: {kind: full_factorial}, factors: [{name: second, levels: [trawler, speedboat], sets: ['actors[crew].asset']}]}\n"
    )
    base = load_campaign(campaign_file).base
    assert base is not None
    assert [*base.assets] == ["speedboat", "trawler"]
    plans = realizations(load_campaign(campaign_file))
    assert [plan.simspec.group("crew").definition.length_m for plan in plans] == [21.0, 9.0]
    (tmp_path / "boats.yaml").unlink()
    copy = tmp_path / "copy.yaml"
    copy.write_text(dump_yaml(base))
    assert load_simspec(copy) == base


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("length_m: 9.0", "length_m: -9.0", r"boats\.yaml:3: assets\.speedboat\.length_m"),
        ("width_m: 6.4", "widht_m: 6.4", r"boats\.yaml.*did you mean width_m\?"),
        ("[fishing_boat]", "[whale]", "assets.speedboat.confused_with: 'whale' is no class"),
        ("paint: body", "paint: bodi", r"look\.postures\.moored\[0\]: no paint 'bodi'"),
        ('"#2040c0"', "blue", "look.paints.body: .*write colours as #rrggbb"),
        ("frustum: [-9, 9, -2, 2, 0, -10, 10, -3, 3, 2]", "use: hull", "no parts here"),
        ("boats.yaml", "boat.yaml", r"boat\.yaml: there is no such file \(did you mean boats"),
        (
            "    role: bystander\n",
            "",
            r"actors\[1\]\.role: is missing, and asset 'trawler' states none: add it",
        ),
        (
            "asset: trawler",
            "asset: barge",
            r"actors\[1\]\.asset: there is no asset 'barge' \(the catalogue has",
        ),
        ("asset: trawler", "asset: barge, role: clutter", r"actors\[1\]\.asset: there is no asset 'barge'"),
        (
            *("mode: perfect", "model: {false_labels: {dragon: 0.5}}"),
            r"perception\.model\.false_labels: 'dragon' is no class label; known: .*boat",
        ),
        (
            *("mode: perfect", "model: {confusion: {boat: {soldier: 0.5}}}"),
            r"perception\.model\.confusion: 'soldier' is no class label",
        ),
    ],
)
def test_faults_name_file_asset_field_and_fix(tmp_path: Path, right: str, wrong: str, message: str) -> None:
    assert right in BOATS + HARBOUR
    with pytest.raises(SetupError, match=message):
        load_simspec(written(tmp_path, BOATS.replace(right, wrong), HARBOUR.replace(right, wrong)))


def test_a_file_of_assets_can_be_named_in_a_file_alone() -> None:
    with pytest.raises(ValidationError, match="can be named only in a file"):
        SimSpec.model_validate({"name": "a", "world": {}, "assets": "boats.yaml"})


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (BOATS, r"second\.yaml \(package second\): .*of these names: speedboat, trawler \(name them other"),
        (BOATS.replace("speedboat", "bus").replace("trawler", "ferry"), "assets of these names: bus"),
        (None, r"'second' of second is None, and no path of a file"),
    ],
)
def test_packages_whose_assets_clash_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, second: str | None, message: str
) -> None:
    other = None if second is None else tmp_path / "second.yaml"
    paths: dict[str, Path | None] = {"first": tmp_path / "first.yaml", "second": other}
    (tmp_path / "first.yaml").write_text(BOATS)
    (tmp_path / "second.yaml").write_text(second or "")
    # Installing packages takes seconds for each; test_plugins_outside installs one.
    monkeypatch.setattr("bench.plugins.plugins", lambda group: paths)
    monkeypatch.setattr("bench.plugins.load_plugin", lambda group, name: paths[name])
    monkeypatch.setattr("bench.plugins.package_of", lambda group, name: name)
    with pytest.raises(SetupError, match=message):
        packaged_assets.__wrapped__()


def test_the_example_of_the_docs_is_a_file_of_assets() -> None:
    page = (Path(__file__).parents[1] / "docs" / "simspec.md").read_text()
    example = page.partition("# boats.yaml;")[2].partition("```")[0].partition("\n")[2]
    assert [*read_document(example, AssetTable).assets] == ["speedboat", "trawler"]


def test_the_catalogue_is_a_file_that_users_can_copy(tmp_path: Path) -> None:
    """Every asset of it has a role, so that a group of it needs none."""
    assert AssetTable(assets=ASSETS).assets == ASSETS
    for name, asset in ASSETS.items():
        group = ActorGroup.model_validate({"id": "a", "asset": name, "count": 1})
        assert group.role is asset.role is not None
