"""The messages of PX4's ROS 2 topics, release by release: message classes made of the layouts in `px4_msgs.json`.

The layouts are those of PX4/px4_msgs (BSD-3-Clause) at release/1.16, release/1.17, release/1.18, and main of July 2026.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import make_dataclass
from functools import cache
from importlib.resources import files
from typing import Annotated, Any

from ._router import PX4_PREFIX
from ._schemas import type_hash
from ._types import RosMessage

_TABLE: Mapping[str, Any] = json.loads(files(__package__).joinpath("px4_msgs.json").read_text("utf-8"))
_MAIN = "main"

PX4_RELEASES = ("1.16", "1.17", "1.18")
"""Those that a session can speak; one of them, because two hashes of a type on one graph match nothing."""
PX4_TO_AGENT: Mapping[str, str] = {f"{PX4_PREFIX}out/{name}": kind for name, kind in _TABLE["out"].items()}
PX4_FROM_AGENT: Mapping[str, str] = {f"{PX4_PREFIX}in/{name}": kind for name, kind in _TABLE["in"].items()}
"""Message names (`VehicleStatus`) by topic (`/fmu/out/vehicle_status`), of all releases."""
_VERSION = re.compile(r"_v\d+$")


@cache
def px4_message(name: str, release: str) -> type[RosMessage]:
    """The class of a message (`VehicleStatus`) as a release has it. KeyError for what it does not have."""
    for layout in _TABLE["messages"][name]:
        if release in layout["releases"]:
            fields = [_field(release, *text.split()) for text in layout["fields"]]
            return make_dataclass(name, fields, namespace={"TYPE": f"px4_msgs/msg/{name}"}, slots=True)
    raise KeyError((name, release))


def px4_names(topic: str, release: str) -> tuple[str, ...]:
    """The names of a topic in a release: its own, and with `_vN` behind it, as over uXRCE-DDS, where its message has a
    version. None for a topic that the release does not have.
    """
    kind = PX4_TO_AGENT.get(topic) or PX4_FROM_AGENT.get(topic)
    if kind is None or release not in _TABLE["only"].get(topic.rpartition("/")[2], PX4_RELEASES):
        return ()
    version = _TABLE["versions"].get(kind, {}).get(release)
    return (topic, f"{topic}_v{version}") if version else (topic,)


def px4_plain_name(name: str) -> str:
    """A topic's name without `_vN`."""
    return _VERSION.sub("", name)


def px4_releases_of(name: str, hashed: str) -> list[str]:
    """The releases in which a message has this type hash."""
    if name not in _TABLE["messages"]:
        return []
    releases = (*PX4_RELEASES, _MAIN)
    have = [
        release
        for release in releases
        if any(release in layout["releases"] for layout in _TABLE["messages"][name])
    ]
    return [release for release in have if type_hash(px4_message(name, release)) == hashed]


def _field(release: str, kind: str, name: str) -> tuple[str, Any, Any]:
    """Name, annotation and default of a field, from its line in a `.msg` file."""
    base, _, count = kind.partition("[")
    zero: object = False if base == "bool" else 0.0 if base.startswith("float") else 0
    if base in _TABLE["messages"]:
        nested = px4_message(base, release)
        return name, Annotated[tuple[nested, ...], f"[{count}"], (nested(),) * int(count[:-1])  # type: ignore[valid-type]
    if count:
        return name, Annotated[tuple[float, ...], kind], (zero,) * int(count[:-1])
    annotation = {"bool": bool, "float64": float}.get(base) or Annotated[float, kind]
    return name, annotation, zero
