"""Parameters of an autopilot: their definitions, the tables that hold these, and the store of their values."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.errors import Fault, SetupError

from ..._read_table import read_table

INT8, INT16, UINT32, INT32, REAL32 = 2, 4, 5, 6, 9
KINDS_BY_NAME = {"float": REAL32, "int8": INT8, "int16": INT16, "int32": INT32}
_RANGE = {INT8: (-128, 127), INT16: (-32768, 32767), INT32: (-(2**31), 2**31 - 1)}


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter with its default; `kind` is a MAV_PARAM_TYPE. The other fields explain it: a value
    outside `low` and `high` is stored all the same, as on both autopilots. A volatile parameter changes by
    itself.
    """

    name: str
    default: float
    kind: int = REAL32
    low: float | None = None
    high: float | None = None
    unit: str = ""
    group: str = ""
    description: str = ""
    volatile: bool = False
    needs_reboot: bool = False


def read_parameters(table: Path) -> tuple[Parameter, ...]:
    """The parameters of a CSV table, in its order, which is that of the autopilot's list.

    The columns are name, type (float, int8, int16, int32), default, min, max, unit, group, flags (reboot,
    volatile), description. All but the first three may be empty.
    """
    return tuple(
        Parameter(
            row["name"],
            float(row["default"]),
            KINDS_BY_NAME[row["type"]],
            low=float(row["min"]) if row["min"] else None,
            high=float(row["max"]) if row["max"] else None,
            unit=row["unit"],
            group=row["group"],
            description=row["description"],
            volatile="volatile" in row["flags"],
            needs_reboot="reboot" in row["flags"],
        )
        for row in read_table(table)
    )


class ParameterStore:
    """Values by name; integers stay integers. Raises SetupError for names in `initial` that do not exist."""

    def __init__(self, parameters: Iterable[Parameter], initial: Mapping[str, float]) -> None:
        ordered = tuple(parameters)
        self.definitions = {parameter.name: parameter for parameter in ordered}
        self.kinds = {parameter.name: parameter.kind for parameter in ordered}
        self.names = list(self.kinds)
        self.index = {name: number for number, name in enumerate(self.names)}
        self._values = {parameter.name: float(parameter.default) for parameter in ordered}
        self._saved: dict[str, float] = {}  # where it differs from the present value
        self._listeners: list[Callable[[], None]] = []
        faults = [
            Fault(
                f"vehicle.parameters.{name}",
                "this autopilot has no such parameter here",
                self._similar_names(name),
            )
            for name in initial
            if name not in self.kinds
        ]
        if faults:
            raise SetupError(faults)
        for name, value in initial.items():
            self.put(name, value)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def put(self, name: str, value: float, *, saves: bool = True) -> bool:
        """Store a value; True when that changed it. Raises KeyError for an unknown name; a value that is not
        finite is refused.

        A value that is not saved holds until the next start, which has the previous value again.
        """
        old = self._values[name]
        if not math.isfinite(value):
            return False
        if saves:
            self._saved.pop(name, None)
        else:
            self._saved.setdefault(name, old)
        if self.kinds[name] != REAL32:
            low, high = _RANGE[self.kinds[name]]
            value = float(min(max(int(value), low), high))
        else:
            # Clients read values as 32-bit floats, so the store rounds to what they see.
            value = float(struct.unpack("<f", struct.pack("<f", value))[0]) if abs(value) < 3.4e38 else old
        self._values[name] = value
        if value == old:
            return False
        for listener in self._listeners:
            listener()
        return True

    def on_change(self, listener: Callable[[], None]) -> None:
        """Call `listener` after every change."""
        self._listeners.append(listener)

    def digest(self) -> int:
        """The CRC-32 over names and values of PX4 and ground stations: not inverted, no volatile parameters."""
        crc = 0
        for name, definition in self.definitions.items():
            if not definition.volatile:
                crc = crc32_plain(name.encode() + self.packed(name), crc)
        return crc

    def changed(self) -> dict[str, float]:
        """Saved values that differ from the defaults, without volatile parameters."""
        saved = {**self._values, **self._saved}
        return {
            name: saved[name]
            for name, parameter in self.definitions.items()
            if not parameter.volatile and saved[name] != float(parameter.default)
        }

    def packed(self, name: str) -> bytes:
        """Four bytes: a float, or an integer for integer kinds."""
        value = self._values[name]
        return struct.pack("<f", value) if self.kinds[name] == REAL32 else struct.pack("<i", int(value))

    def _similar_names(self, name: str) -> str:
        close = [known for known in self.names if known.startswith(name[:3])]
        return f"there are, for example, {', '.join(close[:5] or self.names[:5])}"


def crc32_plain(data: bytes, crc: int = 0) -> int:
    """CRC-32 that begins at 0 and is not inverted, as of MAVLink's file transfer and PX4's parameter hash."""
    return zlib.crc32(data, crc ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
