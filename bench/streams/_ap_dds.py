"""The messages and services of ArduPilot's ROS 2 topics (AP_DDS): message classes made of the layouts in `ap_msgs.json`.

Names, qualities of service and types are those of libraries/AP_DDS and Tools/ros2/ardupilot_msgs in ArduPilot's master of
December 2025. The layouts that have nothing of ArduPilot are those of common_interfaces and geographic_info.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import field, make_dataclass
from functools import cache
from importlib.resources import files
from typing import Annotated, Any

from ._keys import QoS
from ._schemas import Field, fields_of
from ._types import BY_NAME, RosMessage

_TABLE: Mapping[str, Any] = json.loads(files(__package__).joinpath("ap_msgs.json").read_text("utf-8"))

AP_TO_AGENT: Mapping[str, str] = {name: row["type"] for name, row in _TABLE["to_agent"].items()}
AP_FROM_AGENT: Mapping[str, str] = _TABLE["from_agent"]
AP_SERVICES: Mapping[str, str] = _TABLE["services"]
"""Types (`geometry_msgs/msg/TwistStamped`, `std_srvs/srv/Trigger`) by topic or service."""
AP_QOS: Mapping[str, QoS] = {
    name: QoS(row["reliable"], row["latched"], row["depth"]) for name, row in _TABLE["to_agent"].items()
}

_PLAIN: Mapping[str, tuple[Any, Any]] = {"bool": (bool, False), "string": (str, ""), "float64": (float, 0.0)}


@cache
def ap_message(name: str) -> type[RosMessage]:
    """The class of a type of ArduPilot's topics; of a service the class that its keys and its hash are made of (REP 2016).
    KeyError for any other.
    """
    if name in BY_NAME:
        return BY_NAME[name]
    parts = [_field(*line.split()) for line in _TABLE["messages"][name]]
    return make_dataclass(name.rpartition("/")[2], parts, namespace={"TYPE": name}, slots=True)


def _field(kind: str, name: str) -> tuple[str, Any, Any]:
    """Name, annotation and default of a field, from its line in a `.msg` file with full type names."""
    base, bracket, count = kind.partition("[")
    if "/" in base:
        nested: Any = ap_message(base)
        if bracket:
            return name, Annotated[tuple[nested, ...], f"[{count}"], ()
        return name, nested, field(default_factory=nested)
    if bracket:
        size = 0 if count == "]" else int(count[:-1])
        octets = base == "uint8" and not size
        return name, Annotated[tuple[float, ...], kind], b"" if octets else (0,) * size
    annotation, zero = _PLAIN.get(base) or (Annotated[float, kind], 0)
    return name, annotation, zero


def filled(kind: type[Any], values: Mapping[str, Any]) -> Any:
    """A message of a class: its fields by name, those of the messages in it as mappings likewise. What is not given is zero."""
    parts = {part.name: part for part in fields_of(kind)}  # type: ignore[arg-type]
    return kind(**{name: _value(parts[name], value) for name, value in values.items()})


def _value(part: Field, value: Any) -> Any:
    if isinstance(part.of, str):
        return value
    return filled(part.of, value) if part.count == "one" else tuple(filled(part.of, item) for item in value)
