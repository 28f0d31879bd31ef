"""Parameters: the store, and the service that lists, reads and sets them."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from bench.errors import Fault, SetupError

from ._board import Board, CommandHandler, Handler, Sender
from ._frames import KINDS
from ._radio import Channel

INT8, INT16, UINT32, INT32, REAL32 = 2, 4, 5, 6, 9
_RANGE = {INT8: (-128, 127), INT16: (-32768, 32767), INT32: (-(2**31), 2**31 - 1)}
_VALUE = KINDS["PARAM_VALUE"].id
UNKNOWN_NAME, WRONG_TYPE = 1, 7  # MAV_PARAM_ERROR
LIST_PER_STEP = 20  # a list of a thousand takes about a second, as the real ones' do
HASH_CHECK = "_HASH_CHECK"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter with its default; `kind` is a MAV_PARAM_TYPE. The rest tells people what it means: a value outside
    `low` and `high` is taken all the same, as both autopilots do. A volatile one changes by itself."""

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


@dataclass(frozen=True, slots=True)
class Push:
    """A parameter that is sent unasked at `first_s`, and every `every_s` after that. `clock` counts running seconds."""

    name: str
    first_s: float
    every_s: float | None = None
    clock: bool = False


@dataclass(frozen=True, slots=True)
class ParameterStyle:
    """How an autopilot speaks of its parameters.

    `bytewise` puts an integer's bits into the float field; `hash_first` begins a list with _HASH_CHECK; `unknown`
    says whether an unknown name is answered by PARAM_ERROR or by silence; `index_in_replies` False gives 65535 instead
    of the index when asked by name; `any_case` finds names in any case and repeats the spelling asked for;
    `changes_twice` reports a changed value once more to everybody.
    """

    bytewise: bool
    hash_first: bool
    unknown: Literal["error", "silence"]
    index_in_replies: bool
    any_case: bool
    changes_twice: bool
    checks_type: bool
    pushes: tuple[Push, ...] = ()


class ParameterStore:
    """Values by name. Integers are kept whole. Raises SetupError for names in `given` that do not exist."""

    def __init__(self, parameters: Iterable[Parameter], given: Mapping[str, float]) -> None:
        ordered = tuple(parameters)
        self.definitions = {one.name: one for one in ordered}
        self.kinds = {one.name: one.kind for one in ordered}
        self.names = list(self.kinds)
        self.index = {name: number for number, name in enumerate(self.names)}
        self._values = {one.name: float(one.default) for one in ordered}
        self._saved: dict[str, float] = {}  # where that is not the present value
        self._listeners: list[Callable[[], None]] = []
        faults = [
            Fault(f"vehicle.parameters.{name}", "this autopilot has no such parameter here", self._near(name))
            for name in given
            if name not in self.kinds
        ]
        if faults:
            raise SetupError(faults)
        for name, value in given.items():
            self.put(name, value)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def put(self, name: str, value: float, *, saves: bool = True) -> bool:
        """Store a value; True when that changed it. Raises KeyError for an unknown name; what is not finite is refused.

        What is not saved holds until the next start, which has the value from before again."""
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
        """The CRC-32 over names and values that PX4 and ground stations compute: no inversion, nothing volatile."""
        crc = 0
        for name, definition in self.definitions.items():
            if not definition.volatile:
                crc = crc32_plain(name.encode() + self.packed(name), crc)
        return crc

    def changed(self) -> dict[str, float]:
        """What is saved and differs from the defaults, without what changes by itself."""
        saved = {**self._values, **self._saved}
        return {
            name: saved[name] for name, one in self.definitions.items() if not one.volatile and saved[name] != float(one.default)
        }

    def packed(self, name: str) -> bytes:
        """Four bytes: a float, or an integer for integer kinds."""
        value = self._values[name]
        return struct.pack("<f", value) if self.kinds[name] == REAL32 else struct.pack("<i", int(value))

    def _near(self, name: str) -> str:
        close = [known for known in self.names if known.startswith(name[:3])]
        return f"there are, for example, {', '.join(close[:5] or self.names[:5])}"


