"""The SimSpec as a document: what is taken, what is refused, and how the refusal reads."""

import datetime as dt
import json
from pathlib import Path

import pytest

from bench.documents import dump_json, dump_yaml, load_document, parse_text, read_document, read_json_document
from bench.errors import SetupError
from bench.simspec import Environment, Rules, SimSpec, agent_name, load_simspec

SQUARE = "world: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 100, north_m: 0}, {east_m: 100, north_m: 100}, {east_m: 0, north_m: 100}]}}\n"


def faults(text: str) -> list[str]:
    with pytest.raises(SetupError) as caught:
        read_document(text, SimSpec, source="scene.yaml")
    return [str(fault) for fault in caught.value.faults]


def test_minimal_simspec_is_a_name_and_an_area() -> None:
    """Everything else has a usable default."""
    spec = read_document("name: small\n" + SQUARE, SimSpec)
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
    assert any(
        message.startswith("scene.yaml:9: mission.altitud_m") and "altitude_m" in message
        for message in messages
    )
    assert any(message.startswith("scene.yaml:13: actors[1].density_per_km2: -4") for message in messages)
    assert any("either count or density_per_km2" in message for message in messages)


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (
            "actors: [{id: a, asset: civilian, role: bystander, count: 1, placement: {near: {of: b, max_m: 5}}}]\n",
            "relates to 'b'",
        ),
        (
            "actors: [{id: a, asset: civilian, role: bystander, count: 1}, {id: a, asset: tree, role: clutter, count: 1}]\n",
            "used twice",
        ),
        ("intelligence: [{id: r, about: nobody}]\n", "about group 'nobody'"),
        ("mission: {altitude_m: 150}\n", "max_altitude_m"),
        ("actors: [{id: a, asset: civilian, role: bystander, count: 1, motion: {kind: patrol}}]\n", "route"),
        ("seeds: {root: -1}\n", "greater than or equal to 0"),
        ("environment: {wind: {speed_mps: .nan}}\n", "finite"),
        ("budgets: {wall_s: .inf}\n", "finite"),
    ],
)
def test_contradictions_are_named(extra: str, words: str) -> None:
    """Contradictions that a JSON Schema cannot express are found as well."""
    assert any(words in message for message in faults("name: x\n" + SQUARE + extra))


GOVERNED = """name: governed
world: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 100, north_m: 0}, {east_m: 100, north_m: 100}, {east_m: 0, north_m: 100}]}}
actors: [{id: radar, asset: radar-vehicle, role: adversary, count: 1}]
intelligence: [{id: first, about: radar}, {id: late, about: radar, delivered_s: 50}]
mission: {altitude_m: 60, time_limit_s: 100}
"""


def box(west: float, south: float, east: float, north: float) -> str:
    """A rectangle as a polygon in YAML."""
    corners = ((west, south), (east, south), (east, north), (west, north))
    return "{corners: [" + ", ".join(f"{{east_m: {x}, north_m: {y}}}" for x, y in corners) + "]}"


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (
            "orders: [{id: o, at_s: 100, kind: hold}]",
            "order 'o' at 100 s comes after the end: mission.time_limit_s is 100",
        ),
        (
            "orders: [{id: o, at_s: 1, kind: hold}, {id: o, at_s: 2, kind: resume}]",
            "order id 'o' is used twice",
        ),
        ("orders: [{id: o, at_s: 1, kind: retask}]", "retask needs intelligence"),
        ("orders: [{id: o, at_s: 1, kind: hold, intelligence: first}]", "hold takes no intelligence"),
        (
            "orders: [{id: o, at_s: 1, kind: mark, intelligence: second}]",
            "'second', which is not one of ['first', 'late']",
        ),
        ("orders: [{id: o, at_s: 1, kind: mark, intelligence: late}]", "which is not delivered before 50 s"),
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
        (
            f"rules: {{geofence: {box(10, 10, 90, 90)}}}",
            "rules.geofence: the geofence does not contain vehicle.home",
        ),
        (
            f"rules: {{no_fly: [{{id: a, area: {box(-9, -9, 9, 9)}}}]}}",
            "rules.no_fly[0]: no-fly area 'a' contains vehicle.home",
        ),
        (
            f"rules: {{no_fly: [{{id: a, area: {box(5, 5, 9, 9)}, from_s: 9, until_s: 9}}]}}",
            "until_s 9 must exceed from_s 9",
        ),
        (
            f"rules: {{no_fly: [{', '.join([f'{{id: a, area: {box(5, 5, 9, 9)}}}'] * 2)}]}}",
            "no_fly id 'a' is used twice",
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
            "rules: {mark_consent: true}\nconsents: [{intelligence: second, answer: granted}]",
            "'second', which is not one of ['first', 'late']",
        ),
        (
            "rules: {mark_consent: true}\nconsents: [{intelligence: late, answer: never}, {intelligence: late, answer: refused}]",
            "'late' has two consents",
        ),
        ("rules: {mark_consent: true}\nconsents: [{intelligence: late, answer: maybe}]", "'granted'"),
    ],
)
def test_impossible_orders_outages_and_rules_are_refused(extra: str, words: str) -> None:
    """The message has the numbers that contradict each other."""
    assert any(words in message for message in faults(GOVERNED + extra + "\n"))


