"""Messages as JSON, and the JSON Schema of each: for readers that know neither ROS nor CDR."""

from __future__ import annotations

import base64
import math
from typing import Any

from ._schemas import Field, dependencies, fields_of
from ._types import RosMessage

_INTEGERS = {
    "int8": (-(2**7), 2**7 - 1),
    "uint8": (0, 2**8 - 1),
    "uint16": (0, 2**16 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
    "uint64": (0, 2**64 - 1),
}


def json_value(message: object) -> dict[str, Any]:
    """A message as an object that `json.dumps` takes: field by field, under the names of the `.msg` file.

    Octets (`uint8[]`) are base64, and a number that JSON does not have (NaN, infinite) is null. Raises TypeError for
    what is no message.
    """
    kind: type[RosMessage] = type(message)  # type: ignore[assignment]
    return {field.name: _value(field, getattr(message, field.name)) for field in fields_of(kind)}


def json_schema(kind: type[RosMessage]) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of what `json_value` makes of messages of a class."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": kind.TYPE,
        **_object_schema(kind),
        "$defs": {inner.__name__: _object_schema(inner) for inner in dependencies(kind)},
    }


def _value(field: Field, value: Any) -> Any:
    if field.count == "one":
        return _plain(field, value)
    if field.of == "uint8" and field.count == "sequence":
        return base64.b64encode(value).decode("ascii")
    return [_plain(field, item) for item in value]


def _plain(field: Field, value: Any) -> Any:
    if not isinstance(field.of, str):
        return json_value(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _object_schema(kind: type[RosMessage]) -> dict[str, Any]:
    fields = fields_of(kind)
    return {
        "type": "object",
        "description": (kind.__doc__ or "").strip() if not _is_signature(kind) else "",
        "properties": {field.name: _field_schema(field) for field in fields},
        "required": [field.name for field in fields],
        "additionalProperties": False,
    }


def _is_signature(kind: type[RosMessage]) -> bool:
    # A dataclass without a docstring of its own gets its signature as one.
    return (kind.__doc__ or "").startswith(f"{kind.__name__}(")


def _field_schema(field: Field) -> dict[str, Any]:
    if field.of == "uint8" and field.count == "sequence":
        return {"type": "string", "contentEncoding": "base64"}
    items = _item_schema(field.of)
    if field.count == "one":
        return items
    sizes = {"minItems": field.size, "maxItems": field.size} if field.count == "array" else {}
    return {"type": "array", "items": items, **sizes}


def _item_schema(of: str | type[RosMessage]) -> dict[str, Any]:
    if not isinstance(of, str):
        return {"$ref": f"#/$defs/{of.__name__}"}
    if of in _INTEGERS:
        low, high = _INTEGERS[of]
        return {"type": "integer", "minimum": low, "maximum": high}
    # Null stands for NaN and the infinities.
    return {"type": {"bool": "boolean", "string": "string"}.get(of, ["number", "null"])}