def crc32_plain(data: bytes, crc: int = 0) -> int:
    """CRC-32 as embedded code has it (begun at 0, not inverted): MAVLink's file transfer, PX4's parameter hash."""
    return zlib.crc32(data, crc ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


class Parameters:
    """PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET, and what is sent unasked."""

    def __init__(self, board: Board) -> None:
        self._store = board.parameters
        self._style = board.personality.parameter_style
        self._radio = board.radio
        self._flight = board.flight
        self._lists: dict[str, tuple[Channel, int]] = {}  # by channel: the next index to send
        self._pushes = [(round(one.first_s * 1e9), one) for one in self._style.pushes]
        self._next_push_ns = min((due for due, _ in self._pushes), default=None)

    def handlers(self) -> Mapping[str, Handler]:
        return {"PARAM_REQUEST_LIST": self._list, "PARAM_REQUEST_READ": self._read, "PARAM_SET": self._set}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        if self._lists:
            self._go_on_listing()
        if self._next_push_ns is not None and self._next_push_ns <= self._flight.time_ns:
            self._push()

    def _push(self) -> None:
        """Send what is due, to those who have spoken."""
        later = []
        for due_ns, push in self._pushes:
            if due_ns <= self._flight.time_ns:
                if push.clock:
                    self._store.put(push.name, due_ns // 1_000_000_000)
                for channel in self._radio.channels:
                    if channel.heard:
                        self._say(channel, push.name, 65535)
                if push.every_s is None:
                    continue
                due_ns += round(push.every_s * 1e9)
            later.append((due_ns, push))
        self._pushes = later
        self._next_push_ns = min((due for due, _ in later), default=None)

    def _go_on_listing(self) -> None:
        for name, (channel, at) in list(self._lists.items()):
            end = min(at + LIST_PER_STEP, len(self._store.names))
            for index in range(at, end):
                self._say(channel, self._store.names[index], index)
            if end < len(self._store.names):
                self._lists[name] = (channel, end)
            else:
                del self._lists[name]

    def _list(self, message: Any, sender: Sender) -> None:
        if self._style.hash_first:
            self._say_hash(sender.channel)
        self._lists[sender.channel.name] = (sender.channel, 0)

    def _read(self, message: Any, sender: Sender) -> None:
        if message.param_index >= 0:
            if message.param_index < len(self._store.names):
                self._say(sender.channel, self._store.names[message.param_index], message.param_index)
            else:
                self._refuse(sender, "", UNKNOWN_NAME)
        elif message.param_id == HASH_CHECK and self._style.hash_first:
            self._say_hash(sender.channel)
        else:
            self._by_name(message.param_id, sender)

    def _by_name(self, asked: str, sender: Sender) -> None:
        name = self._find(asked)
        if name is None:
            self._refuse(sender, asked, UNKNOWN_NAME)
        else:
            self._say(sender.channel, name, self._reply_index(name), asked)

    def _set(self, message: Any, sender: Sender) -> None:
        if self._style.hash_first and message.param_id == HASH_CHECK:
            self._lists.pop(sender.channel.name, None)  # the client knows them all by the hash: the list ends
            return
        name = self._find(message.param_id)
        if name is None:
            self._refuse(sender, message.param_id, UNKNOWN_NAME)
            return
        kind = self._store.kinds[name]
        if self._style.checks_type and message.param_type != kind:
            self._refuse(sender, message.param_id, WRONG_TYPE)
            return
        value = float(message.param_value)
        if self._style.bytewise and kind != REAL32:
            value = float(struct.unpack("<i", struct.pack("<f", value))[0])
        elif not math.isfinite(value) and not self._style.bytewise:
            return
        changed = self._store.put(name, value)
        self._say(sender.channel, name, self._reply_index(name), message.param_id)
        if changed and self._style.changes_twice:
            for channel in self._radio.channels:
                self._say(channel, name, self._reply_index(name))

    def _find(self, asked: str) -> str | None:
        if asked in self._store.kinds:
            return asked
        upper = asked.upper()
        return upper if self._style.any_case and upper in self._store.kinds else None

    def _reply_index(self, name: str) -> int:
        return self._store.index[name] if self._style.index_in_replies else 65535

    def _say(self, channel: Channel, name: str, index: int, spelling: str = "") -> None:
        kind = self._store.kinds[name]
        if self._style.bytewise:
            (value,) = struct.unpack("<f", self._store.packed(name))
        else:
            value = self._store[name]
        channel.say(_VALUE, (value, len(self._store.names), index, (spelling or name).encode(), kind))

    def _say_hash(self, channel: Channel) -> None:
        (value,) = struct.unpack("<f", struct.pack("<I", self._store.digest()))
        channel.say(_VALUE, (value, len(self._store.names), 65535, HASH_CHECK.encode(), UINT32))

    def _refuse(self, sender: Sender, name: str, error: int) -> None:
        if self._style.unknown == "error":
            sender.channel.tell(
                "PARAM_ERROR",
                target_system=sender.system,
                target_component=sender.component,
                param_id=name.encode(),
                param_index=-1,
                error=error,
            )
