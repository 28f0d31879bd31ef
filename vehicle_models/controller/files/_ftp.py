"""MAVLink FTP: what is asked for in FILE_TRANSFER_PROTOCOL payloads, over the files that are served and a scratch area."""

from __future__ import annotations

import errno
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext
from ..parameters._store import crc32_plain
from ._files import Files

DATA = 239  # bytes of data in one payload
_HEAD = struct.Struct("<HBBBBBBI")  # sequence, session, opcode, size, asked opcode, burst complete, padding, offset
_IDLE_NS = 10_000_000_000  # a session that nobody uses so long is closed
_BURST_PER_STEP = 8
_BURST_BYTES = 35 * 1024  # then the client asks again


class Op(IntEnum):
    """Opcodes."""

    NONE = 0
    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN = 4
    READ = 5
    CREATE = 6
    WRITE = 7
    REMOVE = 8
    MAKE_FOLDER = 9
    REMOVE_FOLDER = 10
    OPEN_WRITE = 11
    TRUNCATE = 12
    RENAME = 13
    CRC32 = 14
    BURST = 15
    ACK = 128
    NAK = 129


class Error(IntEnum):
    """Error codes of a NAK."""

    ERRNO = 2  # a POSIX number follows
    INVALID_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    EXISTS = 8
    PROTECTED = 9
    NOT_FOUND = 10


_BY_ERRNO = {
    errno.EEXIST: Error.EXISTS,
    errno.ENOENT: Error.NOT_FOUND,
    errno.EACCES: Error.PROTECTED,
    errno.EROFS: Error.PROTECTED,
}


class _Refused(Exception):
    def __init__(self, error: Error, number: int | None = None) -> None:
        self.error = error
        self.data = bytes([error]) if number is None else bytes([error, number & 0xFF])


@dataclass(slots=True)
class _Request:
    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        return self.data.split(b"\0", 1)[0].decode("utf-8", "replace")


@dataclass(slots=True)
class _Session:
    content: bytes
    used_ns: int
    writes: str | None = None  # the path of a file that is written


@dataclass(slots=True)
class _Burst:
    sender: Sender
    session: int
    sequence: int
    at: int
    end: int
    size: int


