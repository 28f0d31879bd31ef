"""The SimSpec as a document: what is taken, what is refused, and how the refusal reads."""

import datetime as dt
import json
from pathlib import Path

import pytest

from bench.documents import dump_json, dump_yaml, load_document, read_document, read_json_document
from bench.errors import SetupError
from bench.simspec import Environment, SimSpec, agent_name, load_simspec


def box(west: float, south: float, east: float, north: float) -> str:
    """A rectangle as a polygon in YAML."""
    corners = ((west, south), (east, south), (east, north), (west, north))
    return "{corners: [" + ", ".join(f"{{east_m: {x}, north_m: {y}}}" for x, y in corners) + "]}"


PLAIN = f"name: x\nworld: {{area: {box(0, 0, 100, 100)}}}\n"
GOVERNED = f"""{PLAIN}actors: [{{id: radar, asset: radar-vehicle, role: adversary, count: 1}}]
intelligence: [{{id: first, about: radar}}, {{id: late, about: radar, delivered_s: 50}}]
mission: {{altitude_m: 60, time_limit_s: 100}}
"""
ASKED = "rules: {mark_consent: true}\n"


def faults(text: str) -> list[str]:
    with pytest.raises(SetupError) as caught:
        read_document(text, SimSpec, source="scene.yaml")
    return [str(fault) for fault in caught.value.faults]


def test_minimal_simspec_is_a_name_and_an_area() -> None:
    """Everything else has a usable default."""
    spec = read_document(PLAIN, SimSpec)
    assert spec.world.area.area_m2 == pytest.approx(10_000.0)
    assert spec.pace.mode == "lockstep"


