"""CDR, plain version 1: the bytes of a message on the wire and in a recording.

A message class is compiled once into steps: fixed-width fields that follow each other are one `struct` call,
whatever messages they are nested in. Padding depends on the offset modulo 8 alone, so every run has eight
`struct` formats.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from itertools import islice
from operator import attrgetter
from typing import Any, TypeVar, overload

from ._schemas import Field, fields_of
from ._types import RosMessage, message_class

# Plain CDR, little endian, no options.
HEADER = b"\x00\x01\x00\x00"
# CDR aligns each of these to its own size.
_SIZES = {"b": 1, "B": 1, "?": 1, "H": 2, "i": 4, "I": 4, "Q": 8, "f": 4, "d": 8}
_FORMATS = {
    "int8": "b",
    "uint8": "B",
    "bool": "?",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
# Some writers pad the end of a sample to four bytes.
_MAX_TRAILING = 3
_LITTLE, _BIG = "<", ">"

M = TypeVar("M")
_Write = Callable[[bytearray, Any], None]
_Read = Callable[[bytes, int, list[Any]], int]
_Build = Callable[[Iterator[Any]], Any]


class _Malformed(ValueError):
    """These bytes are not such a message."""


def encode(message: object) -> bytes:
    """The CDR bytes of a message, header included.

    Raises ValueError when a value does not fit its field, TypeError for what is no message at all.
    """
    out = bytearray(HEADER)
    kind: Any = type(message)
    try:
        for write in _writers(kind):
            write(out, message)
    except (struct.error, OverflowError) as error:  # the latter of a float that is too large for 32 bits
        raise ValueError(f"{kind.TYPE}: a value does not fit its field: {error}") from error
    return bytes(out)


@overload
def decode(kind: type[M], data: bytes) -> M | None: ...
@overload
def decode(kind: str, data: bytes) -> Any: ...
def decode(kind: type[M] | str, data: bytes) -> Any:
    """The message in CDR bytes of either byte order, or None when they are not one (truncated, oversized, not
    UTF-8).

    Never raises on bad data, and does no more work than its length allows. `kind` may be a type's name; an
    unknown one is a KeyError, since it is the caller's and not the sender's.
    """
    if isinstance(kind, str):
        named = message_class(kind)
        if named is None:
            raise KeyError(kind)
        return decode(named, data)
    # Byte 1 is 0 for big endian and 1 for little; other values are encodings such as XCDR2.
    if len(data) < 4 or data[0] != 0 or data[1] > 1:
        return None
    of: Any = kind
    read, build = _reader(of, _LITTLE if data[1] else _BIG)
    values: list[Any] = []
    try:
        end = read(data, 4, values)
    except (struct.error, _Malformed, UnicodeDecodeError):
        return None
    return build(iter(values)) if len(data) - end <= _MAX_TRAILING else None


# The plan of a class: its leaves, and the runs among them.


def _leaves(kind: type[RosMessage], path: str = "") -> Iterator[tuple[str, Field]]:
    """The fields of a message and of the messages in it, in the order of the wire, each with its dotted
    path.
    """
    for field in fields_of(kind):
        if isinstance(field.of, str) or field.count != "one":
            yield path + field.name, field
        else:
            yield from _leaves(field.of, f"{path}{field.name}.")


def _runs(kind: type[RosMessage]) -> Iterator[list[tuple[str, Field]]]:
    """The leaves, single fixed-width ones that follow each other together."""
    run: list[tuple[str, Field]] = []
    for leaf in _leaves(kind):
        if _is_fixed(leaf[1]):
            run.append(leaf)
            continue
        if run:
            yield run
        run = []
        yield [leaf]
    if run:
        yield run


def _is_fixed(field: Field) -> bool:
    return field.count == "one" and field.of in _FORMATS


@cache
def _phased(formats: str, order: str = _LITTLE) -> tuple[struct.Struct, ...]:
    """`formats` with its padding, for every offset modulo 8; offsets count the header's four bytes, alignment
    does not.
    """
    # Eight formats suffice: no primitive is aligned to more than 8 bytes.
    return tuple(_padded(formats, order, (offset - len(HEADER)) % 8) for offset in range(8))


def _padded(formats: str, order: str, offset: int) -> struct.Struct:
    text = order
    for code in formats:
        gap = -offset % _SIZES[code]
        text += "x" * gap + code
        offset += gap + _SIZES[code]
    return struct.Struct(text)


@cache
def _many(count: int, code: str, order: str = _LITTLE) -> struct.Struct:
    return struct.Struct(f"{order}{count}{code}")


_U32 = _phased("I")


# Writing.


@cache
def _writers(kind: type[RosMessage]) -> tuple[_Write, ...]:
    return tuple(_writer(run) for run in _runs(kind))


def _writer(run: list[tuple[str, Field]]) -> _Write:
    path, field = run[0]
    if _is_fixed(field):
        return _write_run(run)
    get = attrgetter(path)
    if isinstance(field.of, str):
        if field.of == "string":
            return _write_string(get)
        if field.count == "array":
            return _write_array(get, _FORMATS[field.of], field.size)
        return _write_octets(get) if field.of == "uint8" else _write_numbers(get, _FORMATS[field.of])
    return _write_messages(get, field.of, field.size)


def _write_run(run: list[tuple[str, Field]]) -> _Write:
    structs = _phased("".join(_FORMATS[str(field.of)] for _, field in run))
    get = attrgetter(*(path for path, _ in run))
    # attrgetter gives one value for one name, and a tuple for several.
    if len(run) == 1:

        def write_one(out: bytearray, message: Any) -> None:
            out += structs[len(out) & 7].pack(get(message))

        return write_one

    def write(out: bytearray, message: Any) -> None:
        out += structs[len(out) & 7].pack(*get(message))

    return write


def _write_string(get: Callable[[Any], str]) -> _Write:
    def write(out: bytearray, message: Any) -> None:
        text = get(message)
        encoded = _frequent_string if len(text) <= _MAX_FREQUENT else _string
        out += encoded(text, len(out) & 3)

    return write


def _string(text: str, phase: int) -> bytes:
    """A string at an offset modulo 4, with the padding before it. The length counts the closing NUL."""
    data = text.encode()
    return bytes(-phase & 3) + (len(data) + 1).to_bytes(4, "little") + data + b"\0"


# Names of frames, classes and tracks come again in each message; documents do not.
_MAX_FREQUENT = 48
_frequent_string = lru_cache(maxsize=1024)(_string)


def _write_octets(get: Callable[[Any], bytes]) -> _Write:
    def write(out: bytearray, message: Any) -> None:
        data = get(message)
        out += _U32[len(out) & 7].pack(len(data))
        out += data

    return write


def _write_array(get: Callable[[Any], tuple[float, ...]], code: str, size: int) -> _Write:
    structs = _phased(code * size)

    def write(out: bytearray, message: Any) -> None:
        out += structs[len(out) & 7].pack(*get(message))

    return write


def _write_numbers(get: Callable[[Any], tuple[float, ...]], code: str) -> _Write:
    size = _SIZES[code]

    def write(out: bytearray, message: Any) -> None:
        values = get(message)
        out += _U32[len(out) & 7].pack(len(values))
        if values:
            # Without elements there is no padding for their type, as in Fast-CDR.
            out += bytes((4 - len(out)) % size)
            out += struct.pack(f"<{len(values)}{code}", *values)

    return write


def _write_messages(get: Callable[[Any], tuple[Any, ...]], kind: type[RosMessage], size: int) -> _Write:
    """A sequence of messages; with a `size` an array, which has no count."""
    writers = _writers(kind)

    def write(out: bytearray, message: Any) -> None:
        elements = get(message)
        if not size:
            out += _U32[len(out) & 7].pack(len(elements))
        elif len(elements) != size:
            raise struct.error(f"{len(elements)} elements in place of {size}")
        for element in elements:
            for step in writers:
                step(out, element)

    return write


# Reading: the leaves into a flat list, then the tree of messages from it.


@cache
def _reader(kind: type[RosMessage], order: str) -> tuple[_Read, _Build]:
    steps = tuple(_step(run, order) for run in _runs(kind))

    def read(data: bytes, at: int, values: list[Any]) -> int:
        for step in steps:
            at = step(data, at, values)
        return at

    return (steps[0] if len(steps) == 1 else read), _builder(kind)


@cache
def _builder(kind: type[RosMessage]) -> _Build:
    parts = [
        None if isinstance(field.of, str) or field.count != "one" else _builder(field.of)
        for field in fields_of(kind)
    ]
    if not any(parts):
        size = len(parts)
        return lambda values: kind(*islice(values, size))
    return lambda values: kind(*[next(values) if part is None else part(values) for part in parts])


def _step(run: list[tuple[str, Field]], order: str) -> _Read:
    _, first = run[0]
    if _is_fixed(first):
        return _read_run("".join(_FORMATS[str(leaf.of)] for _, leaf in run), order)
    if isinstance(first.of, str):
        if first.of == "string":
            return _read_string(order)
        if first.count == "array":
            return _read_array(_FORMATS[first.of], first.size, order)
        return _read_octets(order) if first.of == "uint8" else _read_numbers(_FORMATS[first.of], order)
    return _read_messages(first.of, order, first.size)


def _read_run(formats: str, order: str) -> _Read:
    structs = _phased(formats, order)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        layout = structs[at & 7]
        values += layout.unpack_from(data, at)
        return at + layout.size

    return read


def _read_array(code: str, size: int, order: str) -> _Read:
    structs = _phased(code * size, order)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        layout = structs[at & 7]
        values.append(layout.unpack_from(data, at))
        return at + layout.size

    return read


def _counter(order: str) -> Callable[[bytes, int], tuple[int, int]]:
    """Reads the uint32 before a string or sequence; also the offset after it."""
    structs = _phased("I", order)

    def count(data: bytes, at: int) -> tuple[int, int]:
        layout = structs[at & 7]
        return layout.unpack_from(data, at)[0], at + layout.size

    return count


def _read_string(order: str) -> _Read:
    count = _counter(order)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        length, at = count(data, at)
        end = at + length
        if end > len(data) or (length and data[end - 1]):
            raise _Malformed
        values.append(str(data[at : end - 1], "utf-8") if length else "")
        return end

    return read


def _read_octets(order: str) -> _Read:
    count = _counter(order)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        length, at = count(data, at)
        end = at + length
        if end > len(data):
            raise _Malformed
        values.append(data[at:end])
        return end

    return read


def _read_numbers(code: str, order: str) -> _Read:
    count = _counter(order)
    size = _SIZES[code]

    def read(data: bytes, at: int, values: list[Any]) -> int:
        length, at = count(data, at)
        if not length:
            values.append(())
            return at
        at += (4 - at) % size
        end = at + length * size
        # Before the format is built: its size is the sender's.
        if end > len(data):
            raise _Malformed
        values.append(struct.unpack_from(f"{order}{length}{code}", data, at))
        return end

    return read


def _read_messages(kind: type[RosMessage], order: str, size: int) -> _Read:
    count = _counter(order)
    inner, build = _reader(kind, order)
    least = _least_size(kind)

    def read(data: bytes, at: int, values: list[Any]) -> int:
        length, at = (size, at) if size else count(data, at)
        # Before the loop: a sender could claim four billion elements in a few bytes.
        if length * least > len(data) - at:
            raise _Malformed
        flat: list[Any] = []
        for _ in range(length):
            at = inner(data, at, flat)
        each = iter(flat)
        values.append(tuple([build(each) for _ in range(length)]))
        return at

    return read


def _least_size(kind: type[RosMessage]) -> int:
    """Bytes that any message of this class takes at least, padding aside; at least 1."""
    return sum(_least(field) for _, field in _leaves(kind))


def _least(field: Field) -> int:
    if field.count == "sequence" or field.of == "string":
        return 4
    least = _SIZES[_FORMATS[field.of]] if isinstance(field.of, str) else _least_size(field.of)
    return least * max(field.size, 1)
