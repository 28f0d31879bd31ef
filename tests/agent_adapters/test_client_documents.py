"""The documents of the air network as the agent's client and the bench read and write them."""

from __future__ import annotations

import json
import math
import random
from dataclasses import MISSING, fields, is_dataclass
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
import pytest
from air_documents import valid

from agent_adapters.client.documents import parse_document
from bench import contracts
from bench.contracts import (
    AgentStatus,
    AgentTrack,
    AgentTracks,
    ConsentAnswer,
    ConsentRequest,
    Decision,
    OrderAnswer,
    OrderDocument,
    TargetReport,
    document_schema,
    document_text,
)
from bench.contracts import _documents as documents

KINDS = [kind for kind in vars(documents).values() if is_dataclass(kind)]
LABELS = ("mobile_radar", "füchse", "", '"\\/', "日本", "😀 e-05", "a" * 64)
WORDS = (*LABELS, "\u2028\u202e", "\x00\x1f\x7f\b\t\n\f\r")
"""What free texts hold as well: as a label the bench would refuse it."""


def random_value(kind: Any, name: str, draw: random.Random) -> Any:
    """A value that the bench takes as well."""
    if get_origin(kind) is Annotated:
        return random_value(kind.__origin__, name, draw)
    if kind is float:
        size = draw.choice(
            (0.0, 1.0, draw.random(), round(draw.random(), 3), 10.0 ** -draw.uniform(0.0, 12.0))
        )
        return -1e5 * size if name in ("east_m", "north_m") and draw.random() < 0.5 else size
    if kind is int:
        return draw.randrange(10_000)
    if kind is bool:
        return draw.random() < 0.5
    if kind is str:
        if name in ("id", "action") or name.endswith("_id"):
            return draw.choice(("alpha", "b-2"))
        return draw.choice(WORDS if name in ("reason", "text") else LABELS)
    if get_origin(kind) is Literal:
        return draw.choice(get_args(kind))
    if get_origin(kind) is tuple:
        return tuple(random_value(get_args(kind)[0], name, draw) for _ in range(draw.randrange(4)))
    if get_origin(kind) in (Union, UnionType):
        return random_value(get_args(kind)[0], name, draw) if draw.random() < 0.7 else None
    return random_document(kind, draw)


def random_document(kind: Any, draw: random.Random) -> Any:
    given = [field for field in fields(kind) if field.default is MISSING or draw.random() < 0.7]
    return kind(**{field.name: random_value(field.type, field.name, draw) for field in given})


@pytest.mark.parametrize("kind", KINDS)
def test_both_halves_read_what_is_written(kind: Any) -> None:
    draw = random.Random(kind.__name__)
    for _ in range(40):
        document = random_document(kind, draw)
        text = document_text(document)
        assert parse_document(kind, text) == document
        assert parse_document(kind, text.encode()) == document
        assert contracts.parse_document(kind, text) == document


def test_numbers_of_other_types_are_written_as_numbers() -> None:
    status = AgentStatus(np.float64(2.5), "transit")
    assert document_text(status) == '{"time_s":2.5,"phase":"transit","text":""}'
    track = AgentTrack("t-1", "tree", 3, np.float64(0.1), 1, 7)
    assert contracts.parse_document(AgentTrack, document_text(track)) == track


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_json_has_no_number_for_is_not_written(value: float) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        document_text(AgentStatus(value, "transit"))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[]",
        "[" * 30_000,
        '{"request":"a","granted":true}',
        '{"request":"a","granted":true,"answered_s":1.0,"colour":"red"}',
        '{"request":7,"granted":true,"answered_s":1.0}',
        '{"request":"a","granted":null,"answered_s":1.0}',
        '{"request":"a","granted":true,"answered_s":NaN}',
        '{"request":"a","granted":true,"answered_s":"soon"}',
        '{"request":"a","granted":true,"answered_s":[1.0]}',
        b'{"request":"\xff","granted":true,"answered_s":1.0}',
    ],
)
def test_both_halves_refuse_the_same_documents(text: str | bytes) -> None:
    assert parse_document(ConsentAnswer, text) is None
    assert contracts.parse_document(ConsentAnswer, text) is None


def test_a_value_out_of_its_choices_is_refused() -> None:
    text = '{"id":"a","kind":"dance","issued_s":1.0,"within_s":1.0}'
    assert parse_document(OrderDocument, text) is None
    assert parse_document(OrderDocument, text.replace("dance", "hold")) is not None


