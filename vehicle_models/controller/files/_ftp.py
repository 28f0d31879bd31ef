"""MAVLink FTP: requests in FILE_TRANSFER_PROTOCOL payloads, over served files and a scratch area."""

from __future__ import annotations

import errno
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..links._enums import MAV_FTP_ERR, MAV_FTP_OPCODE
from ..state._parameter_store import crc32_plain
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ._served_files import ServedFiles

# Bytes of data in one payload.
DATA = 239
# Sequence, session, opcode, size, requested opcode, burst complete, padding, offset.
_HEAD = struct.Struct("<HBBBBBBI")
# A session that is not used for so long is closed.
_IDLE_NS = 10_000_000_000
_BURST_PER_STEP = 8
# Then the client requests the next burst.
_BURST_BYTES = 35 * 1024
# Whose last answers are remembered.
_MAX_CLIENTS = 64
_OPENINGS = (MAV_FTP_OPCODE.OPENFILERO, MAV_FTP_OPCODE.CREATEFILE, MAV_FTP_OPCODE.OPENFILEWO)
_BY_ERRNO = {
    errno.EEXIST: MAV_FTP_ERR.FILEEXISTS,
    errno.ENOENT: MAV_FTP_ERR.FILENOTFOUND,
    errno.EACCES: MAV_FTP_ERR.FILEPROTECTED,
    errno.EROFS: MAV_FTP_ERR.FILEPROTECTED,
}


class _FtpRefusal(Exception):
    """Its argument is the MAV_FTP_ERR to answer. What the files refuse is an OSError."""


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
    writes: str | None = None  # the path of a file that is open for writing


@dataclass(slots=True)
class _Burst:
    sender: MessageSender
    session: int
    sequence: int
    offset: int
    end: int
    size: int


