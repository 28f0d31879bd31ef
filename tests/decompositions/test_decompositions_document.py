"""The decomposition document: what is accepted, and every fault of a bad one at once."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import networkx as nx
import pytest
import yaml

from bench.campaign import check_options
from bench.errors import Fault, SetupError
from bench.simspec import FACTORS
from decompositions import (
    DecompositionDocument,
    DecompositionVocabulary,
    Level,
    Policies,
    decomposition_of,
    decomposition_schema,
    load_decomposition,
    read_decomposition,
    shipped_decompositions,
)

BENCH = DecompositionVocabulary({key: factor.unit for key, factor in FACTORS.items()}, check_options)
UNITS = {"fog_level": "level", "uav_altitude_m": "m", "reports": "1"}


def node(name: str, *children: str) -> dict[str, Any]:
    return {"id": name, "title": f"Title of {name}", "asks": "Is it so?", "children": list(children)}


def leaf(name: str, **changes: Any) -> dict[str, Any]:
    return {
        "id": name,
        "title": f"Title of {name}",
        "asks": "Is it so?",
        "measure": "detection_share",
        "options": {"role": "any"},
        "threshold": 0.5,
        "threshold_reason": "Half.",
        "considered": "Always.",
        "key_factors": ["fog"],
    } | changes


def row(**changes: Any) -> dict[str, Any]:
    return {
        "factor": "fog_level",
        "unit": "level",
        "ratings": [10, 100],
        "values": [0, 9],
        "reason": "The whole scale.",
    } | changes


@pytest.fixture
def valid() -> dict[str, Any]:
    """Two key attributes that share a VAB, and two VABs that share an observable."""
    return {
        "format": "rebar.decomposition/1",
        "name": "small",
        "title": "Small",
        "tables": {"fog": row()},
        "principles": [node("P", "KA-1", "KA-2")],
        "key_attributes": [node("KA-1", "V-1", "V-2"), node("KA-2", "V-2")],
        "vabs": [node("V-1", "O-1", "O-2"), node("V-2", "O-2", "O-3")],
        "observables": [leaf("O-1"), leaf("O-2"), leaf("O-3")],
    }


def faults(document: dict[str, Any], vocabulary: DecompositionVocabulary | None = None) -> list[Fault]:
    with pytest.raises(SetupError) as caught:
        read_decomposition(yaml.safe_dump(document, sort_keys=False), vocabulary, source="small.yaml")
    return list(caught.value.faults)


def test_the_graph_is_many_to_many(valid: dict[str, Any]) -> None:
    """A shared observable stands once under each node above it, and its parents are all known."""
    small = read_decomposition(yaml.safe_dump(valid))
    assert small.observables_under("KA-1") == ("O-1", "O-2", "O-3")
    assert small.observables_under("KA-2") == ("O-2", "O-3")
    assert small.observables_under("O-2") == ("O-2",)
    assert small.parents["O-2"] == ("V-1", "V-2")
    assert small.parents["V-2"] == ("KA-1", "KA-2")
    assert small.level_of("V-1") is Level.VAB
    assert small.key_attributes == small.study == ("KA-1", "KA-2")
    assert small.factors() == ("fog_level",)
    assert nx.is_directed_acyclic_graph(small.graph())


def test_the_digest_follows_the_meaning(valid: dict[str, Any]) -> None:
    """Layout of the file does not change it; a threshold does."""
    first = read_decomposition(yaml.safe_dump(valid)).digest
    assert read_decomposition(json.dumps(valid)).digest == first
    valid["observables"][0]["threshold"] = 0.6
    assert read_decomposition(yaml.safe_dump(valid)).digest != first


@pytest.mark.parametrize(
    ("change", "where", "message"),
    [
        (lambda d: d["key_attributes"][0]["children"].append("V-3"), "KA-1", "does not exist"),
        (lambda d: d["key_attributes"][0]["children"].append("V-1"), "KA-1", "2 times"),
        (
            lambda d: d["key_attributes"][0]["children"].append("O-1"),
            "KA-1",
            "lists observable O-1 as a child",
        ),
        (lambda d: d["observables"][1].update(near_miss=-0.1, partial_credit=True), "O-2", "outside 0 to 1"),
        (lambda d: d["observables"][1].update(near_miss=0.1), "O-2", "without partial_credit"),
        (lambda d: d["observables"][1].update(key_factors=["fogg"]), "O-2", "no table 'fogg'"),
        (lambda d: d["observables"][1].update(key_factors=["fog", row()]), "O-2", "2 times"),
        (lambda d: d["tables"].update(idle=row()), "idle", "no observable uses"),
        (lambda d: d["tables"].update(fog=row(values=[3, 3])), "fog", "all equal"),
        (lambda d: d["tables"].update(fog=row(ratings=[10], values=[3])), "fog", "fewer than two columns"),
        (lambda d: d["tables"].update(fog=row(values=[0, 4, 9])), "fog", "2 ratings and 3 values"),
        (
            lambda d: d["tables"].update(fog=row(absent=0.5)),
            "fog",
            "absent value 0.5 of fog_level lies among",
        ),
        (lambda d: d["tables"].update(fog=row(absent=10)), "fog", "absent value 10 of fog_level lies among"),
        (
            lambda d: d["observables"][1].update(key_factors=[row(values=[9, 2], absent=5)]),
            "O-2",
            "absent value 5 of fog_level lies among",
        ),
        (lambda d: d["tables"].update(fog=row(ratings=[0, 101])), "fog", "outside 0 to 100"),
        (
            lambda d: d["observables"][1].update(key_factors=[row(factor="reports", unit="%")]),
            "O-2",
            "key factor 'reports', which has no dimension",
        ),
        (lambda d: d.update(study=["KA-1", "KA-1"]), "study", "studied twice"),
        (
            lambda d: d["principles"][0].update(essential=["KA-1", "V-1"], essential_reason="So."),
            "P: principles[0].essential[1]",
            "'V-1' is not a key attribute under P",
        ),
        (
            lambda d: d["principles"][0].update(essential=["KA-2", "KA-2"], essential_reason="So."),
            "P: principles[0].essential",
            "named twice",
        ),
        (
            lambda d: d["principles"][0].update(essential=["KA-2"]),
            "P",
            "essential key attributes and their reason belong together",
        ),
        (lambda d: d["observables"][0].update(measures="x"), "observables[0]", "unknown field"),
    ],
)
def test_a_fault_is_named_with_its_node_and_line(
    valid: dict[str, Any], change: Any, where: str, message: str
) -> None:
    """Those that EVERYTHING_WRONG has not: each is told with the file's line, the node, and what would be right."""
    change(valid)
    matching = [fault for fault in faults(valid, DecompositionVocabulary(UNITS)) if message in fault.what]
    assert matching, f"no fault says {message!r}"
    assert any(where in fault.where for fault in matching)
    assert all(fault.where.startswith("small.yaml:") and fault.remedy for fault in matching)


