"""Component metadata: compressed JSON files that explain parameters and events to a ground station."""

from __future__ import annotations

import json
import lzma
from collections.abc import Iterable, Mapping
from typing import Any

from ..state._parameter_store import REAL32, Parameter, crc32_plain
from ..state._texts import EventName
from ._served_files import FileContent

FOLDER = "etc/extras"
GENERAL = f"{FOLDER}/component_general.json.xz"
# COMP_METADATA_TYPE
_PARAMETERS, _EVENTS = 1, 4
_LISTED = {_PARAMETERS: f"{FOLDER}/parameters.json.xz", _EVENTS: f"{FOLDER}/all_events.json.xz"}


class Metadata:
    """The files of one autopilot. They are made when they are first requested, once."""

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

    def contents(self) -> Mapping[str, FileContent]:
        return {path: self._content(path) for path in (GENERAL, *_LISTED.values())}

    def _content(self, path: str) -> FileContent:
        return lambda query: self._make(path)

    def _make(self, path: str) -> bytes:
        if path not in self._made:
            self._made[path] = _compressed(self._document(path))
        return self._made[path]

    def _document(self, path: str) -> dict[str, Any]:
        if path == _LISTED[_PARAMETERS]:
            return {
                "version": 1,
                "parameters": [_parameter_entry(parameter) for parameter in self._parameters],
            }
        if path == _LISTED[_EVENTS]:
            events = {
                str(event.number & 0xFFFFFF): {"name": event.name, "message": event.text}
                for event in self._events
            }
            component = {"namespace": "px4", "enums": {}, "event_groups": {"default": {"events": events}}}
            return {"version": 2, "components": {"1": component}}
        # The general file lists the others with their checksums, so that a client can keep them.
        types = [
            {"type": kind, "uri": f"mftp://{path}", "fileCrc": crc32_plain(self._make(path))}
            for kind, path in _LISTED.items()
        ]
        return {"version": 1, "metadataTypes": types}


def _parameter_entry(parameter: Parameter) -> dict[str, Any]:
    whole = parameter.kind != REAL32
    entry: dict[str, Any] = {
        "name": parameter.name,
        "type": "Int32" if whole else "Float",
        "group": parameter.group or "Miscellaneous",
        "category": "Standard",
        "default": int(parameter.default) if whole else parameter.default,
        "shortDesc": parameter.description,
    }
    if not whole:
        entry["decimalPlaces"] = 3
    bounds = {"min": parameter.low, "max": parameter.high}
    entry.update({key: int(value) if whole else value for key, value in bounds.items() if value is not None})
    if parameter.unit:
        entry["units"] = parameter.unit
    if parameter.needs_reboot:
        entry["rebootRequired"] = True
    if parameter.volatile:
        entry["volatile"] = True
    return entry


def _compressed(document: Mapping[str, Any]) -> bytes:
    text = json.dumps(document, separators=(",", ":")).encode()
    return lzma.compress(text, format=lzma.FORMAT_XZ, check=lzma.CHECK_CRC32, preset=6)