class FileTransfer:
    """Sessions, reading, bursts, listings and checksums; writing, where the files can be written.

    `max_sessions` is how many files may be open. With one, as on PX4, the vehicle numbers it (0); with
    several, as on ArduPilot, the client chooses the number.
    """

    def __init__(self, context: ServiceContext, files: ServedFiles, max_sessions: int) -> None:
        self._flight = context.flight
        self._files = files
        self._max_sessions = max_sessions
        self._sessions: dict[int, _Session] = {}
        self._bursts: dict[int, _Burst] = {}
        self._last: dict[
            tuple[int, int, str], tuple[bytes, bytes]
        ] = {}  # by client: the last request and its answer
        self._table: dict[int, Callable[[_Request], bytes]] = {
            MAV_FTP_OPCODE.NONE: lambda request: b"",
            MAV_FTP_OPCODE.TERMINATESESSION: self._terminate,
            MAV_FTP_OPCODE.RESETSESSION: self._reset,
            MAV_FTP_OPCODE.LISTDIRECTORY: self._list,
            MAV_FTP_OPCODE.OPENFILERO: self._open,
            MAV_FTP_OPCODE.READFILE: self._read,
            MAV_FTP_OPCODE.CALCFILECRC: self._checksum,
            MAV_FTP_OPCODE.CREATEFILE: lambda request: self._open_to_write(request, truncate=True),
            MAV_FTP_OPCODE.OPENFILEWO: lambda request: self._open_to_write(request, truncate=False),
            MAV_FTP_OPCODE.WRITEFILE: self._write,
            MAV_FTP_OPCODE.REMOVEFILE: lambda request: self._change(files.remove, request.path),
            MAV_FTP_OPCODE.CREATEDIRECTORY: lambda request: self._change(files.make_folder, request.path),
            MAV_FTP_OPCODE.REMOVEDIRECTORY: lambda request: self._change(files.remove_folder, request.path),
            MAV_FTP_OPCODE.TRUNCATEFILE: lambda request: self._change(
                files.truncate, request.path, request.offset
            ),
            MAV_FTP_OPCODE.RENAME: self._rename,
        }

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"FILE_TRANSFER_PROTOCOL": self._take_request}

    def tick(self) -> None:
        if self._bursts:
            for number in list(self._bursts):
                self._continue_burst(number)

    def _take_request(self, message: Any, sender: MessageSender) -> None:
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, _, offset = _HEAD.unpack_from(payload)
        client = (sender.system, sender.component, sender.channel.name)
        previous, answer = self._last.get(client, (b"", b""))
        # The client repeats its request because the answer was lost; carrying out a rename twice would fail.
        if payload == previous and answer:
            self._send(sender, answer)
            return
        self._close_idle()
        request = _Request(
            sequence, session, opcode, size, offset, payload[_HEAD.size : _HEAD.size + min(size, DATA)]
        )
        answer = self._answer(request, sender)
        # Clients may come under ever new ids; forgetting all answers costs one repetition at most.
        if len(self._last) > _MAX_CLIENTS:
            self._last.clear()
        self._last[client] = (payload, answer)
        if answer:
            self._send(sender, answer)

    def _answer(self, request: _Request, sender: MessageSender) -> bytes:
        """The payload to send back; empty where a burst answers instead."""
        session, opcode = request.session, MAV_FTP_OPCODE.ACK
        try:
            if request.size > DATA:
                raise _FtpRefusal(MAV_FTP_ERR.INVALIDDATASIZE)
            if request.opcode == MAV_FTP_OPCODE.BURSTREADFILE:
                return self._begin_burst(request, sender)
            handler = self._table.get(request.opcode)
            if handler is None:
                raise _FtpRefusal(MAV_FTP_ERR.UNKNOWNCOMMAND)
            data = handler(request)
        except (_FtpRefusal, OSError) as error:
            opcode, data = MAV_FTP_OPCODE.NAK, _reason(error)
        else:
            # The answer to an opening carries the number of the new session.
            session = self._opened if request.opcode in _OPENINGS else session
        return _payload(request.sequence + 1, session, opcode, request.opcode, request.offset, data)

    def _open(self, request: _Request) -> bytes:
        number = self._free_session(request)
        content = self._files.read(request.path)
        if content is None:
            raise _FtpRefusal(MAV_FTP_ERR.FILENOTFOUND)
        self._sessions[number] = _Session(content, self._flight.time_ns)
        self._opened = number
        return struct.pack("<I", len(content))

    def _open_to_write(self, request: _Request, *, truncate: bool) -> bytes:
        """Open a file for writing; the answer is the size that the file had, as on PX4."""
        number = self._free_session(request)
        size = self._files.create(request.path, truncate)
        self._sessions[number] = _Session(b"", self._flight.time_ns, request.path)
        self._opened = number
        return struct.pack("<I", size)

    def _free_session(self, request: _Request) -> int:
        """The number of the session to be opened."""
        number = 0 if self._max_sessions == 1 else request.session
        is_new = self._max_sessions == 1 or number not in self._sessions
        if is_new and len(self._sessions) >= self._max_sessions:
            raise _FtpRefusal(MAV_FTP_ERR.NOSESSIONSAVAILABLE)
        return number

    def _write(self, request: _Request) -> bytes:
        session = self._session(request.session)
        if session.writes is None:
            raise OSError(errno.EBADF, "not open for writing")
        return struct.pack("<I", self._files.write(session.writes, request.offset, request.data))

    def _rename(self, request: _Request) -> bytes:
        old, _, new = request.data.partition(b"\0")
        new = new.split(b"\0", 1)[0]
        if not new:
            raise OSError(errno.EINVAL, "no second path")
        return self._change(
            self._files.rename, old.decode("utf-8", "replace"), new.decode("utf-8", "replace")
        )

    def _change(self, change: Callable[..., None], *arguments: str | int) -> bytes:
        change(*arguments)
        return b""

    def _read(self, request: _Request) -> bytes:
        session = self._session(request.session)
        if session.writes is not None:
            raise OSError(errno.EBADF, "not open for reading")
        if request.offset >= len(session.content):
            raise _FtpRefusal(MAV_FTP_ERR.EOF)
        return session.content[request.offset : request.offset + (request.size or DATA)]

    def _terminate(self, request: _Request) -> bytes:
        self._session(request.session)
        del self._sessions[request.session]
        self._bursts.pop(request.session, None)
        return b""

    def _reset(self, request: _Request) -> bytes:
        self._sessions.clear()
        self._bursts.clear()
        return b""

    def _list(self, request: _Request) -> bytes:
        entries = self._files.entries(request.path)
        if entries is None:
            raise _FtpRefusal(MAV_FTP_ERR.FILENOTFOUND)
        data = b""
        for entry in entries[request.offset :]:
            encoded = entry.encode() + b"\0"
            if len(data) + len(encoded) > DATA:
                break
            data += encoded
        if not data:
            raise _FtpRefusal(MAV_FTP_ERR.EOF)
        return data

    def _checksum(self, request: _Request) -> bytes:
        content = self._files.read(request.path)
        if content is None:
            raise _FtpRefusal(MAV_FTP_ERR.FILENOTFOUND)
        return struct.pack("<I", crc32_plain(content))

    def _begin_burst(self, request: _Request, sender: MessageSender) -> bytes:
        session = self._session(request.session)
        if request.offset >= len(session.content):
            raise _FtpRefusal(MAV_FTP_ERR.EOF)
        end = min(request.offset + _BURST_BYTES, len(session.content))
        size = request.size or DATA
        self._bursts[request.session] = _Burst(
            sender, request.session, request.sequence + 1, request.offset, end, size
        )
        return b""

    def _continue_burst(self, number: int) -> None:
        """Send as much of a burst as goes out in one step."""
        burst, session = self._bursts[number], self._sessions.get(number)
        for _ in range(_BURST_PER_STEP):
            if session is None or burst.offset >= burst.end:
                self._bursts.pop(number, None)
                return
            data = session.content[burst.offset : min(burst.offset + burst.size, burst.end)]
            last = burst.offset + len(data) >= burst.end
            session.used_ns = self._flight.time_ns
            self._send(
                burst.sender,
                _payload(
                    burst.sequence,
                    number,
                    MAV_FTP_OPCODE.ACK,
                    MAV_FTP_OPCODE.BURSTREADFILE,
                    burst.offset,
                    data,
                    last,
                ),
            )
            burst.offset += len(data)
            burst.sequence += 1

    def _session(self, number: int) -> _Session:
        session = self._sessions.get(number)
        if session is None:
            raise _FtpRefusal(MAV_FTP_ERR.INVALIDSESSION)
        session.used_ns = self._flight.time_ns
        return session

    def _close_idle(self) -> None:
        now = self._flight.time_ns
        for number, session in list(self._sessions.items()):
            if now - session.used_ns > _IDLE_NS:
                del self._sessions[number]

    def _send(self, sender: MessageSender, payload: bytes) -> None:
        sender.answer("FILE_TRANSFER_PROTOCOL", target_network=0, payload=payload)

    _opened = 0


def _reason(error: Exception) -> bytes:
    """The protocol's error; for a POSIX number one of its own where it has one, else the number behind FAILERRNO."""
    if not isinstance(error, OSError):
        return bytes(error.args)
    number = error.errno or errno.EIO
    own = _BY_ERRNO.get(number)
    return bytes([own]) if own else bytes([MAV_FTP_ERR.FAILERRNO, number & 0xFF])


def _payload(
    sequence: int, session: int, opcode: int, requested: int, offset: int, data: bytes, last: bool = False
) -> bytes:
    head = _HEAD.pack(sequence & 0xFFFF, session, opcode, len(data), requested, last, 0, offset)
    return head + data + bytes(DATA - len(data))