def test_every_fault_is_reported_at_once() -> None:
    """A file with ten faults gives ten messages, each with its line."""
    text = """name: Bad Name
world:
  area: {corners: [{east_m: 0, north_m: 0}]}
  aera: 1
environment:
  fog_level: 10
  rain_level: -1
mission:
  altitud_m: 30
  speed_mps: -1
actors:
- {id: people, asset: civilian, role: passerby, count: 3}
- {id: more, asset: civilian, role: bystander, density_per_km2: -4}
- {id: both, asset: civilian, role: bystander, count: 1, density_per_km2: 4}
"""
    messages = faults(text)
    assert len(messages) == 10
    assert all(message.startswith("scene.yaml:") for message in messages)
    assert "scene.yaml:4: world.aera: unknown field 'aera' (did you mean area?)" in messages
    for begin, words in (
        ("scene.yaml:9: mission.altitud_m", "altitude_m"),
        ("scene.yaml:13: actors[1].density_per_km2: -4", ""),
        ("", "either count or density_per_km2"),
    ):
        assert any(message.startswith(begin) and words in message for message in messages)


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ("[{id: a, placement: {near: {of: b, max_m: 5}}}]", "relates to 'b'"),
        ("[{id: a}, {id: a}]", "used twice"),
        ("[{id: a, motion: {kind: patrol}}]", "route"),
    ],
)
def test_groups_that_contradict_themselves_are_named(extra: str, words: str) -> None:
    group = "{asset: civilian, role: bystander, count: 1, id: "
    assert any(words in message for message in faults(f"{PLAIN}actors: {extra.replace('{id: ', group)}\n"))


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ("intelligence: [{id: r, about: nobody}]", "about group 'nobody'"),
        ("mission: {altitude_m: 150}", "max_altitude_m"),
        ("seeds: {root: -1}", "greater than or equal to 0"),
        ("environment: {wind: {speed_mps: .nan}}", "finite"),
        ("budgets: {wall_s: .inf}", "finite"),
        ("vehicle: {camera: {gimbal: true, stabilized: false}}", "keeps the camera level"),
        ("vehicle: {more_cameras: [{}]}", "'front' stands twice; give each camera its own name"),
        ("vehicle: {more_cameras: [{name: b, mavlink: true}]}", "more_cameras[0].mavlink: only the main"),
        ("vehicle: {more_cameras: [{name: b, gimbal: true}]}", "set gimbal of vehicle.camera to true too"),
        (
            "vehicle: {camera: {gimbal: true}, more_cameras: [{name: b, gimbal: true, tilt_deg: 20}]}",
            "give it the tilt_deg of vehicle.camera, 60",
        ),
        # A MAVLink link has IPv4 alone; a service may have either, without brackets.
        ("vehicle: {outside_links: [{name: a, host: '::1'}]}", "no IPv6; give an IPv4 address or a name"),
        ("vehicle: {outside_links: [{name: a, host: '[::1]'}]}", "links have no IPv6"),
        ("vehicle: {outside_links: [{name: a, host: '127.0.0.1:14550'}]}", "without port"),
        ("agent: {services: [{name: a, host: '[::1]', port: 80}]}", "write api.example.org, 127.0.0.1"),
    ],
)
def test_contradictions_are_named(extra: str, words: str) -> None:
    """Contradictions that a JSON Schema cannot express are found as well, with the field and the fix."""
    assert any(words in message for message in faults(f"{PLAIN}{extra}\n"))


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (
            "orders: [{id: o, at_s: 100, kind: hold}]",
            "100 s comes after the end: mission.time_limit_s is 100",
        ),
        ("orders: [{id: o, at_s: 1, kind: hold}, {id: o, at_s: 2, kind: resume}]", "'o' is used twice"),
        ("orders: [{id: o, at_s: 1, kind: mark, intelligence: second}]", "not one of ['first', 'late']"),
        ("orders: [{id: o, at_s: 1, kind: mark, intelligence: late}]", "is not delivered before 50 s"),
        ("orders: [{id: o, at_s: 1, kind: dance}]", "'hold'"),
        ("orders: [{id: o, at_s: 1, kind: hand_over}]", "hands over for good: add take_back"),
        ("orders: [{id: o, at_s: 1, kind: take_back}]", "takes back what was not handed over"),
        (
            "orders: [{id: o, at_s: 1, kind: hand_over, within_s: 8}, {id: p, at_s: 9, kind: take_back}]",
            "order 'p' at 9 s must come after 'o' is due, at 9 s",
        ),
        (
            "orders: [{id: o, at_s: 1, kind: hand_over}, {id: p, at_s: 9, kind: hold}, {id: q, at_s: 20, kind: take_back}]",
            "order 'p' (hold) comes while the operator has the vehicle, after 'o'; put take_back first",
        ),
        ("outages: [{kind: detections_degraded, at_s: 1, duration_s: 2}]", "needs lost_share"),
        ("outages: [{kind: detections, at_s: 1, duration_s: 2, lost_share: 0.5}]", "needs lost_share"),
        ("outages: [{kind: detections, at_s: 90, duration_s: 20}]", "from 90 to 110 s lasts past the end"),
        ("rules: {bystander_slow_mps: 3}", "give both or neither"),
        ("rules: {bystander_slow_within_m: 3}", "give both or neither"),
        (f"rules: {{geofence: {box(10, 10, 90, 90)}}}", "rules.geofence: the geofence does not contain"),
        (f"rules: {{no_fly: [{{id: a, area: {box(-9, -9, 9, 9)}}}]}}", "no_fly[0]: no-fly area 'a' contains"),
        (
            f"rules: {{no_fly: [{{id: a, area: {box(5, 5, 9, 9)}, from_s: 9, until_s: 9}}]}}",
            "must exceed from_s 9",
        ),
        (
            f"rules: {{no_fly: [{', '.join([f'{{id: a, area: {box(5, 5, 9, 9)}}}'] * 2)}]}}",
            "'a' is used twice",
        ),
        ("rules: {min_altitude_m: 61}", "mission.altitude_m 60.0 is below rules.min_altitude_m 61.0"),
        ("rules: {min_altitude_m: 130}", "must be less than max_altitude_m 120"),
        ("rules: {report_windows: [{from_s: 9, until_s: 3}]}", "until_s 3 must exceed from_s 9"),
        (
            "rules: {report_windows: [{from_s: 9, until_s: 20}, {from_s: 3, until_s: 8}]}",
            "rules.report_windows[1]: begins at 3 s, before the window ahead of it ends at 20 s",
        ),
        ("rules: {link_lost: panic}", "'continue'"),
        ("consents: [{intelligence: first, answer: granted}]", "set rules.mark_consent"),
        (
            f"{ASKED}consents: [{{intelligence: second, answer: granted}}]",
            "which is not one of ['first', 'late']",
        ),
        (
            f"{ASKED}consents: [{{intelligence: late, answer: never}}, {{intelligence: late, answer: refused}}]",
            "'late' has two consents",
        ),
        (f"{ASKED}consents: [{{intelligence: late, answer: maybe}}]", "'granted'"),
    ],
)
def test_impossible_orders_outages_and_rules_are_refused(extra: str, words: str) -> None:
    """The message has the numbers that contradict each other."""
    assert any(words in message for message in faults(f"{GOVERNED}{extra}\n"))