@pytest.mark.parametrize("unit", ["", None, 1, 1.0])
def test_the_unit_of_a_factor_without_a_dimension_is_told(valid: dict[str, Any], unit: object) -> None:
    """Left empty, or written as a number: what to write, and where."""
    valid["tables"]["fog"]["unit"] = unit
    (fault,) = faults(valid)
    assert fault.where.startswith("small.yaml:")
    assert fault.where.endswith("tables.fog.unit")
    assert fault.what == 'a factor without a dimension has the unit "1"; write it so, in quotes'
    valid["tables"]["fog"].update(factor="reports", unit="%")
    (fault,) = faults(valid, DecompositionVocabulary(UNITS))
    assert fault.remedy == 'write unit: "1", and convert the values'


@pytest.mark.parametrize(
    ("values", "absent", "absent_values", "present_values"),
    [
        ([1.0, 9.0], 0.0, [0.0, -1.0, None], [0.5, 1.0, 20.0]),
        ([0.0, 9.0], 0.0, [0.0, None], [1e-9, 4.0]),
        ([300.0, 20.0], 1000.0, [1000.0, 1e9, None], [999.0, 300.0, 0.0]),
        ([300.0, 20.0], 300.0, [300.0, 301.0, None], [299.0]),
        ([0.0, 9.0], None, [], [0.0, -1.0, None]),
    ],
)
def test_absent_is_a_value_at_or_beyond_the_easy_end(
    valid: dict[str, Any],
    values: list[float],
    absent: float | None,
    absent_values: list[float | None],
    present_values: list[float | None],
) -> None:
    """Tables that rise and fall; without `absent` nothing is absent, not even a factor without a value."""
    valid["tables"]["fog"] = row(values=values, absent=absent)
    table = read_decomposition(yaml.safe_dump(valid)).key_factors("O-1")[0]

    assert [value for value in absent_values if not table.is_absent(value)] == []
    assert [value for value in present_values if table.is_absent(value)] == []


def test_an_observable_is_about_the_agent_unless_it_says_otherwise(valid: dict[str, Any]) -> None:
    valid["observables"][1]["subject"] = "perception"
    decomposition = read_decomposition(yaml.safe_dump(valid))

    assert [node.subject for node in decomposition.observables.values()] == ["agent", "perception", "agent"]


