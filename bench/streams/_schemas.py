"""What is computed from the message classes: their fields, their hashes and their schemas."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin

from bench.values import value_class

from ._types import BY_NAME, RosMessage, type_name_of


@value_class(frozen=True, slots=True)
class Field:
    """One field: a primitive's name or a message class, alone, `size` of them, at most so many, or as many as there are."""

    name: str
    of: str | type[RosMessage]
    count: Literal["one", "array", "bounded", "sequence"] = "one"
    size: int = 0

    @property
    def type_text(self) -> str:
        """The field's type as a `.msg` file states it: `float64[36]`, `geometry_msgs/Pose[]`."""
        base = self.of if isinstance(self.of, str) else short_name(self.of.TYPE)
        return (
            base
            + {"one": "", "array": f"[{self.size}]", "bounded": f"[<={self.size}]", "sequence": "[]"}[
                self.count
            ]
        )


@cache
def fields_of(kind: type[RosMessage]) -> tuple[Field, ...]:
    """The fields of a message class in the order of the wire."""
    # A dataclass that is no message stops here.
    type_name_of(kind)
    return tuple(_field(field.name, field.type) for field in fields(kind))  # type: ignore[arg-type]


def _field(name: str, annotation: Any) -> Field:
    plain = {str: "string", bool: "bool", float: "float64"}.get(annotation)
    if plain is not None:
        return Field(name, plain)
    if get_origin(annotation) is Annotated:
        # The text of the annotation is the type in the .msg file: uint8, uint8[] or float64[36]; [5] or [<=1] of a tuple of messages.
        kind, text = get_args(annotation)
        base, _, rest = text.partition("[")
        base = base or get_args(kind)[0]
        if not rest:
            return Field(name, base)
        if rest.startswith("<="):
            return Field(name, base, "bounded", int(rest[2:-1]))
        return Field(name, base, "array", int(rest[:-1])) if rest != "]" else Field(name, base, "sequence")
    if get_origin(annotation) is tuple:
        return Field(name, get_args(annotation)[0], "sequence")
    return Field(name, annotation)


def short_name(type_name: str) -> str:
    """`std_msgs/msg/Header` as `.msg` files write it: `std_msgs/Header`."""
    return type_name.replace("/msg/", "/")


def dependencies(kind: type[RosMessage]) -> tuple[type[RosMessage], ...]:
    """Every message class inside `kind`, at any depth, each once, in the order of first meeting."""

    def walk(of: type[RosMessage]) -> Iterator[type[RosMessage]]:
        for field in fields_of(of):
            if not isinstance(field.of, str):
                yield field.of
                yield from walk(field.of)

    return tuple(dict.fromkeys(walk(kind)))


def _class_of(kind: str | type[Any]) -> type[RosMessage]:
    if isinstance(kind, str):
        return BY_NAME[kind]
    type_name_of(kind)
    return kind


def type_hash(kind: str | type[Any]) -> str:
    """The RIHS01 hash of a message class or a type's name (REP 2016): SHA-256 over the canonical JSON of its description.
    KeyError for an unknown name.
    """
    return _hash_of(_class_of(kind))


@cache
def _hash_of(kind: type[RosMessage]) -> str:
    inside = sorted(dependencies(kind), key=lambda message: message.TYPE)
    whole = {
        "type_description": _description(kind),
        "referenced_type_descriptions": [_description(message) for message in inside],
    }
    # The separators ", " and ": " are the defaults of json.dumps, and part of the canonical form.
    return "RIHS01_" + hashlib.sha256(json.dumps(whole).encode()).hexdigest()


# Of type_description_interfaces/msg/FieldType: an array adds 48, a bounded sequence 96, an unbounded one 144 to the id of
# its elements.
_TYPE_IDS = {
    "int8": 2,
    "uint8": 3,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "string": 17,
}
_COUNT_IDS = {"one": 0, "array": 48, "bounded": 96, "sequence": 144}


def _description(kind: type[RosMessage]) -> dict[str, Any]:
    return {
        "type_name": kind.TYPE,
        "fields": [{"name": field.name, "type": _type_description(field)} for field in fields_of(kind)],
    }


def _type_description(field: Field) -> dict[str, Any]:
    nested = "" if isinstance(field.of, str) else field.of.TYPE
    base = _TYPE_IDS[field.of] if isinstance(field.of, str) else 1
    return {
        "type_id": base + _COUNT_IDS[field.count],
        "capacity": field.size,
        "string_capacity": 0,
        "nested_type_name": nested,
    }


def service_parts(kind: type[RosMessage]) -> tuple[type[Any], type[Any]]:
    """The classes of a service's requests and of its responses."""
    request, response, _ = (part.of for part in fields_of(kind))
    return request, response  # type: ignore[return-value]


def schema_text(kind: str | type[Any]) -> str:
    """The `ros2msg` schema of a message class or a type's name with all it depends on, as rosbag2 and MCAP want it.

    KeyError for an unknown name.
    """
    return _schema_of(_class_of(kind))


@cache
def _schema_of(kind: type[RosMessage]) -> str:
    parts = [_definition(kind)]
    # The schema encoding `ros2msg` of MCAP separates definitions by a line of 80 equals signs.
    parts += [f"MSG: {short_name(message.TYPE)}\n{_definition(message)}" for message in dependencies(kind)]
    return ("=" * 80 + "\n").join(parts)


def _definition(kind: type[RosMessage]) -> str:
    return "".join(f"{field.type_text} {field.name}\n" for field in fields_of(kind))
