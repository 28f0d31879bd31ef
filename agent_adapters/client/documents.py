"""The JSON documents of `bench.contracts` as an agent reads them: by the types of their fields, without pydantic.

The bench refuses what is not a valid document; an agent only has to read what the bench writes. pydantic with its models took
almost half of the instructions of an agent's start.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

D = TypeVar("D")
_Reader = Callable[[Any], Any]


class _Mismatch(ValueError):
    """The JSON value is not of the type that its field has."""


def parse_document(kind: type[D], text: str | bytes) -> D | None:
    """The document in `text`, or None when it is not one of class `kind`; never raises. Limits are not looked at."""
    document_class: Any = kind
    try:
        document: D = _reader(document_class)(json.loads(text, parse_constant=_refuse))
    except (ValueError, RecursionError, OverflowError):
        return None
    return document


@cache
def _reader(kind: Any) -> _Reader:
    if is_dataclass(kind):
        return _document_reader(kind)
    if kind is float:
        return _number
    origin: Any = get_origin(kind)
    parts: tuple[Any, ...] = get_args(kind)
    if origin is Annotated:
        return _reader(parts[0])
    if origin is tuple:
        element = _reader(parts[0])
        return lambda value: tuple(map(element, _checked(value, list)))
    if origin is Literal:
        return lambda value: _chosen(value, parts)
    if origin in (Union, UnionType):
        (present,) = (_reader(part) for part in parts if part is not NoneType)
        return lambda value: None if value is None else present(value)
    return lambda value: _checked(value, kind)


def _document_reader(kind: Any) -> _Reader:
    types: dict[str, Any] = {field.name: field.type for field in fields(kind)}
    readers = {name: _reader(part) for name, part in types.items()}
    required = {field.name for field in fields(kind) if field.default is MISSING}

    def read(value: Any) -> Any:
        document = _checked(value, dict)
        if not required <= document.keys() <= readers.keys():
            raise _Mismatch
        return kind(**{name: readers[name](part) for name, part in document.items()})

    return read


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