def test_all_contradictions_are_reported_at_once() -> None:
    """An order, an outage, a height and a fence that are wrong are four messages, each with its line."""
    extra = f"""orders: [{{id: o, at_s: 200, kind: hold}}]
outages: [{{kind: operator_link, at_s: 99, duration_s: 2}}]
rules: {{min_altitude_m: 61, geofence: {box(10, 10, 90, 90)}}}
"""
    messages = [message.split(" ")[:2] for message in faults(GOVERNED + extra)]
    assert messages == [
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
    assert {group.asset for group in spec.actors if group.role == "bystander"} == {
        "civilian",
        "child",
        "aid-worker",
    }
    assert spec.rules.geofence
    assert spec.rules.no_fly


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name: [", "not valid YAML"),
        ("name: a\nname: b\n", "stands here twice"),
        ("a: &x [1]\nb: *x\n", "aliases"),
        ("", "None is not valid"),
        ("- 1\n", "not valid"),
        ("!!python/object/apply:os.system ['true']", "tags ("),
        ("[" * 5000, "scene.yaml"),
    ],
)
def test_malformed_text_is_reported_without_a_traceback(text: str, words: str) -> None:
    """Broken syntax, duplicate keys, aliases, hostile tags and very deep nesting."""
    assert any(words in message for message in faults(text))


def test_other_kind_of_document_is_one_fault() -> None:
    """A campaign in place of a SimSpec is one fault, not one for each unknown field."""
    assert faults("format: rebar.campaign/1\nname: fog\ndesign: {}\n") == [
        "scene.yaml: is a rebar.campaign/1 (name a rebar.simspec/1 here)"
    ]
    assert faults("format: simspec\n" + SQUARE) != ["scene.yaml: is a simspec (name a rebar.simspec/1 here)"]


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    """The message for a missing file suggests a similar name; binary files and folders are refused."""
    (tmp_path / "scene.yaml").write_text("name: x")
    with pytest.raises(SetupError, match=r"did you mean scene\.yaml"):
        load_simspec(tmp_path / "scen.yaml")
    (tmp_path / "raw").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SetupError, match="cannot be read"):
        load_simspec(tmp_path / "raw")
    with pytest.raises(SetupError, match="cannot be read"):
        load_simspec(tmp_path)


def test_unknown_asset_lists_the_catalogue(tmp_path: Path) -> None:
    """Assets are checked against the catalogue when a file is loaded."""
    path = tmp_path / "s.yaml"
    for role in ("role: clutter, ", ""):
        path.write_text("name: x\n" + SQUARE + f"actors: [{{id: a, asset: dragon, {role}count: 1}}]\n")
        with pytest.raises(SetupError, match=r"asset: there is no asset 'dragon'.*civilian"):
            load_simspec(path)


def test_yaml_and_json_round_trips_are_exact(tmp_path: Path) -> None:
    """A document written and read again is the same document."""
    spec = read_document(
        "name: x\n" + SQUARE + "environment: {start_utc: 2026-06-21T11:30:00Z, fog_level: 0.1}\n", SimSpec
    )
    for name, text in (("a.yaml", dump_yaml(spec)), ("a.json", dump_json(spec))):
        (tmp_path / name).write_text(text)
        assert load_document(tmp_path / name, SimSpec) == spec


