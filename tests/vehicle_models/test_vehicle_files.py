"""A client's own files over MAVLink FTP, refused with the numbers that a real file system gives."""

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

from vehicle_models.controller.files._served_files import ServedFiles
from vehicle_models.controller.links._enums import MAV_FTP_ERR, MAV_FTP_OPCODE

_HEAD = struct.Struct("<HBBBBBBI")
NAMES = ("a", "b", "d", "d/a", "d/e", "d/e/a", "a/b")


class Ftp:
    """A client of the file transfer: one request, its one answer."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._sequence = 0

    def ask(
        self, opcode: int, data: bytes = b"", offset: int = 0, size: int | None = None
    ) -> tuple[int, bytes]:
        ((reply, _, answer),) = self.answers(opcode, data, offset, size)
        return reply, answer

    def answers(
        self, opcode: int, data: bytes, offset: int = 0, size: int | None = None
    ) -> list[tuple[int, int, bytes]]:
        """Reply, whether a burst ends with it, and data of the answers to one request, until the end of a burst."""
        self._sequence += 2
        head = _HEAD.pack(
            self._sequence & 0xFFFF, 0, opcode, len(data) if size is None else size, 0, 0, 0, offset
        )
        payload = head + data + bytes(239 - len(data))
        self._client.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        answers: list[tuple[int, int, bytes]] = []
        while not answers or (opcode == MAV_FTP_OPCODE.BURSTREADFILE and not answers[-1][1]):
            for answer in of("FILE_TRANSFER_PROTOCOL", self._client.fly(0.04)):
                raw = bytes(answer.payload)
                sequence, _, reply, length, requested, end, _, _ = _HEAD.unpack_from(raw)
                assert (sequence, requested) == ((self._sequence + 1 + len(answers)) & 0xFFFF, opcode)
                answers.append((reply, end, raw[12 : 12 + length]))
        self._sequence += len(answers) - 1
        return answers

    def done(self, opcode: int, data: bytes = b"", offset: int = 0, size: int | None = None) -> bytes:
        reply, answer = self.ask(opcode, data, offset, size)
        assert reply == MAV_FTP_OPCODE.ACK, answer
        return answer

    def refused(self, opcode: int, data: bytes = b"", offset: int = 0) -> bytes:
        reply, answer = self.ask(opcode, data, offset)
        assert reply == MAV_FTP_OPCODE.NAK
        return answer

    def fetch(self, path: str) -> bytes:
        """A whole file by open, read, terminate."""
        (size,) = struct.unpack("<I", self.done(MAV_FTP_OPCODE.OPENFILERO, path.encode()))
        data = b""
        while len(data) < size:
            data += self.done(MAV_FTP_OPCODE.READFILE, offset=len(data), size=239)
        assert self.refused(MAV_FTP_OPCODE.READFILE, offset=len(data)) == bytes([MAV_FTP_ERR.EOF])
        self.done(MAV_FTP_OPCODE.TERMINATESESSION)
        return data


def plain_crc(data: bytes) -> int:
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def test_a_client_keeps_a_file_of_its_own(make: Make) -> None:
    """Created, written in pieces, read back, checked, listed, cut, renamed into a folder, removed."""
    ftp = Ftp(make())
    content = random.Random(3).randbytes(600)
    ftp.done(MAV_FTP_OPCODE.CREATEDIRECTORY, b"plans")
    assert ftp.done(MAV_FTP_OPCODE.CREATEFILE, b"plans/one.bin") == struct.pack("<I", 0)
    for at in range(0, len(content), 200):
        assert ftp.done(MAV_FTP_OPCODE.WRITEFILE, content[at : at + 200], offset=at) == struct.pack("<I", 200)
    assert ftp.refused(MAV_FTP_OPCODE.READFILE) == bytes([MAV_FTP_ERR.FAILERRNO, errno.EBADF])
    ftp.done(MAV_FTP_OPCODE.TERMINATESESSION)
    assert ftp.done(MAV_FTP_OPCODE.LISTDIRECTORY, b"plans") == b"Fone.bin\t600\0"
    assert b"Dplans\0" in ftp.done(MAV_FTP_OPCODE.LISTDIRECTORY, b"/")
    checksum = ftp.done(MAV_FTP_OPCODE.CALCFILECRC, b"plans/one.bin")
    assert checksum == struct.pack("<I", plain_crc(content))
    assert ftp.done(MAV_FTP_OPCODE.OPENFILERO, b"plans/one.bin") == struct.pack("<I", 600)
    assert b"".join(ftp.done(MAV_FTP_OPCODE.READFILE, offset=at) for at in (0, 239, 478)) == content
    assert ftp.refused(MAV_FTP_OPCODE.WRITEFILE, b"x") == bytes([MAV_FTP_ERR.FAILERRNO, errno.EBADF])
    ftp.done(MAV_FTP_OPCODE.TERMINATESESSION)
    assert ftp.done(MAV_FTP_OPCODE.OPENFILEWO, b"plans/one.bin") == struct.pack("<I", 600)
    ftp.done(MAV_FTP_OPCODE.WRITEFILE, b"new", offset=1)
    ftp.done(MAV_FTP_OPCODE.TERMINATESESSION)
    ftp.done(MAV_FTP_OPCODE.TRUNCATEFILE, b"plans/one.bin", offset=5)
    ftp.done(MAV_FTP_OPCODE.RENAME, b"plans/one.bin\0two.bin")
    ftp.done(MAV_FTP_OPCODE.OPENFILERO, b"two.bin")
    assert ftp.done(MAV_FTP_OPCODE.READFILE) == content[:1] + b"new" + content[4:5]
    ftp.done(MAV_FTP_OPCODE.RESETSESSION)
    ftp.done(MAV_FTP_OPCODE.REMOVEDIRECTORY, b"plans")
    ftp.done(MAV_FTP_OPCODE.REMOVEFILE, b"two.bin")
    assert ftp.refused(MAV_FTP_OPCODE.OPENFILERO, b"two.bin") == bytes([MAV_FTP_ERR.FILENOTFOUND])


def test_what_cannot_be_written_is_refused(make: Make) -> None:
    """With an error of the protocol where it has one, else with the number of the system."""
    ftp = Ftp(make())
    ftp.done(MAV_FTP_OPCODE.CREATEDIRECTORY, b"kept")
    for opcode, path in (
        (MAV_FTP_OPCODE.CREATEFILE, b"etc/extras/all_events.json.xz"),
        (MAV_FTP_OPCODE.OPENFILEWO, b"etc"),
        (MAV_FTP_OPCODE.TRUNCATEFILE, b"etc/extras/parameters.json.xz"),
        (MAV_FTP_OPCODE.RENAME, b"etc\0mine"),
        (MAV_FTP_OPCODE.CREATEFILE, b"../outside"),
    ):
        assert ftp.refused(opcode, path) == bytes([MAV_FTP_ERR.FILEPROTECTED]), path
    for opcode, path, error in (
        (MAV_FTP_OPCODE.CREATEDIRECTORY, b"kept", MAV_FTP_ERR.FILEEXISTS),
        (MAV_FTP_OPCODE.CREATEFILE, b"nowhere/file", MAV_FTP_ERR.FILENOTFOUND),
        (MAV_FTP_OPCODE.REMOVEFILE, b"nothing", MAV_FTP_ERR.FILENOTFOUND),
        (MAV_FTP_OPCODE.WRITEFILE, b"x", MAV_FTP_ERR.INVALIDSESSION),
    ):
        assert ftp.refused(opcode, path) == bytes([error]), path
    ftp.done(MAV_FTP_OPCODE.CREATEFILE, b"kept/big")
    for opcode, data, offset, number in (
        (MAV_FTP_OPCODE.RENAME, b"kept", 0, errno.EINVAL),
        (MAV_FTP_OPCODE.WRITEFILE, b"x", 2**32 - 2, errno.ENOSPC),
        (MAV_FTP_OPCODE.REMOVEDIRECTORY, b"kept", 0, errno.ENOTEMPTY),
    ):
        assert ftp.refused(opcode, data, offset) == bytes([MAV_FTP_ERR.FAILERRNO, number]), data


def test_ardupilot_takes_no_files(make: Make) -> None:
    ftp = Ftp(make(simspec("ardupilot")))
    for opcode in (
        MAV_FTP_OPCODE.CREATEFILE,
        MAV_FTP_OPCODE.OPENFILEWO,
        MAV_FTP_OPCODE.REMOVEFILE,
        MAV_FTP_OPCODE.CREATEDIRECTORY,
        MAV_FTP_OPCODE.REMOVEDIRECTORY,
        MAV_FTP_OPCODE.TRUNCATEFILE,
    ):
        assert ftp.refused(opcode, b"mine") == bytes([MAV_FTP_ERR.FILEPROTECTED])


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


def cut_file(path: Path, keep: bool) -> int:
    size = path.stat().st_size if path.is_file() else 0
    os.close(os.open(path, os.O_CREAT | os.O_WRONLY | (0 if keep else os.O_TRUNC)))
    return size


def overwrite(path: Path, number: int) -> int:
    handle = os.open(path, os.O_WRONLY)
    try:
        return os.pwrite(handle, b"data", number)
    finally:
        os.close(handle)


# Each change of the served files, and the same on the file system of this machine.
CHANGES: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "create": (lambda files, name, *_: files.create(name), lambda path, *_: cut_file(path, keep=False)),
    "keep": (
        lambda files, name, *_: files.create(name, truncate=False),
        lambda path, *_: cut_file(path, keep=True),
    ),
    "write": (
        lambda files, name, _, number: files.write(name, number, b"data"),
        lambda path, _, number: overwrite(path, number),
    ),
    "truncate": (
        lambda files, name, _, number: files.truncate(name, number),
        lambda path, _, number: os.truncate(path, number),
    ),
    "remove": (lambda files, name, *_: files.remove(name), lambda path, *_: os.unlink(path)),
    "rename": (
        lambda files, name, other, _: files.rename(name, other),
        lambda path, other, _: os.rename(path, other),
    ),
    "make": (lambda files, name, *_: files.make_folder(name), lambda path, *_: os.mkdir(path)),
    "unmake": (lambda files, name, *_: files.remove_folder(name), lambda path, *_: os.rmdir(path)),
}


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
        action = draw.choice((*CHANGES, "write", "make"))
        ours, real = CHANGES[action]
        name, other, number = draw.choice(NAMES), draw.choice(NAMES), draw.randrange(12)
        here = outcome(ours, files, name, other, number)
        assert here == outcome(real, tmp_path / name, tmp_path / other, number), (action, name, other, number)
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