EVERYTHING_WRONG = """format: rebar.decomposition/1
name: bad
title: Everything wrong
study: [KA-9]
tables:
  fog: {factor: fog_level, unit: m, ratings: [10, 50, 100], values: [0, 9, 4], reason: Not monotone.}
  snow: {factor: snow_level, unit: level, ratings: [50, 10], values: [0, 9], reason: Unknown.}
principles:
  - {id: P, title: t, asks: a, children: [KA-1, V-1]}
key_attributes:
  - {id: KA-1, title: t, asks: a, children: [V-1]}
  - {id: KA-2, title: t, asks: a, children: []}
vabs:
  - {id: V-1, title: t, asks: a, children: [O-1, V-2]}
  - {id: V-2, title: t, asks: a, children: [V-1, KA-1]}
observables:
  - {id: O-1, title: t, asks: a, measure: mood, threshold: 1.5, threshold_reason: r, considered: c, key_factors: [fog]}
  - {id: O-1, title: t, asks: a, measure: mission_flown, options: {rolle: any}, threshold: 0.5, threshold_reason: r,
     considered: c, key_factors: [snow]}
  - {id: O-3, title: t, asks: a, measure: mission_flown, threshold: -0.5, threshold_reason: r, considered: c}
"""


def test_every_kind_of_fault_is_told_in_one_go_and_in_the_order_of_the_file() -> None:
    """Cycles, orphans, duplicates, tables, thresholds, measures, options, units, skipped levels: line, node
    and remedy of each.
    """
    with pytest.raises(SetupError) as caught:
        read_decomposition(EVERYTHING_WRONG, BENCH, source="bad.yaml")
    reported = [(fault.where, fault.what) for fault in caught.value.faults]
    expected = [
        ("bad.yaml:4: study", "no key attribute 'KA-9'"),
        ("bad.yaml:6: fog", "is not monotone"),
        ("bad.yaml:6: fog", "the unit 'm' is not the unit"),
        ("bad.yaml:7: snow", "ratings of snow_level do not rise"),
        ("bad.yaml:7: snow", "no key factor 'snow_level'"),
        ("bad.yaml:9: P", "P lists VAB V-1 as a child"),
        ("bad.yaml:12: KA-2", "has no children"),
        ("bad.yaml:12: KA-2", "is an orphan"),
        ("bad.yaml:14: V-1", "V-1 lists VAB V-2 as a child"),
        ("bad.yaml:15: V-2", "key attribute KA-1 as a child"),
        ("bad.yaml", "form a cycle: KA-1 -> V-1 -> V-2 -> KA-1"),
        ("bad.yaml", "form a cycle: V-1 -> V-2 -> V-1"),
        ("bad.yaml:17: O-1", "threshold 1.5"),
        ("bad.yaml:17: O-1", "'mood'"),
        ("bad.yaml:18: O-1", "used twice"),
        ("bad.yaml:18: O-1", "unknown option 'rolle'"),
        ("bad.yaml:20: O-3", "is an orphan"),
        ("bad.yaml:20: O-3", "threshold -0.5"),
        ("bad.yaml:20: O-3", "no key factors"),
    ]
    for where, message in expected:
        assert [what for place, what in reported if place.startswith(where) and message in what], message
    assert all(fault.remedy for fault in caught.value.faults)
    lines = [int(where.split(":")[1]) for where, _ in reported]
    assert lines == sorted(lines)
    skipped = next(fault for fault in caught.value.faults if "lists VAB V-1" in fault.what)
    assert "put a key attribute between them" in skipped.remedy


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the document is empty"),
        ("# nothing here\n", "the document is empty"),
        ("{}", "the document is empty"),
        ("- a\n- b\n", "is a list"),
        (
            "format: rebar.decomposition/1\nname: x\ntitle: t\nobservables: []\n",
            "no observables, so nothing is measured",
        ),
        ("format: rebar.decomposition/1\nname: x\ntitle: t\n", "is missing"),
    ],
)
def test_an_empty_document_says_so(text: str, message: str) -> None:
    """Nothing, a comment, a list, no observables: a sentence and what to write."""
    with pytest.raises(SetupError) as caught:
        read_decomposition(text, source="empty.yaml")
    (fault,) = caught.value.faults
    assert message in fault.what
    assert fault.where.startswith("empty.yaml")
    assert fault.remedy


def test_difficulties_that_are_given_need_no_tables(valid: dict[str, Any]) -> None:
    """An observable without key factors is a fault of a document that is rated, and none of one whose
    difficulties come along.
    """
    del valid["observables"][1]["key_factors"]
    assert [fault.what for fault in faults(valid)] == ["O-2 has no key factors, so no difficulty"]
    small = read_decomposition(yaml.safe_dump(valid), DecompositionVocabulary(difficulty="given"))
    assert small.key_factors("O-2") == ()