CONVOY = (
    "name: convoy\n"
    + SQUARE
    + "mission: {time_limit_s: 200, escort: {group: cars}}\n"
    + "actors:\n- {id: cars, asset: civilian-car, role: ROLE, count: 2, motion: MOTION}\n"
    + "- {id: others, asset: civilian, role: bystander, count: 2}\n"
)
ROUTE = "route: [{east_m: 1, north_m: 1}, {east_m: 90, north_m: 1}]"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("group: cars", "group: trucks"),
            "mission.escort.group: escort names group 'trucks', which is not one of",
        ),
        (
            ("ROLE", "adversary"),
            "actors[0].role: group 'cars' is escorted, so it is no adversary: set role to bystander",
        ),
        (("ROLE", "sought"), "actors[0].role: group 'cars' is escorted, so it is not sought: set role to"),
        (
            ("count: 2, motion", "count: 0, motion"),
            "actors[0].count: group 'cars' is escorted and may be empty",
        ),
        (
            ("group: cars", "group: others"),
            "actors[1].motion.kind: group 'others' is escorted along a route: set motion.kind",
        ),
        (
            ("pause_s: 0", "pause_s: 1"),
            "actors[0].motion.pause_s: group 'cars' is escorted, and rests are drawn",
        ),
        (
            ("depart_s: 9", "depart_s: 200"),
            "actors[0].motion.depart_s: escorted group 'cars' sets off after the end",
        ),
        (("depart_s: 9", "depart_s: 9, halt_s: 9"), "halt_s 9 must be later than depart_s 9"),
    ],
)
def test_an_escort_that_cannot_be_flown_is_refused(change: tuple[str, str], words: str) -> None:
    """The group, its role, its number and its motion, each with the field and what to write there."""
    motion = f"{{kind: patrol, pause_s: 0, depart_s: 9, {ROUTE}}}"
    text = CONVOY.replace(*change).replace("ROLE", "bystander").replace("MOTION", motion).replace(*change)
    assert any(words in message for message in faults(text)), faults(text)


def test_an_escort_leaves_no_trace_where_there_is_none() -> None:
    """SimSpecs without escort, departure and halt keep their bytes; one with them is read back."""
    plain = dump_json(read_document("name: plain\n" + SQUARE, SimSpec))
    assert not any(word in plain for word in ("escort", "depart_s", "halt_s"))
    motion = f"{{kind: patrol, pause_s: 0, depart_s: 9, halt_s: 90, {ROUTE}}}"
    spec = read_document(CONVOY.replace("ROLE", "bystander").replace("MOTION", motion), SimSpec)
    assert spec.mission.escort is not None
    assert read_document(dump_json(spec), SimSpec) == spec


def test_consent_leaves_no_trace_where_it_is_not_asked_for() -> None:
    """A SimSpec without the rule keeps the bytes, and so the digests, that it had before there was one."""
    plain = read_document("name: x\n" + SQUARE, SimSpec)
    assert "consent" not in dump_json(plain)
    asked = plain.model_copy(update={"rules": Rules(mark_consent=True)})
    assert read_document(dump_json(asked), SimSpec).rules.mark_consent


def test_json_has_line_numbers_too() -> None:
    """The YAML parser reads JSON, line numbers included."""
    _, lines = parse_text('{"a":\n {"b": [1,\n 2]}}')
    assert lines["a", "b", 1] == 3


def test_json_schema_forbids_unknown_fields() -> None:
    """As the model does; fields have their unit in their name."""
    schema = json.loads(json.dumps(SimSpec.model_json_schema()))
    assert schema["additionalProperties"] is False
    assert "altitude_m" in schema["$defs"]["Mission"]["properties"]