class FileTransfer:
    """Sessions, reading, bursts, listings and checksums; writing, where the files can be written.

    `sessions` is how many files may be open; with one, its number is the vehicle's to give (0), with several the
    client's to choose, as the two autopilots have it.
    """

    def __init__(self, board: ServiceContext, files: Files, sessions: int) -> None:
        self._flight = board.flight
        self._files = files
        self._most = sessions
        self._sessions: dict[int, _Session] = {}
        self._bursts: dict[int, _Burst] = {}
        self._last: dict[tuple[int, int, str], tuple[bytes, bytes]] = {}  # by client: the last request and its answer
        self._table: dict[int, Callable[[_Request], bytes]] = {
            Op.NONE: lambda asked: b"",
            Op.TERMINATE: self._terminate,
            Op.RESET: self._reset,
            Op.LIST: self._list,
            Op.OPEN: self._open,
            Op.READ: self._read,
            Op.CRC32: self._checksum,
            Op.CREATE: lambda asked: self._open_to_write(asked, keeps=False),
            Op.OPEN_WRITE: lambda asked: self._open_to_write(asked, keeps=True),
            Op.WRITE: self._write,
            Op.REMOVE: lambda asked: self._change(files.remove, asked.path),
            Op.MAKE_FOLDER: lambda asked: self._change(files.make_folder, asked.path),
            Op.REMOVE_FOLDER: lambda asked: self._change(files.remove_folder, asked.path),
            Op.TRUNCATE: lambda asked: self._change(files.truncate, asked.path, asked.offset),
            Op.RENAME: self._rename,
        }

    def handlers(self) -> Mapping[str, Handler]:
        return {"FILE_TRANSFER_PROTOCOL": self._hear}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        if self._bursts:
            for number in list(self._bursts):
                self._go_on(number)

    def _hear(self, message: Any, sender: Sender) -> None:
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, _, offset = _HEAD.unpack_from(payload)
        client = (sender.system, sender.component, sender.channel.name)
        known, answer = self._last.get(client, (b"", b""))
        if payload == known and answer:
            self._send(sender, answer)  # the answer was lost
            return
        self._forget_idle()
        asked = _Request(sequence, session, opcode, size, offset, payload[_HEAD.size : _HEAD.size + min(size, DATA)])
        answer = self._answer(asked, sender)
        if len(self._last) > 64:
            self._last.clear()
        self._last[client] = (payload, answer)
        if answer:
            self._send(sender, answer)

    def _answer(self, asked: _Request, sender: Sender) -> bytes:
        """The payload to send back; empty when a burst answers instead."""
        try:
            if asked.size > DATA:
                raise _Refused(Error.INVALID_SIZE)
            if asked.opcode == Op.BURST:
                return self._begin_burst(asked, sender)
            handler = self._table.get(asked.opcode)
            if handler is None:
                raise _Refused(Error.UNKNOWN_COMMAND)
            data = handler(asked)
        except _Refused as refused:
            return _payload(asked.sequence + 1, asked.session, Op.NAK, asked.opcode, asked.offset, refused.data)
        session = self._opened if asked.opcode in (Op.OPEN, Op.CREATE, Op.OPEN_WRITE) else asked.session
        return _payload(asked.sequence + 1, session, Op.ACK, asked.opcode, asked.offset, data)

    def _open(self, asked: _Request) -> bytes:
        number = self._free(asked)
        content = self._files.read(asked.path)
        if content is None:
            raise _Refused(Error.NOT_FOUND)
        self._sessions[number] = _Session(content, self._flight.time_ns)
        self._opened = number
        return struct.pack("<I", len(content))

    def _open_to_write(self, asked: _Request, *, keeps: bool) -> bytes:
        """Answered with the size that the file had, as PX4 does."""
        number = self._free(asked)
        try:
            size = self._files.create(asked.path, keeps)
        except OSError as error:
            raise _refused(error) from error
        self._sessions[number] = _Session(b"", self._flight.time_ns, asked.path)
        self._opened = number
        return struct.pack("<I", size)

    def _free(self, asked: _Request) -> int:
        """The number of the session to be opened."""
        number = 0 if self._most == 1 else asked.session
        if len(self._sessions) >= self._most and (self._most == 1 or number not in self._sessions):
            raise _Refused(Error.NO_SESSIONS)
        return number

    def _write(self, asked: _Request) -> bytes:
        session = self._session(asked.session)
        if session.writes is None:
            raise _Refused(Error.ERRNO, errno.EBADF)
        try:
            return struct.pack("<I", self._files.write(session.writes, asked.offset, asked.data))
        except OSError as error:
            raise _refused(error) from error

    def _rename(self, asked: _Request) -> bytes:
        old, _, new = asked.data.partition(b"\0")
        new = new.split(b"\0", 1)[0]
        if not new:
            raise _Refused(Error.ERRNO, errno.EINVAL)
        return self._change(self._files.rename, old.decode("utf-8", "replace"), new.decode("utf-8", "replace"))

    def _change(self, change: Callable[..., None], *what: str | int) -> bytes:
        try:
            change(*what)
        except OSError as error:
            raise _refused(error) from error
        return b""

    def _read(self, asked: _Request) -> bytes:
        session = self._session(asked.session)
        if session.writes is not None:
            raise _Refused(Error.ERRNO, errno.EBADF)
        if asked.offset >= len(session.content):
            raise _Refused(Error.END_OF_FILE)
        return session.content[asked.offset : asked.offset + (asked.size or DATA)]

    def _terminate(self, asked: _Request) -> bytes:
        self._session(asked.session)
        del self._sessions[asked.session]
        self._bursts.pop(asked.session, None)
        return b""

    def _reset(self, asked: _Request) -> bytes:
        self._sessions.clear()
        self._bursts.clear()
        return b""

    def _list(self, asked: _Request) -> bytes:
        entries = self._files.entries(asked.path)
        if entries is None:
            raise _Refused(Error.NOT_FOUND)
        data = b""
        for entry in entries[asked.offset :]:
            more = entry.encode() + b"\0"
            if len(data) + len(more) > DATA:
                break
            data += more
        if not data:
            raise _Refused(Error.END_OF_FILE)
        return data

    def _checksum(self, asked: _Request) -> bytes:
        content = self._files.read(asked.path)
        if content is None:
            raise _Refused(Error.NOT_FOUND)
        return struct.pack("<I", crc32_plain(content))

    def _begin_burst(self, asked: _Request, sender: Sender) -> bytes:
        session = self._session(asked.session)
        if asked.offset >= len(session.content):
            raise _Refused(Error.END_OF_FILE)
        end = min(asked.offset + _BURST_BYTES, len(session.content))
        size = asked.size or DATA
        self._bursts[asked.session] = _Burst(sender, asked.session, asked.sequence + 1, asked.offset, end, size)
        return b""

    def _go_on(self, number: int) -> None:
        """A step's worth of a burst."""
        burst, session = self._bursts[number], self._sessions.get(number)
        for _ in range(_BURST_PER_STEP):
            if session is None or burst.at >= burst.end:
                self._bursts.pop(number, None)
                return
            data = session.content[burst.at : min(burst.at + burst.size, burst.end)]
            last = burst.at + len(data) >= burst.end
            session.used_ns = self._flight.time_ns
            self._send(burst.sender, _payload(burst.sequence, number, Op.ACK, Op.BURST, burst.at, data, last))
            burst.at += len(data)
            burst.sequence += 1

    def _session(self, number: int) -> _Session:
        session = self._sessions.get(number)
        if session is None:
            raise _Refused(Error.INVALID_SESSION)
        session.used_ns = self._flight.time_ns
        return session

    def _forget_idle(self) -> None:
        now = self._flight.time_ns
        for number, session in list(self._sessions.items()):
            if now - session.used_ns > _IDLE_NS:
                del self._sessions[number]

    def _send(self, sender: Sender, payload: bytes) -> None:
        sender.channel.tell(
            "FILE_TRANSFER_PROTOCOL",
            target_network=0,
            target_system=sender.system,
            target_component=sender.component,
            payload=payload,
        )

    _opened = 0


def _refused(error: OSError) -> _Refused:
    """What the protocol makes of a POSIX number: an error of its own where it has one."""
    number = error.errno or errno.EIO
    own = _BY_ERRNO.get(number)
    return _Refused(own) if own else _Refused(Error.ERRNO, number)


def _payload(sequence: int, session: int, opcode: Op, asked: int, offset: int, data: bytes, last: bool = False) -> bytes:
    head = _HEAD.pack(sequence & 0xFFFF, session, opcode, len(data), asked, last, 0, offset)
    return head + data + bytes(DATA - len(data))
