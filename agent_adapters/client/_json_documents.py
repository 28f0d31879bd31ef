"""JSON documents as plain values: read and written by the types of their fields, without pydantic.

The bench refuses what is not a valid document; the agent's half only has to read what the bench writes, and to write what
pydantic would, to the byte: recordings hold it. pydantic with its models took almost half of the instructions of an agent's start.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin

# Of a field: it is not written while it is None, as the bench's model leaves it out.
LEFT_OUT_WHEN_NONE: Mapping[str, bool] = {"left_out_when_none": True}

D = TypeVar("D")
_Reader = Callable[[Any], Any]
_Writer = Callable[[Any], str]

_encode_text = json.JSONEncoder(ensure_ascii=False).encode


class _Mismatch(ValueError):
    """The JSON value is not of the type that its field has."""


def parse_document(kind: type[D], text: str | bytes) -> D | None:
    """The document in `text`, or None when it is not one of class `kind`; never raises."""
    document_class: Any = kind
    try:
        document: D = _reader(document_class)(json.loads(text, parse_constant=_refuse))
    except (ValueError, RecursionError, OverflowError):
        return None
    return document


def document_text(document: object) -> str:
    """The JSON text of a document, as pydantic writes it. Raises ValueError for a number that JSON does not have."""
    kind: Any = type(document)
    text: str = _writer(kind)(document)
    return text


@cache
def _reader(kind: Any) -> _Reader:
    if is_dataclass(kind):
        return _document_reader(kind)
    if kind is float:
        return _number
    if get_origin(kind) is tuple:
        element = _reader(get_args(kind)[0])
        return lambda value: tuple(map(element, _checked(value, list)))
    if get_origin(kind) is Literal:
        return lambda value: _chosen(value, get_args(kind))
    if isinstance(kind, UnionType):
        present = _reader(_present(kind))
        return lambda value: None if value is None else present(value)
    return lambda value: _checked(value, kind)


def _document_reader(kind: Any) -> _Reader:
    readers = {name: _reader(part) for name, part in _types(kind).items()}
    required = {field.name for field in fields(kind) if not _has_default(field)}

    def read(value: Any) -> Any:
        document = _checked(value, dict)
        if not required <= document.keys() <= readers.keys():
            raise _Mismatch
        return kind(**{name: readers[name](part) for name, part in document.items()})

    return read


def _types(kind: Any) -> dict[str, Any]:
    return {field.name: field.type for field in fields(kind)}


def _has_default(field: Field[Any]) -> bool:
    return field.default is not MISSING or field.default_factory is not MISSING


def _checked(value: Any, kind: type) -> Any:
    # Not isinstance: JSON's true is Python's True, which is an int.
    if type(value) is not kind:
        raise _Mismatch
    return value


def _number(value: Any) -> float:
    if type(value) not in (float, int):
        raise _Mismatch
    return float(value)


def _chosen(value: Any, choices: tuple[Any, ...]) -> Any:
    if value not in choices:
        raise _Mismatch
    return value


def _refuse(constant: str) -> None:
    # NaN and the infinities, which Python reads and JSON does not have.
    raise _Mismatch(constant)


@cache
def _writer(kind: Any) -> _Writer:
    if is_dataclass(kind):
        return _document_writer(kind)
    if kind in _PLAIN_WRITERS:
        return _PLAIN_WRITERS[kind]
    if get_origin(kind) is tuple:
        element = _writer(get_args(kind)[0])
        return lambda value: f"[{','.join(map(element, value))}]"
    if get_origin(kind) is Literal:
        return _encode_text
    present = _writer(_present(kind))
    return lambda value: "null" if value is None else present(value)


def _document_writer(kind: Any) -> _Writer:
    types = _types(kind)
    parts = [
        (field.name, f'"{field.name}":', _writer(types[field.name]), "left_out_when_none" in field.metadata)
        for field in fields(kind)
    ]

    def write(document: Any) -> str:
        written = [
            label + writer(getattr(document, name))
            for name, label, writer, left_out in parts
            if not (left_out and getattr(document, name) is None)
        ]
        return f"{{{','.join(written)}}}"

    return write


def float_text(value: float) -> str:
    """A number as pydantic writes it: as Python does, except between 1e-9 and 1e-4, where Python writes 1e-05."""
    if not math.isfinite(value):
        raise ValueError(f"{value} is not a number of JSON")
    # `float` also for whole numbers, and for NumPy's, whose `repr` is another.
    text = repr(float(value))
    mantissa, padded, exponent = text.partition("e-0")
    if not padded:
        return text
    if exponent != "5":
        return f"{mantissa}e-{exponent}"
    sign = "-" if value < 0.0 else ""
    return f"{sign}0.0000{mantissa.lstrip('-').replace('.', '')}"


_PLAIN_WRITERS: dict[Any, _Writer] = {
    str: _encode_text,
    int: str,
    bool: lambda value: "true" if value else "false",
    float: float_text,
}


def _present(kind: Any) -> Any:
    """The type of a field that may also be None."""
    (present,) = (part for part in get_args(kind) if part is not NoneType)
    return present