def test_failures_have_the_fields_of_their_kind() -> None:
    """A failure that lacks a field, or has a field of another kind, is refused; a gimbal must be
    stabilized.
    """
    whole = "vehicle: {failures: [{at_s: 3, kind: gps_off, duration_s: 5}, {at_s: 4, kind: motor_off, instance: 1}]}\n"
    assert [
        failure.kind for failure in read_document("name: a\n" + SQUARE + whole, SimSpec).vehicle.failures
    ] == [
        "gps_off",
        "motor_off",
    ]
    for wrong, words in (
        ("{at_s: 1, kind: motor_off}", "motor_off needs instance"),
        ("{at_s: 1, kind: gps_off, instance: 2}", "gps_off takes no instance"),
        ("{at_s: 1, kind: battery_drop}", "battery_drop needs to_fraction"),
    ):
        assert words in faults(f"name: a\n{SQUARE}vehicle: {{failures: [{wrong}]}}\n")[0]
    assert (
        "keeps the camera level"
        in faults(f"name: a\n{SQUARE}vehicle: {{camera: {{gimbal: true, stabilized: false}}}}\n")[0]
    )


def test_further_cameras_fit_the_main_one() -> None:
    """Each fault names the field and the fix; without further cameras nothing of them is written."""
    two = "vehicle: {camera: {gimbal: true}, more_cameras: [{name: down, tilt_deg: 90}, {name: zoom, gimbal: true}]}\n"
    spec = read_document(f"name: a\n{SQUARE}{two}", SimSpec)
    assert [camera.name for camera in spec.vehicle.cameras] == ["front", "down", "zoom"]
    assert SimSpec.model_validate_json(spec.model_dump_json()) == spec
    for wrong, words in (
        ("{}", "the name 'front' stands twice; give each camera its own name"),
        ("{name: b, mavlink: true}", "more_cameras[0].mavlink: only the main camera answers on MAVLink"),
        ("{name: b, gimbal: true}", "set gimbal of vehicle.camera to true too"),
    ):
        assert words in faults(f"name: a\n{SQUARE}vehicle: {{more_cameras: [{wrong}]}}\n")[0]
    tilted = "vehicle: {camera: {gimbal: true}, more_cameras: [{name: b, gimbal: true, tilt_deg: 20}]}\n"
    assert "give it the tilt_deg of vehicle.camera, 60" in faults(f"name: a\n{SQUARE}{tilted}")[0]
    plain = read_document(f"name: a\n{SQUARE}", SimSpec).model_dump(mode="json")
    assert "more_cameras" not in plain["vehicle"]
    assert not {"distortion", "exposure_ev", "shutter_s"} & plain["vehicle"]["camera"].keys()
    assert "dust_level" not in plain["environment"]
    assert "dust_extinction_per_m" not in plain["perception"]["model"]


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
def test_start_outside_gps_years_is_refused(tmp_path: Path, moment: str) -> None:
    """Years before 1981 and after 2099 are refused when the file is read, not during the flight."""
    file = tmp_path / "old.yaml"
    file.write_text(f"name: old\n{SQUARE}environment: {{start_utc: '{moment}'}}\n")
    with pytest.raises(SetupError, match="year of start_utc must be 1981 to 2099"):
        load_simspec(file)


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


@pytest.mark.parametrize(
    ("field", "words"),
    [
        (
            "vehicle: {outside_links: [{name: a, host: '::1'}]}",
            "links have no IPv6; give an IPv4 address or a name",
        ),
        ("vehicle: {outside_links: [{name: a, host: '[::1]'}]}", "links have no IPv6"),
        ("vehicle: {outside_links: [{name: a, host: '127.0.0.1:14550'}]}", "without port"),
        (
            "agent: {services: [{name: a, host: '[::1]', port: 80}]}",
            "write api.example.org, 127.0.0.1 or ::1, without",
        ),
    ],
)
def test_addresses_that_are_not_served(field: str, words: str) -> None:
    """A MAVLink link has IPv4 alone; a service may have either, without brackets."""
    assert words in faults(f"name: x\n{SQUARE}{field}\n")[0]
    read_document(f"name: x\n{SQUARE}agent: {{services: [{{name: a, host: '::1', port: 80}}]}}\n", SimSpec)


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
        (tmp_path / "a" / "scene.yaml").write_text(f"name: x\n{SQUARE}agent: {{manifest: {manifest}}}\n")
        spec = load_simspec("a/scene.yaml")
        assert (spec.agent.manifest, spec.agent.label) == (located, agent_name(manifest))
