"""Documents that do not fit their model: every fault of a small one, and bounded work for a large one."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import pytest
from pydantic import Field

from bench.campaign import Campaign
from bench.contracts import AgentManifest
from bench.documents import (
    Document,
    _document,
    load_document,
    read_document,
    read_json_document,
    validate_document,
)
from bench.errors import Fault, SetupError
from bench.instance_analysis.language._vocabulary import VocabularyDocument
from bench.simspec import SimSpec
from decompositions import DecompositionDocument

ROOT = Path(__file__).parents[2]
DOCUMENTS: dict[str, type[Document]] = {
    "examples/governed.yaml": SimSpec,
    "examples/rescue.yaml": SimSpec,
    "campaigns/paper.yaml": Campaign,
    "examples/mqtt/mqtt_agent.yaml": AgentManifest,
    "decompositions/data/search_and_report.yaml": DecompositionDocument,
    "bench/instance_analysis/language/vocabulary.yaml": VocabularyDocument,
}


class Member(Document):
    size_m: Annotated[float, Field(gt=0.0)] = 1.0
    count: int | None = None
    level: bool | int | float | str = 0
    name: str = ""
    solid: bool = False


class Whole(Document):
    members: tuple[Member, ...] = ()
    by_name: dict[str, float] = {}
    either: int | str = 0


def faults(text: str, kind: type[Document] = Whole) -> list[str]:
    with pytest.raises(SetupError) as caught:
        read_document(text, kind, "x.yaml")
    return [str(fault) for fault in caught.value.faults]


def number_places(value: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    members = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    )
    for part, member in members:
        yield from number_places(member, (*place, part))
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield place


@pytest.mark.parametrize("path", DOCUMENTS)
def test_no_number_takes_a_truth_value(path: str) -> None:
    """In place of each number of a document in turn: pydantic alone would fly at 1 m for `altitude_m: true`."""
    kind = DOCUMENTS[path]
    document: Any = json.loads(load_document(ROOT / path, kind).model_dump_json())
    if kind is AgentManifest:
        document |= {"tcp_ports": [80, 81]}
    # These may be truth values; whether the fields that they set take them is for realization to say.
    either = {"levels", "patches", "set", "sets", "options"}
    places = [place for place in number_places(document) if not either & set(place)]
    assert len(places) >= 5
    for place in places[:: max(1, len(places) // 150)]:
        *steps, last = place
        holder = document
        for step in steps:
            holder = holder[step]
        number, holder[last] = holder[last], True
        with pytest.raises(SetupError, match="is a truth value, and a number belongs here"):
            validate_document(document, kind)
        holder[last] = number
    validate_document(document, kind)


def test_values_of_another_kind_are_told_apart() -> None:
    """Each with its line and what to write. Numbers in quotes are numbers where only numbers are taken."""
    text = "members:\n- size_m: yes\n- count: off\n- name: 12\n- name: true\n- size_m: '045'\n- level: no\n"
    assert faults(text) == [
        "x.yaml:2: members[0].size_m: true (or yes, on) is a truth value, and a number belongs here (write a number)",
        "x.yaml:3: members[1].count: false (or no, off) is a truth value, and a number belongs here (write a number)",
        "x.yaml:4: members[2].name: 12 is not text (put it in quotes)",
        "x.yaml:5: members[3].name: true (or yes, on) is not text (put it in quotes)",
    ]
    whole = read_document(
        "members: [{size_m: '045', count: 1e1, level: no, solid: yes}, {level: '045'}, {level: 1e1}]\neither: '7'",
        Whole,
    )
    assert whole.members[0] == Member(size_m=45.0, count=10, level=False, solid=True)
    assert [member.level for member in whole.members[1:]] == ["045", 10.0]
    assert whole.either == "7"


def test_models_take_truth_values_from_python_no_more_than_from_files() -> None:
    with pytest.raises(ValueError, match="truth value"):
        Member(size_m=True)
    with pytest.raises(ValueError, match="truth value"):
        Whole(by_name={"a": False})
    assert Member(size_m=1, level=True).level is True
    assert Member.model_json_schema()["properties"]["size_m"]["type"] == "number"


def test_faults_are_listed_up_to_a_number() -> None:
    """200 of them, then how many more there are."""
    listed = faults("members: [" + "{size_m: -1}," * 200 + "]")
    assert len(listed) == 200
    listed = faults("members: [" + "{size_m: -1}," * 217 + "]")
    assert len(listed) == 201
    assert listed[-1] == "17 more faults (correct these first)"
    assert [fault.split(": ")[1] for fault in listed[:2]] == ["members[0].size_m", "members[1].size_m"]
    # Passed on by a caller that adds a fault of its own, the count stays.
    with pytest.raises(SetupError) as caught:
        read_document("members: [" + "{size_m: -1}," * 217 + "]", Whole)
    assert SetupError([*caught.value.faults]).faults == caught.value.faults
    assert str(SetupError([Fault("", "x")] * 300).faults[-1]).startswith("100 more faults")


def test_a_large_document_tells_the_first_fault_of_each_list(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both sides of the number of values, and the same value where there is no fault."""
    text = "members: [{size_m: -1}, {size_m: -2}]\nby_name: {a: x, b: y}\neither: 1\n"
    monkeypatch.setattr(_document, "MANY_VALUES", 10)
    assert len(faults(text)) == 4
    monkeypatch.setattr(_document, "MANY_VALUES", 9)
    assert [fault.split(": ")[1] for fault in faults(text)] == ["members[0].size_m", "by_name.a"]
    fitting = text.replace("-", "").replace(": x", ": 3").replace(": y", ": 4")
    large = read_document(fitting, Whole)
    monkeypatch.undo()
    assert read_document(fitting, Whole) == large


