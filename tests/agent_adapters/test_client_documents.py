"""The agent's half of the JSON documents against the bench's models: the same fields, and the same bytes."""

from __future__ import annotations

import math
import random
import struct
from dataclasses import MISSING, fields, is_dataclass
from types import UnionType
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pytest
from pydantic import TypeAdapter

from agent_adapters.client import documents
from agent_adapters.client._json_documents import float_text
from agent_adapters.client.documents import document_text, parse_document
from bench import contracts, simspec
from bench.documents import Document

NAMES = [name for name, kind in vars(documents).items() if is_dataclass(kind)]
LABELS = ("mobile_radar", "füchse", "", '"\\/', "日本", "😀 e-05", "a" * 64)
WORDS = (*LABELS, "\u2028\u202e", "\x00\x1f\x7f\b\t\n\f\r")
"""What free texts hold as well: as a label the bench would refuse it."""


def model_of(name: str) -> type[Document]:
    shared = ("Origin", "Point", "TimeWindow")
    model: type[Document] = getattr(simspec if name in shared else contracts, name)
    return model


def random_value(kind: Any, name: str, draw: random.Random) -> Any:
    """A value that the bench's model of the document takes as well."""
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
        if name == "phase":
            return draw.choice(("starting", "transit"))
        is_name = name in ("id", "action") or name.endswith("_id")
        return (
            draw.choice(("alpha", "b-2"))
            if is_name
            else draw.choice(WORDS if name in ("reason", "text") else LABELS)
        )
    if get_origin(kind) is Literal:
        return draw.choice(get_args(kind))
    if get_origin(kind) is tuple:
        return tuple(random_value(get_args(kind)[0], name, draw) for _ in range(draw.randrange(4)))
    if isinstance(kind, UnionType):
        return random_value(get_args(kind)[0], name, draw) if draw.random() < 0.7 else None
    return random_document(kind, draw)


def random_document(kind: Any, draw: random.Random) -> Any:
    values = {
        field.name: random_value(field.type, field.name, draw)
        for field in fields(kind)
        if field.default is MISSING or draw.random() < 0.7
    }
    if kind is documents.TimeWindow:
        values["until_s"] += values["from_s"] + 1.0
    return kind(**values)


@pytest.mark.parametrize("name", NAMES)
def test_both_halves_have_the_same_fields_and_defaults(name: str) -> None:
    model, kind = model_of(name), getattr(documents, name)

    defaults = {
        field: MISSING if info.is_required() else info.default for field, info in model.model_fields.items()
    }
    assert {field.name: field.default for field in fields(kind)} == defaults


@pytest.mark.parametrize("name", NAMES)
def test_both_halves_read_and_write_the_same(name: str) -> None:
    """Mission order and intelligence are only read by agents, so the order of their fields is of no account."""
    kind, adapter, draw = getattr(documents, name), TypeAdapter(model_of(name)), random.Random(name)
    for _ in range(40):
        document = random_document(kind, draw)
        text = document_text(document)
        read = adapter.validate_json(text)
        assert parse_document(kind, read.model_dump_json()) == document
        assert parse_document(kind, text.encode()) == document
        if name != "MissionOrder":
            assert read.model_dump_json() == text


def test_numbers_are_written_as_pydantic_writes_them() -> None:
    draw, adapter = random.Random(1), TypeAdapter(float)
    (any_bits,) = zip(*(struct.iter_unpack("<d", draw.randbytes(8 * 2000))), strict=True)
    small = [draw.choice((-1.0, 1.0)) * draw.random() * 10.0**-exponent for exponent in range(20)] * 20
    short = [float(f"{draw.choice(('-', ''))}{draw.randrange(100)}e{n}") for n in range(-20, 25)]
    edges = [0.0, -0.0, 5e-324, 1.7976931348623157e308, 1e-4, 1e-5, 9.999999999999999e-5, 1e16, 1e22]
    for value in (*any_bits, *small, *short, *edges):
        if math.isfinite(value):
            assert float_text(value) == adapter.dump_json(value).decode()


def test_numbers_of_other_types_are_written_as_floats() -> None:
    status = documents.AgentStatus(np.float64(2.5), "transit")
    track = documents.AgentTrack("t-1", "tree", 3, np.float64(0.1), 1, 7)

    assert document_text(status) == '{"time_s":2.5,"phase":"transit","text":""}'
    model = contracts.AgentTrack(id="t-1", class_label="tree", east_m=3, north_m=0.1, confidence=1, frames=7)
    assert document_text(track) == model.model_dump_json()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_json_has_no_number_for_is_not_written(value: float) -> None:
    with pytest.raises(ValueError, match="is not a number of JSON"):
        document_text(documents.AgentStatus(value, "transit"))


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
    assert parse_document(documents.ConsentAnswer, text) is None
    assert contracts.parse_document(contracts.ConsentAnswer, text) is None


def test_a_value_out_of_its_choices_is_refused() -> None:
    text = '{"id":"a","kind":"dance","issued_s":1.0,"within_s":1.0}'
    assert parse_document(documents.OrderDocument, text) is None
    assert parse_document(documents.OrderDocument, text.replace("dance", "hold")) is not None