def test_values_that_are_given_need_no_measure(valid: dict[str, Any]) -> None:
    """Two observables without a measure, one of them without a reason: faults of a document that is flown, and none
    of one whose values come along. A measure that is named is checked in both.
    """

    def check(name: str, options: Mapping[str, bool | float | str]) -> None:
        raise ValueError(f"{name} takes no options")

    del valid["observables"][0]["measure"], valid["observables"][1]["measure"]
    del valid["observables"][1]["threshold_reason"]
    assert [fault.what for fault in faults(valid)] == [
        "O-1 names no measure, so nothing can be measured",
        "O-2 does not say why its threshold is 0.5",
        "O-2 names no measure, so nothing can be measured",
    ]
    given = DecompositionVocabulary(check_measure=check, difficulty="given")
    decomposition = read_decomposition(yaml.safe_dump(valid), DecompositionVocabulary(difficulty="given"))
    assert decomposition.observables["O-2"].measure is None
    assert decomposition.observables["O-2"].threshold_reason is None
    others = [leaf["measure"] for leaf in valid["observables"][2:]]
    assert [fault.what for fault in faults(valid, given)] == [f"{name} takes no options" for name in others]


def test_a_shared_bad_child_is_one_fault_for_each_parent(valid: dict[str, Any]) -> None:
    """The same mistake in two places is two faults, for both have to be mended."""
    valid["key_attributes"][0]["children"] = ["V-1", "V-2", "V-8"]
    valid["key_attributes"][1]["children"] = ["V-2", "V-8"]
    assert sum("'V-8'" in fault.what for fault in faults(valid)) == 2


def test_an_example_without_principles_is_whole(valid: dict[str, Any]) -> None:
    """The top level that is present need not stand under anything."""
    del valid["principles"]
    assert read_decomposition(yaml.safe_dump(valid)).at_level(Level.PRINCIPLE) == ()


def test_unknown_names_and_missing_files_get_a_sentence(tmp_path: Path) -> None:
    """A name that is not shipped lists what is; a path that is not there says so."""
    with pytest.raises(SetupError, match="did you mean search-and-report"):
        load_decomposition("search-and-reprot")
    with pytest.raises(SetupError, match="no such file"):
        load_decomposition(tmp_path / "mine.yaml")


def test_a_file_by_path_is_read(valid: dict[str, Any], tmp_path: Path) -> None:
    """YAML and JSON files of a user's own are taken alike."""
    for name, text in (("a.yaml", yaml.safe_dump(valid)), ("a.json", json.dumps(valid))):
        (tmp_path / name).write_text(text)
        assert load_decomposition(tmp_path / name).name == "small"


def test_the_schema_describes_what_is_accepted() -> None:
    """The published schema is one of the document: closed, and with the bounds of thresholds."""
    schema = decomposition_schema()
    assert schema["additionalProperties"] is False
    threshold = schema["$defs"]["Observable"]["properties"]["threshold"]
    assert (threshold["minimum"], threshold["maximum"]) == (0.0, 1.0)
    assert set(schema["required"]) == {"format", "name", "title", "observables"}
    json.dumps(schema)


@pytest.mark.parametrize("name", shipped_decompositions())
def test_what_is_shipped_is_sound(name: str) -> None:
    """Every decomposition of the house passes the checks, with key factors, units, measures and options of this bench,
    carries its file's name, and survives a round trip.
    """
    shipped = load_decomposition(name, BENCH)
    assert shipped.name == name
    reread = DecompositionDocument.model_validate_json(shipped.document.model_dump_json())
    assert decomposition_of(reread, BENCH) == shipped


DOCS = Path(__file__).parents[2] / "docs"


def test_the_example_of_the_page_loads() -> None:
    """What a reader copies from the page is a whole document."""
    example = re.search(r"```yaml\n(.*?)```", (DOCS / "decompositions.md").read_text(), re.DOTALL)
    assert example
    units = {name: factor.unit for name, factor in FACTORS.items()}
    assert read_decomposition(example[1], DecompositionVocabulary(units)).name == "inspection"


def test_the_counts_of_the_page_are_right() -> None:
    """Five principles, five key attributes, twelve VABs, fourteen observables."""
    decomposition = load_decomposition("search-and-report")
    assert [len(decomposition.at_level(level)) for level in Level] == [5, 5, 12, 14]
    assert "twelve VABs, fourteen observables" in (DOCS / "decompositions.md").read_text()


def test_every_policy_is_on_the_page() -> None:
    """A rule that can be chosen is a rule that is described."""
    text = (DOCS / "scoring.md").read_text()
    assert [name for name in Policies.model_fields if f"`{name}:" not in text] == []
