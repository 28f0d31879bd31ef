"""`@PARAM/param.pck`: all parameters in one compact file, as ArduPilot's clients fetch them."""

from __future__ import annotations

import struct
from urllib.parse import parse_qs

from ..parameters._store import INT8, INT16, INT32, REAL32, ParameterStore

_MAGIC, _MAGIC_DEFAULTS = 0x671B, 0x671C
_HEAD = struct.Struct("<HHH")  # magic, number here, number in all
_KINDS = {INT8: (1, "<b"), INT16: (2, "<h"), INT32: (3, "<i"), REAL32: (4, "<f")}
_HAS_DEFAULT = 1


def packed_parameters(store: ParameterStore, query: str) -> bytes:
    """The file for a query such as `start=0&count=100&withdefaults=1`.

    Of each: kind and flags, the length of the name shared with the one before, the rest of the name, the value, and
    the default where it differs and was asked for. Names come sorted by their place in the list.
    """
    asked = {key: found[0] for key, found in parse_qs(query).items()}
    start, count = (_whole(asked.get(key, "")) for key in ("start", "count"))
    names = store.names[start : start + count if count else None]
    with_defaults = asked.get("withdefaults") == "1"
    data, previous = b"", ""
    for name in names:
        code, form = _KINDS[store.kinds[name]]
        value, default = store[name], store.definitions[name].default
        flags = _HAS_DEFAULT if with_defaults and value != default else 0
        shared = _shared(previous, name)
        entry = bytes([flags << 4 | code, (len(name) - shared - 1) << 4 | shared]) + name[shared:].encode()
        numbers = (value, default) if flags else (value,)
        entry += b"".join(struct.pack(form, one if form == "<f" else int(one)) for one in numbers)
        data += entry
        previous = name
    return _HEAD.pack(_MAGIC_DEFAULTS if with_defaults else _MAGIC, len(names), len(store.names)) + data


def _shared(one: str, other: str) -> int:
    length = 0
    for left, right in zip(one, other, strict=False):
        if left != right or length == min(15, len(other) - 1):
            break
        length += 1
    return length


def _whole(text: str) -> int:
    return min(int(text), 65535) if text.isdigit() and len(text) < 10 else 0
