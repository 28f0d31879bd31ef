"""A client's own files: written over MAVLink FTP, kept in memory, refused with the numbers that a real file
system gives.
"""

from __future__ import annotations

import errno
import os
import random
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from vehicle_client import Client, Make, mavlink, of, simspec

from vehicle_models.controller.files._ftp import FtpError, FtpOpcode
from vehicle_models.controller.files._served_files import ServedFiles

_HEAD = struct.Struct("<HBBBBBBI")
NAMES = ("a", "b", "d", "d/a", "d/e", "d/e/a", "a/b")


class Ftp:
    """A client of the file transfer: one request, its one answer."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._sequence = 0

    def ask(self, opcode: int, data: bytes = b"", offset: int = 0, session: int = 0) -> tuple[int, bytes]:
        self._sequence += 2
        head = _HEAD.pack(self._sequence & 0xFFFF, session, opcode, len(data), 0, 0, 0, offset)
        payload = head + data + bytes(239 - len(data))
        self._client.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        (answer,) = of("FILE_TRANSFER_PROTOCOL", self._client.fly(0.04))
        raw = bytes(answer.payload)
        sequence, _, reply, size, requested, _, _, _ = _HEAD.unpack_from(raw)
        assert (sequence, requested) == ((self._sequence + 1) & 0xFFFF, opcode)
        return reply, raw[12 : 12 + size]

    def done(self, opcode: int, data: bytes = b"", offset: int = 0) -> bytes:
        reply, answer = self.ask(opcode, data, offset)
        assert reply == FtpOpcode.ACK, answer
        return answer

    def refused(self, opcode: int, data: bytes = b"", offset: int = 0) -> bytes:
        reply, answer = self.ask(opcode, data, offset)
        assert reply == FtpOpcode.NAK
        return answer


def test_a_client_keeps_a_file_of_its_own(make: Make) -> None:
    """Created, written in pieces, read back, checked, listed, cut, renamed into a folder, removed."""
    ftp = Ftp(make())
    content = random.Random(3).randbytes(600)
    ftp.done(FtpOpcode.MAKE_FOLDER, b"plans")
    assert ftp.done(FtpOpcode.CREATE, b"plans/one.bin") == struct.pack("<I", 0)
    for at in range(0, len(content), 200):
        assert ftp.done(FtpOpcode.WRITE, content[at : at + 200], offset=at) == struct.pack("<I", 200)
    assert ftp.refused(FtpOpcode.READ) == bytes([FtpError.ERRNO, errno.EBADF])
    ftp.done(FtpOpcode.TERMINATE)
    assert ftp.done(FtpOpcode.LIST, b"plans") == b"Fone.bin\t600\0"
    assert b"Dplans\0" in ftp.done(FtpOpcode.LIST, b"/")
    assert (
        struct.unpack("<I", ftp.done(FtpOpcode.CRC32, b"plans/one.bin"))[0]
        == zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF
    )
    assert ftp.done(FtpOpcode.OPEN, b"plans/one.bin") == struct.pack("<I", 600)
    assert b"".join(ftp.done(FtpOpcode.READ, offset=at) for at in (0, 239, 478)) == content
    assert ftp.refused(FtpOpcode.WRITE, b"x") == bytes([FtpError.ERRNO, errno.EBADF])
    ftp.done(FtpOpcode.TERMINATE)
    assert ftp.done(FtpOpcode.OPEN_WRITE, b"plans/one.bin") == struct.pack("<I", 600)
    ftp.done(FtpOpcode.WRITE, b"new", offset=1)
    ftp.done(FtpOpcode.TERMINATE)
    ftp.done(FtpOpcode.TRUNCATE, b"plans/one.bin", offset=5)
    ftp.done(FtpOpcode.RENAME, b"plans/one.bin\0two.bin")
    ftp.done(FtpOpcode.OPEN, b"two.bin")
    assert ftp.done(FtpOpcode.READ) == content[:1] + b"new" + content[4:5]
    ftp.done(FtpOpcode.RESET)
    ftp.done(FtpOpcode.REMOVE_FOLDER, b"plans")
    ftp.done(FtpOpcode.REMOVE, b"two.bin")
    assert ftp.refused(FtpOpcode.OPEN, b"two.bin") == bytes([FtpError.NOT_FOUND])


def test_what_cannot_be_written_is_refused(make: Make) -> None:
    """With an error of the protocol where it has one, else with the number of the system; nothing of it
    changes a file.
    """
    ftp = Ftp(make())
    ftp.done(FtpOpcode.MAKE_FOLDER, b"kept")
    for opcode, path in (
        (FtpOpcode.CREATE, b"etc/extras/all_events.json.xz"),
        (FtpOpcode.OPEN_WRITE, b"etc"),
        (FtpOpcode.TRUNCATE, b"etc/extras/parameters.json.xz"),
        (FtpOpcode.RENAME, b"etc\0mine"),
        (FtpOpcode.CREATE, b"../outside"),
    ):
        assert ftp.refused(opcode, path) == bytes([FtpError.PROTECTED]), path
    assert ftp.refused(FtpOpcode.MAKE_FOLDER, b"kept") == bytes([FtpError.EXISTS])
    assert ftp.refused(FtpOpcode.CREATE, b"nowhere/file") == bytes([FtpError.NOT_FOUND])
    assert ftp.refused(FtpOpcode.REMOVE, b"nothing") == bytes([FtpError.NOT_FOUND])
    assert ftp.refused(FtpOpcode.RENAME, b"kept") == bytes([FtpError.ERRNO, errno.EINVAL])
    assert ftp.refused(FtpOpcode.WRITE, b"x") == bytes([FtpError.INVALID_SESSION])
    ftp.done(FtpOpcode.CREATE, b"kept/big")
    assert ftp.refused(FtpOpcode.WRITE, b"x", offset=2**32 - 2) == bytes([FtpError.ERRNO, errno.ENOSPC])
    assert ftp.refused(FtpOpcode.REMOVE_FOLDER, b"kept") == bytes([FtpError.ERRNO, errno.ENOTEMPTY])


def test_ardupilot_takes_no_files(make: Make) -> None:
    ftp = Ftp(make(simspec("ardupilot")))
    for opcode in (
        FtpOpcode.CREATE,
        FtpOpcode.OPEN_WRITE,
        FtpOpcode.REMOVE,
        FtpOpcode.MAKE_FOLDER,
        FtpOpcode.REMOVE_FOLDER,
        FtpOpcode.TRUNCATE,
    ):
        assert ftp.refused(opcode, b"mine") == bytes([FtpError.PROTECTED])


def test_the_scratch_area_has_an_end() -> None:
    """A megabyte and 256 names at most; removing a file makes room."""
    files = ServedFiles({}, writable=True)
    files.create("big")
    files.truncate("big", 1 << 20)
    assert outcome(files.write, "big", 1 << 20, b"x") == "ENOSPC"
    assert outcome(files.truncate, "big", (1 << 20) + 1) == "ENOSPC"
    files.remove("big")
    for number in range(256):
        files.create(f"file{number}")
    assert outcome(files.make_folder, "one more") == "ENOSPC"


def real(root: Path, action: str, name: str, other: str, number: int) -> Any:
    """The same on the file system of this machine."""
    path = root / name
    match action:
        case "create" | "keep":
            size = path.stat().st_size if path.is_file() else 0
            os.close(os.open(path, os.O_CREAT | os.O_WRONLY | (os.O_TRUNC if action == "create" else 0)))
            return size
        case "write":
            handle = os.open(path, os.O_WRONLY)
            try:
                return os.pwrite(handle, b"data", number)
            finally:
                os.close(handle)
        case "truncate":
            return os.truncate(path, number)
        case "remove":
            return os.unlink(path)
        case "rename":
            return os.rename(path, root / other)
        case "make":
            return os.mkdir(path)
        case _:
            return os.rmdir(path)


def ours(files: ServedFiles, action: str, name: str, other: str, number: int) -> Any:
    match action:
        case "create" | "keep":
            return files.create(name, truncate=action == "create")
        case "write":
            return files.write(name, number, b"data")
        case "truncate":
            return files.truncate(name, number)
        case "remove":
            return files.remove(name)
        case "rename":
            return files.rename(name, other)
        case "make":
            return files.make_folder(name)
        case _:
            return files.remove_folder(name)


def outcome(change: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return change(*arguments)
    except OSError as error:
        return errno.errorcode[error.errno or 0]


@pytest.mark.parametrize("seed", range(40))
def test_files_behave_as_those_of_a_file_system(tmp_path: Path, seed: int) -> None:
    """Sixty random changes each: the same results, the same refusals, the same files in the end."""
    draw, files = random.Random(seed), ServedFiles({}, writable=True)
    for _ in range(60):
        action = draw.choice(
            ("create", "keep", "write", "write", "truncate", "remove", "rename", "make", "make", "unmake")
        )
        step = (action, draw.choice(NAMES), draw.choice(NAMES), draw.randrange(12))
        assert outcome(ours, files, *step) == outcome(real, tmp_path, *step), step
    for name in NAMES:
        path = tmp_path / name
        try:
            content = path.read_bytes() if path.is_file() else None
        except NotADirectoryError:
            content = None
        assert files.read(name) == content
        listed = sorted(entry.name for entry in path.iterdir()) if path.is_dir() else None
        entries = files.entries(name)
        assert (None if entries is None else [entry[1:].split("\t")[0] for entry in entries]) == listed
    shutil.rmtree(tmp_path)
