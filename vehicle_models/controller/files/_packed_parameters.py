"""`@PARAM/param.pck`: all parameters in one compact file, as ArduPilot's clients fetch them."""

from __future__ import annotations

import struct
from os.path import commonprefix
from urllib.parse import parse_qs

from ..state._parameter_store import INT8, INT16, INT32, REAL32, ParameterStore

_MAGIC, _MAGIC_DEFAULTS = 0x671B, 0x671C
# Magic, number here, number in all.
_HEAD = struct.Struct("<HHH")
_KINDS = {INT8: (1, "<b"), INT16: (2, "<h"), INT32: (3, "<i"), REAL32: (4, "<f")}
_HAS_DEFAULT = 1


def packed_parameters(store: ParameterStore, query: str) -> bytes:
    """The file for a query such as `start=0&count=100&withdefaults=1`.

    For each parameter: type and flags, the length of the prefix shared with the previous name, the rest of
    the name, the value, and the default where it differs and was requested. Names come in the order of the
    list.
    """
    options = {key: values[0] for key, values in parse_qs(query).items()}
    start, count = (_number(options.get(key, "")) for key in ("start", "count"))
    names = store.names[start : start + count if count else None]
    with_defaults = options.get("withdefaults") == "1"
    data, previous = b"", ""
    for name in names:
        type_code, code_format = _KINDS[store.kinds[name]]
        value, default = store[name], store.definitions[name].default
        flags = _HAS_DEFAULT if with_defaults and value != default else 0
        shared = commonprefix([previous, name])  # noqa: RUF071  (characters are meant, these are no paths)
        shared_length = min(len(shared), 15, len(name) - 1)
        entry = (
            bytes([flags << 4 | type_code, (len(name) - shared_length - 1) << 4 | shared_length])
            + name[shared_length:].encode()
        )
        numbers = (value, default) if flags else (value,)
        entry += b"".join(
            struct.pack(code_format, number if code_format == "<f" else int(number)) for number in numbers
        )
        data += entry
        previous = name
    return _HEAD.pack(_MAGIC_DEFAULTS if with_defaults else _MAGIC, len(names), len(store.names)) + data


def _number(text: str) -> int:
    return min(int(text), 65535) if text.isdigit() and len(text) < 10 else 0