def test_all_contradictions_are_reported_at_once() -> None:
    """An order, an outage, a height and a fence that are wrong are four messages, each with its line."""
    extra = f"""orders: [{{id: o, at_s: 200, kind: hold}}]
outages: [{{kind: operator_link, at_s: 99, duration_s: 2}}]
rules: {{min_altitude_m: 61, geofence: {box(10, 10, 90, 90)}}}
"""
    assert [message.split(" ")[:2] for message in faults(GOVERNED + extra)] == [
        ["scene.yaml:6:", "orders[0].at_s:"],
        ["scene.yaml:7:", "outages[0]:"],
        ["scene.yaml:5:", "mission.altitude_m:"],
        ["scene.yaml:8:", "rules.geofence:"],
    ]


def test_governed_example_has_orders_outages_and_rules() -> None:
    """The example to copy from has an order of each documented kind."""
    spec = load_simspec(Path(__file__).parents[2] / "examples" / "governed.yaml")
    assert {order.kind for order in spec.orders} == {"hold", "resume", "retask", "mark"}
    assert {outage.kind for outage in spec.outages} == {"operator_link"}
    assert spec.rules.geofence
    assert spec.rules.no_fly


def test_other_kind_of_document_is_one_fault() -> None:
    """A campaign in place of a SimSpec is one fault, not one for each unknown field."""
    assert faults("format: rebar.campaign/1\nname: fog\ndesign: {}\n") == [
        "scene.yaml: is a rebar.campaign/1 (name a rebar.simspec/1 here)"
    ]
    assert faults(f"format: simspec\n{PLAIN}") != ["scene.yaml: is a simspec (name a rebar.simspec/1 here)"]