# What the bench takes of an agent: by field the least and the greatest, or the lengths of a text or a list.
TIME, PLACE, SHARE, FREE = (0.0, 1e6), (-1e6, 1e6), (0.0, 1.0), ("", 0, 2000)
LABEL, NAME = ("id", 0, 64), ("id", 1, 64)
EVIDENCE: tuple[Any, ...] = ([], 0, 256)
PEOPLE, OPTIONAL_M = (0, 10_000), (0.0, 1e6)
CLAIM = {"class_label": LABEL, "east_m": PLACE, "north_m": PLACE, "confidence": SHARE}
TARGET = {
    **CLAIM,
    "id": NAME,
    "time_s": TIME,
    "intelligence_id": LABEL,
    "evidence": EVIDENCE,
    "reason": FREE,
    "bystanders_seen": PEOPLE,
    "people_expected": (0.0, 10_000.0),
}
FURTHER = {"nearest_bystander_m": OPTIONAL_M, "position_sigma_m": OPTIONAL_M, "repeats": LABEL}
CHOICE = {"action": NAME, "subject": LABEL, "reason": FREE, "evidence": EVIDENCE, "confidence": SHARE}
LIMITS: dict[Any, dict[str, tuple[Any, ...]]] = {
    OrderAnswer: {"time_s": TIME, "order": LABEL, "reason": FREE},
    TargetReport: {**TARGET, **FURTHER},
    ConsentRequest: TARGET,
    Decision: {"time_s": TIME, **CHOICE},
    AgentStatus: {"time_s": TIME, "text": FREE},
    AgentTrack: {**CLAIM, "id": LABEL, "frames": (0, 10_000_000)},
    AgentTracks: {"time_s": TIME, "tracks": ([], 0, 1000)},
}
# The fields of an agent's documents that have no limit: truth values, and one of a list of words.
UNLIMITED = {"accepted", "mark", "phase"}
TRACK = {"id": "t", "class_label": "tree", "east_m": 0, "north_m": 0, "confidence": 1, "frames": 1}
PLAIN = {
    "time_s": 1.0,
    "order": "a",
    "accepted": True,
    "intelligence_id": "a",
    "action": "go",
    "phase": "transit",
    "mark": False,
    "tracks": [],
    **TRACK,
}


def plain(kind: Any) -> dict[str, Any]:
    required = {field.name for field in fields(kind) if field.default is MISSING}
    return {name: value for name, value in PLAIN.items() if name in required}


@pytest.mark.parametrize("kind", LIMITS)
def test_what_an_agent_publishes_has_limits(kind: Any) -> None:
    """Both sides of each boundary; no number but finite ones, no field that is not known."""
    assert {field.name for field in fields(kind)} - UNLIMITED == LIMITS[kind].keys()

    def is_taken(**changes: Any) -> bool:
        return contracts.parse_document(kind, json.dumps({**plain(kind), **changes})) is not None

    assert is_taken()
    assert not is_taken(colour="red")
    for name, limit in LIMITS[kind].items():
        if len(limit) == 2:
            least, greatest = limit
            beyond = 1 if isinstance(least, int) else 1e-6
            for value in (least, greatest):
                assert is_taken(**{name: value}), (name, value)
            for value in (least - beyond, greatest + beyond, math.nan, math.inf, -math.inf, "many"):
                assert not is_taken(**{name: value}), (name, value)
            continue
        sample, least, greatest = limit
        piece: Any = [TRACK if name == "tracks" else 1.0] if isinstance(sample, list) else "a"
        for length in (least - 1, least, greatest, greatest + 1):
            if length >= 0:
                assert is_taken(**{name: piece * length}) is (least <= length <= greatest), (name, length)
        if isinstance(sample, str):
            for sign in ("\x00", "\x1b", "\n", "\u202e", "\u200b"):
                # Free words are shown with escapes, ids and labels refused.
                assert is_taken(**{name: f"a{sign}"}) is (sample == ""), (name, sign)
        else:
            assert not is_taken(**{name: [math.nan]})


def test_the_limits_of_a_list_are_those_of_its_elements() -> None:
    assert valid(AgentTracks, {"time_s": 1.0, "tracks": [TRACK]}).tracks == (valid(AgentTrack, TRACK),)
    for change in ({"frames": -1}, {"id": "\x1b"}, {"east_m": math.inf}, {"colour": "red"}):
        text = json.dumps({"time_s": 1.0, "tracks": [TRACK | change]})
        assert contracts.parse_document(AgentTracks, text) is None


@pytest.mark.parametrize("kind", LIMITS)
def test_the_schema_states_the_limits(kind: Any) -> None:
    schema = document_schema(kind)
    assert schema["additionalProperties"] is False
    assert set(schema["required"]) == plain(kind).keys()
    for name, limit in LIMITS[kind].items():
        stated = schema["properties"][name]
        stated = next(iter(stated.get("anyOf", [stated])))
        keys = ("minimum", "maximum")
        if len(limit) == 3:
            keys = ("minItems", "maxItems") if isinstance(limit[0], list) else ("minLength", "maxLength")
        assert (stated.get(keys[0], 0), stated[keys[1]]) == limit[-2:], name
        assert ("pattern" in stated) is (limit[0] == "id"), name


def test_the_schema_says_what_fields_mean() -> None:
    order = document_schema(contracts.MissionOrder)
    assert order["properties"]["geofence"]["description"] == "Corners of the area to keep inside."
    until = order["$defs"]["NoFlyDocument"]["properties"]["until_s"]
    assert until["description"] == "To the end when absent."
