"""Messages as JSON, and their schemas: every class, with values of every kind."""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import pytest

from bench.streams import (
    MESSAGES,
    CompressedImage,
    Detection2D,
    Detection2DArray,
    Header,
    Point,
    RosMessage,
    Time,
    json_schema,
    json_value,
)

_TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "null": type(None)}


def fits(schema: dict[str, Any], value: Any, whole: dict[str, Any]) -> bool:
    """Whether a value is what a schema says, for the words that these schemas use."""
    if "$ref" in schema:
        return fits(whole["$defs"][schema["$ref"].removeprefix("#/$defs/")], value, whole)
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if not any(
        isinstance(value, int | float) if kind == "number" else isinstance(value, _TYPES[kind])
        for kind in kinds
    ):
        return False
    if isinstance(value, dict):
        names = set(schema["properties"])
        return value.keys() == names == set(schema["required"]) and all(
            fits(schema["properties"][name], item, whole) for name, item in value.items()
        )
    if isinstance(value, list):
        size_fits = schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", 1 << 30)
        return size_fits and all(fits(schema["items"], item, whole) for item in value)
    return "minimum" not in schema or schema["minimum"] <= value <= schema["maximum"]


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.TYPE)
def test_every_message_is_what_its_schema_says(kind: type[RosMessage]) -> None:
    schema = json_schema(kind)
    value = json.loads(json.dumps(json_value(kind()), allow_nan=False))
    assert schema["title"] == kind.TYPE
    assert fits(schema, value, schema)
    # A field more or less does not fit.
    assert not fits(schema, {**value, "more": 1}, schema)
    assert not fits(schema, dict(list(value.items())[1:]), schema)


def test_values_keep_their_names_and_octets_are_base64() -> None:
    stamp = Time.of(1_500_000_000)
    picture = CompressedImage(Header(stamp, "camera"), "jpeg", b"\x00\xff\x01")
    assert json_value(picture) == {
        "header": {"stamp": {"sec": 1, "nanosec": 500_000_000}, "frame_id": "camera"},
        "format": "jpeg",
        "data": base64.b64encode(b"\x00\xff\x01").decode(),
    }
    found = json_value(Detection2DArray(Header(), (Detection2D(id="a"), Detection2D(id="b"))))
    assert [detection["id"] for detection in found["detections"]] == ["a", "b"]


def test_numbers_that_json_lacks_are_null() -> None:
    value = json_value(Point(math.nan, -math.inf, 2.0))
    assert (value["x"], value["y"], value["z"]) == (None, None, 2.0)
    schema = json_schema(Point)
    assert fits(schema, value, schema)


def test_what_is_no_message_is_refused() -> None:
    with pytest.raises(TypeError, match="no message class"):
        json_value({"data": "x"})