def test_the_message_for_a_missing_file_suggests_a_similar_name(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text("name: x")
    with pytest.raises(SetupError, match=r"did you mean scene\.yaml"):
        load_simspec(tmp_path / "scen.yaml")


def test_unknown_asset_lists_the_catalogue(tmp_path: Path) -> None:
    """Assets are checked against the catalogue when a file is loaded."""
    path = tmp_path / "s.yaml"
    for role in ("role: clutter, ", ""):
        path.write_text(f"{PLAIN}actors: [{{id: a, asset: dragon, {role}count: 1}}]\n")
        with pytest.raises(SetupError, match=r"asset: there is no asset 'dragon'.*civilian"):
            load_simspec(path)


ROUTE = "route: [{east_m: 1, north_m: 1}, {east_m: 90, north_m: 1}]"
CONVOY = f"""{PLAIN}mission: {{time_limit_s: 200, escort: {{group: cars}}}}
actors:
- {{id: cars, asset: civilian-car, role: bystander, count: 2, motion: {{kind: patrol, pause_s: 0, depart_s: 9, {ROUTE}}}}}
- {{id: others, asset: civilian, role: bystander, count: 2}}
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("group: cars", "group: trucks", "mission.escort.group: escort names group 'trucks'"),
        ("bystander", "adversary", "actors[0].role: group 'cars' is escorted, so it is no adversary"),
        ("bystander", "sought", "actors[0].role: group 'cars' is escorted, so it is not sought: set role to"),
        ("count: 2", "count: 0", "actors[0].count: group 'cars' is escorted and may be empty"),
        ("group: cars", "group: others", "actors[1].motion.kind: group 'others' is escorted along a route"),
        ("pause_s: 0", "pause_s: 1", "actors[0].motion.pause_s: group 'cars' is escorted, and rests are"),
        ("depart_s: 9", "depart_s: 200", "motion.depart_s: escorted group 'cars' sets off after the end"),
        ("depart_s: 9", "depart_s: 9, halt_s: 9", "halt_s 9 must be later than depart_s 9"),
    ],
)
def test_an_escort_that_cannot_be_flown_is_refused(old: str, new: str, words: str) -> None:
    """The group, its role, its number and its motion, each with the field and what to write there."""
    messages = faults(CONVOY.replace(old, new, 1))
    assert any(words in message for message in messages), messages


@pytest.mark.parametrize(
    "text",
    [
        f"{PLAIN}environment: {{start_utc: 2026-06-21T11:30:00Z, fog_level: 0.1}}\n",
        CONVOY.replace("depart_s: 9", "depart_s: 9, halt_s: 90"),
        f"{PLAIN}{ASKED}",
        f"{PLAIN}vehicle: {{camera: {{gimbal: true}}, more_cameras: [{{name: down, tilt_deg: 90}}, {{name: zoom, gimbal: true}}]}}\n",
        f"{PLAIN}agent: {{services: [{{name: a, host: '::1', port: 80}}]}}\n",
    ],
)
def test_yaml_and_json_round_trips_are_exact(text: str, tmp_path: Path) -> None:
    """A document written and read again is the same document."""
    spec = read_document(text, SimSpec)
    for name, written in (("a.yaml", dump_yaml(spec)), ("a.json", dump_json(spec))):
        (tmp_path / name).write_text(written)
        assert load_document(tmp_path / name, SimSpec) == spec


def test_fields_of_later_versions_leave_no_trace_where_they_are_not_used() -> None:
    """Such SimSpecs keep the bytes, and so the digests, that they had before."""
    written = dump_json(read_document(GOVERNED, SimSpec))
    later = [
        *(
            "escort",
            "depart_s",
            "halt_s",
            "consent",
            "more_cameras",
            "distortion",
            "exposure_ev",
            "shutter_s",
        ),
        *("dust_level", "dust_extinction_per_m", '"visibility_m"', '"color"'),
    ]
    assert [word for word in later if word in written] == []
    assert "at" not in json.loads(written)["intelligence"][0]


def test_json_schema_forbids_unknown_fields() -> None:
    """As the model does; fields have their unit in their name."""
    schema = json.loads(json.dumps(SimSpec.model_json_schema()))
    assert schema["additionalProperties"] is False
    assert "altitude_m" in schema["$defs"]["Mission"]["properties"]


@pytest.mark.parametrize(
    "moment",
    [
        "0001-01-01T00:00:00Z",
        "0001-01-01T00:00:00+02:00",
        "9999-12-31T23:59:59-02:00",
        "1981-01-01T01:59:59+02:00",
        "1980-12-31T23:59:59Z",
        "2100-01-01T00:00:00Z",
    ],
)
def test_start_outside_gps_years_is_refused(moment: str) -> None:
    """Years before 1981 and after 2099 are refused when the file is read, not during the flight."""
    assert (
        "year of start_utc must be 1981 to 2099"
        in faults(f"{PLAIN}environment: {{start_utc: '{moment}'}}")[0]
    )


MOMENT = dt.datetime(2026, 6, 21, 11, 30, tzinfo=dt.UTC)


@pytest.mark.parametrize(
    "spelling",
    [
        "2026-06-21T11:30:00Z",
        "2026-06-21t11:30:00z",
        "2026-06-21 11:30:00Z",
        "2026-06-21 11:30Z",
        "2026-06-21T11:30:00.000+00:00",
        "2026-06-21T13:30:00+02:00",
        "2026-06-21 04:00-07:30",
        "2026-06-21T11:30:00",
        "2026-06-21T11:30",
        "2026-06-21 11:30:00",
        "2026-06-21 11:30",
        "20260621T1130",
    ],
)
def test_a_moment_in_any_spelling(spelling: str) -> None:
    """Plain, in quotes, as JSON and from Python: one moment, and UTC where no zone is stated."""
    for text in (f"start_utc: {spelling}", f"start_utc: '{spelling}'", f'{{"start_utc": "{spelling}"}}'):
        assert read_document(text, Environment).start_utc == MOMENT
    assert read_json_document(f'{{"start_utc": "{spelling}"}}', Environment).start_utc == MOMENT
    assert Environment(start_utc=MOMENT.replace(tzinfo=None)).start_utc == MOMENT
    assert Environment(start_utc=MOMENT).model_dump_json() == Environment().model_dump_json()


@pytest.mark.parametrize(
    "spelling",
    ["2026-06-21", "11:30", "1782041400", "1782041400.0", "true", "~", "2026", "soon", "2026-02-30T11:30"],
)
def test_a_moment_that_is_none(spelling: str) -> None:
    """A date alone does not say where the sun is, and a number could be seconds or milliseconds since 1970."""
    for text in (spelling, f"'{spelling}'"):
        with pytest.raises(SetupError, match=r"write 2026-06-21T11:30:00Z|in the unit of the field"):
            read_document(f"start_utc: {text}", Environment)
    with pytest.raises(ValueError, match="no date with a time of day"):
        Environment.model_validate({"start_utc": dt.date(2026, 6, 21)})


def test_a_manifest_is_looked_up_from_the_simspec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path by its slash or suffix; the name of an entry point stays, also beside a folder of that name."""
    (tmp_path / "reference-naive").mkdir()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").mkdir()
    for manifest, located in {
        "mine.yaml": f"{tmp_path}/a/mine.yaml",
        "./agents/mine": f"{tmp_path}/a/agents/mine",
        "/agents/mine.json": "/agents/mine.json",
        "reference-naive": "reference-naive",
    }.items():
        (tmp_path / "a" / "scene.yaml").write_text(f"{PLAIN}agent: {{manifest: {manifest}}}\n")
        spec = load_simspec("a/scene.yaml")
        assert (spec.agent.manifest, spec.agent.label) == (located, agent_name(manifest))
