"""Random messages, and the same ones as rosbags has and encodes them."""

from __future__ import annotations

from random import Random
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from bench.streams import encode, schema_text
from bench.streams._schemas import fields_of

WHOLE = {f"{sign}int{bits}": bits for sign in ("", "u") for bits in (8, 16, 32, 64)}


def random_message(kind: Any, random: Random) -> Any:
    """With values of every field's whole range; sequences have up to three elements."""

    def value(of: Any) -> Any:
        if not isinstance(of, str):
            return random_message(of, random)
        if of in ("string", "bool"):
            return random.choice(("", "base_link", "x" * 50) if of == "string" else (False, True))
        if of in WHOLE:
            low = 0 if of[0] == "u" else -(2 ** (WHOLE[of] - 1))
            return random.randint(low, low + 2 ** WHOLE[of] - 1)
        return float(np.float32(random.uniform(-1e6, 1e6)))

    fields: dict[str, Any] = {}
    for field in fields_of(kind):
        size = field.size if field.count == "array" else random.randrange(4)
        drawn = tuple(value(field.of) for _ in range(size))
        octets = field.of == "uint8" and field.count == "sequence"
        fields[field.name] = value(field.of) if field.count == "one" else bytes(drawn) if octets else drawn
    return kind(**fields)


def store_of(kind: Any) -> Typestore:
    """The types of rosbags that its parser reads in the schema text of a recording."""
    store = get_typestore(Stores.EMPTY)
    main, *parts = schema_text(kind).split("=" * 80 + "\n")
    for part in parts:
        head, _, body = part.partition("\n")
        store.register(get_types_from_msg(body, head.removeprefix("MSG: ").replace("/", "/msg/")))
    store.register(get_types_from_msg(main, rosbags_name(kind)))
    return store


def rosbags_name(kind: Any) -> str:
    """rosbags knows no services; a part of one is a message to it."""
    return str(kind.TYPE).replace("/srv/", "/msg/")


def as_theirs(store: Typestore, name: str, mine: Any) -> Any:
    """The same message as an object of rosbags."""
    fields: dict[str, Any] = {}
    description: Any = store.fielddefs[name][1]
    for field, (node, detail) in description:
        value = getattr(mine, field)
        # Of rosbags' nodes 1 is a plain value, 2 a message; what is above are arrays, whose detail has that of an element.
        if int(node) == 2:
            fields[field] = as_theirs(store, str(detail), value)
        elif int(node) > 2 and int(detail[0][0]) == 2:
            fields[field] = [as_theirs(store, detail[0][1], element) for element in value]
        elif int(node) > 2:
            fields[field] = np.array(list(value), dtype=detail[0][1][0])
        else:
            fields[field] = value
    return store.types[name](**fields)


def encoded(store: Typestore, mine: Any, *, little_endian: bool = True) -> bytes:
    """The bytes of a message by rosbags, without the padding that it may add to a multiple of four."""
    name = rosbags_name(type(mine))
    data = bytes(store.serialize_cdr(as_theirs(store, name, mine), name, little_endian=little_endian))
    length = len(encode(mine))
    assert len(data) - length < 4
    assert not any(data[length:])
    return data[:length]