def test_what_is_no_mapping_is_told_without_names_of_classes() -> None:
    """Of a file and of a value in it."""
    for text in ("[1, 2]", "by_name: 3\n", ""):
        with pytest.raises(SetupError, match="should be a valid dictionary") as refusal:
            read_document(text, Whole, source="x.yaml")
        assert "instance of" not in str(refusal.value)


def test_a_large_json_document_is_read_as_a_small_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the fast reader that stops early, and with the one that counts values."""
    text = '{"members": [{"size_m": 2.5}], "by_name": {"a": 1}, "either": "b"}'
    expected = read_json_document(text, Whole)
    for limit in ("MANY_CHARACTERS", "MAX_JSON_CHARACTERS"):
        monkeypatch.setattr(_document, limit, 10)
        assert read_json_document(text, Whole) == expected
        with pytest.raises(SetupError, match=r"x\.json:1: members\[0\]\.size_m: -2\.5 is not valid"):
            read_json_document(text.replace("2.5", "-2.5"), Whole, "x.json")


SCRIPT = """
import resource, sys
from bench.campaign import Campaign
from bench.documents import read_document, read_json_document
from bench.errors import SetupError
from bench.simspec import SimSpec

def attempt(read, text, kind):
    try:
        read(text, kind, "x")
    except SetupError as error:
        return str(error)
    raise AssertionError("was read")

texts = {
    SimSpec: ['{"name": "x", "actors": [' + ",".join(["1"] * 150_000) + "]}",
              '{"name": "x", "agent": {"options": {' + ",".join(f'"k{n}": []' for n in range(7_500)) + "}}}",
              "{" + ",".join(f'"k{n}": 1' for n in range(75_000)) + "}",
              "[" * 250_000],
    Campaign: ['{"design": {"factors": [{"levels": [' + ",".join(["[]"] * 100_000) + "]}]}}"],
}
for kind in texts:
    attempt(read_document, "x: 1", kind)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for kind, hostile in texts.items():
    for text in hostile:
        for read in (read_document, read_json_document):
            assert len(attempt(read, text, kind)) < 60_000
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1000)
"""


@pytest.mark.process
def test_a_hostile_document_takes_little_memory() -> None:
    """600 kB of `actors: [1, 1, ...]` took 670 MB, and as JSON no less. Measured now, all of these at half that length: 65 MB."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert int(done.stdout) < 130
