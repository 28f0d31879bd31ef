"""Keeps agents from changing files of a real autopilot by MAVLink FTP, and from reading the host's, and answers them in its
place.

By a file of its own an agent could set any parameter (ArduPilot: @PARAM/param.pck; PX4: the file of its parameters) or put a
start script in place. A session to write begins with one of the opcodes here. And the program of an autopilot on this machine
can read what the user of the bench can, the truth of the session for example.
"""

from __future__ import annotations

import os
import struct

from ..controller.links._enums import MAV_FTP_ERR, MAV_FTP_OPCODE
from ..controller.links._frames import Packer, payload_of, sender

FILE_TRANSFER_PROTOCOL = 110
# In the payload, behind network, system and component.
_TRANSFER_AT = 3
# MAVLink FTP: sequence, session, opcode, size, requested opcode, burst complete, padding, offset; then data.
_TRANSFER = struct.Struct("<HBBBBBBI")
_TRANSFER_BYTES = 251
_UPLOADS = frozenset({MAV_FTP_OPCODE.CREATEFILE, MAV_FTP_OPCODE.OPENFILEWO, MAV_FTP_OPCODE.TRUNCATEFILE})
_READS = frozenset({MAV_FTP_OPCODE.LISTDIRECTORY, MAV_FTP_OPCODE.OPENFILERO, MAV_FTP_OPCODE.CALCFILECRC})
_CHANGES = _UPLOADS | {
    MAV_FTP_OPCODE.REMOVEFILE,
    MAV_FTP_OPCODE.CREATEDIRECTORY,
    MAV_FTP_OPCODE.REMOVEDIRECTORY,
    MAV_FTP_OPCODE.RENAME,
}
# Plans are uploaded to virtual files of ArduPilot. Renaming is no upload: its second path may lead anywhere.
_PLANS = (b"@MISSION/", b"@FENCE/", b"@RALLY/")
_AUTOPILOT_COMPONENT = 1


def host_refusal(frame: bytes) -> bytes | None:
    """The autopilot's refusal of a FILE_TRANSFER_PROTOCOL that would read outside its folder; None for any other.

    An absolute path is refused only where the host has such a file. PX4 puts its working folder before it (observed);
    whether every ArduPilot does is not known, and need not be.
    """
    opcode, paths = _request(frame)
    return _refusal(frame) if opcode in _READS and any(map(_leads_outside, paths)) else None


def _leads_outside(path: bytes) -> bool:
    is_of_host = path.startswith(b"/") and path.strip(b"/") != b"" and os.path.lexists(path)
    return b".." in path.split(b"/") or is_of_host


def file_refusal(frame: bytes) -> bytes | None:
    """The refusal of a FILE_TRANSFER_PROTOCOL that changes anything but plans; None for any other."""
    opcode, paths = _request(frame)
    is_plan = all(path.startswith(_PLANS) for path in paths)
    return None if opcode not in _CHANGES or (is_plan and opcode in _UPLOADS) else _refusal(frame)


def _request(frame: bytes) -> tuple[int, tuple[bytes, bytes]]:
    """Opcode, and the path that follows (of RENAME the first of two) as PX4 reads it and as ArduPilot does: by its stated
    size, or up to a zero wherever that is.
    """
    payload = payload_of(frame, _TRANSFER_AT + _TRANSFER_BYTES)
    _, _, opcode, size, *_ = _TRANSFER.unpack_from(payload, _TRANSFER_AT)
    data = payload[_TRANSFER_AT + _TRANSFER.size :]
    return opcode, (data[:size].split(b"\0")[0], data.split(b"\0")[0])


def _refusal(frame: bytes) -> bytes:
    payload = payload_of(frame, _TRANSFER_AT + _TRANSFER_BYTES)
    sequence, session, opcode, *_ = _TRANSFER.unpack_from(payload, _TRANSFER_AT)
    refusal = _TRANSFER.pack((sequence + 1) & 0xFFFF, session, MAV_FTP_OPCODE.NAK, 1, opcode, 0, 0, 0)
    content = (refusal + bytes([MAV_FTP_ERR.FILEPROTECTED])).ljust(_TRANSFER_BYTES, b"\0")
    system, component = sender(frame)
    # The autopilot that was asked: its system stands behind the network in the payload.
    packer = Packer(payload[1] or 1, _AUTOPILOT_COMPONENT)
    return packer.pack(FILE_TRANSFER_PROTOCOL, 0, (0, system, component, *content))
