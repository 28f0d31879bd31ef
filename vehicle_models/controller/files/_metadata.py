"""Component metadata: JSON files that tell a ground station what parameters and events mean, compressed, with checksums."""

from __future__ import annotations

import json
import lzma
from collections.abc import Iterable, Mapping
from typing import Any

from ..parameters._store import REAL32, Parameter, crc32_plain
from ..telemetry._event_names import EventName
from ._files import Content

FOLDER = "etc/extras"
GENERAL = f"{FOLDER}/component_general.json.xz"
_PARAMETERS, _EVENTS = 1, 4  # COMP_METADATA_TYPE


class Metadata:
    """The files of one autopilot. They are made when first asked for, once."""

    def __init__(self, parameters: Iterable[Parameter], events: Iterable[EventName]) -> None:
        self._parameters = tuple(parameters)
        self._events = tuple(events)
        self._made: dict[str, bytes] = {}

    @property
    def uri(self) -> str:
        return f"mftp://{GENERAL}"

    def checksum(self) -> int:
        """The checksum of the general file."""
        return crc32_plain(self._make(GENERAL))

    def contents(self) -> Mapping[str, Content]:
        return {path: self._content(path) for path in (GENERAL, *self._listed().values())}

    def _listed(self) -> dict[int, str]:
        return {_PARAMETERS: f"{FOLDER}/parameters.json.xz", _EVENTS: f"{FOLDER}/all_events.json.xz"}

    def _content(self, path: str) -> Content:
        return lambda query: self._make(path)

    def _make(self, path: str) -> bytes:
        if path not in self._made:
            self._made[path] = _compressed(self._document(path))
        return self._made[path]

    def _document(self, path: str) -> dict[str, Any]:
        listed = self._listed()
        if path == listed[_PARAMETERS]:
            return {"version": 1, "parameters": [_parameter(one) for one in self._parameters]}
        if path == listed[_EVENTS]:
            events = {str(one.number & 0xFFFFFF): {"name": one.name, "message": one.message} for one in self._events}
            groups = {"default": {"events": events}}
            return {"version": 2, "components": {"1": {"namespace": "px4", "enums": {}, "event_groups": groups}}}
        types = [{"type": kind, "uri": f"mftp://{one}", "fileCrc": crc32_plain(self._make(one))} for kind, one in listed.items()]
        return {"version": 1, "metadataTypes": types}


def _parameter(one: Parameter) -> dict[str, Any]:
    whole = one.kind != REAL32
    entry: dict[str, Any] = {
        "name": one.name,
        "type": "Int32" if whole else "Float",
        "group": one.group or "Miscellaneous",
        "category": "Standard",
        "default": int(one.default) if whole else one.default,
        "shortDesc": one.description,
    }
    if not whole:
        entry["decimalPlaces"] = 3
    bounds = {"min": one.low, "max": one.high}
    entry.update({key: int(value) if whole else value for key, value in bounds.items() if value is not None})
    if one.unit:
        entry["units"] = one.unit
    if one.needs_reboot:
        entry["rebootRequired"] = True
    if one.volatile:
        entry["volatile"] = True
    return entry


def _compressed(document: Mapping[str, Any]) -> bytes:
    text = json.dumps(document, separators=(",", ":")).encode()
    return lzma.compress(text, format=lzma.FORMAT_XZ, check=lzma.CHECK_CRC32, preset=6)
