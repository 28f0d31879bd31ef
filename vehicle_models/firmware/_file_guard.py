"""Keeps agents from changing files of a real autopilot by MAVLink FTP, and answers them in its place.

By such a file an agent could set any parameter (ArduPilot: @PARAM/param.pck; PX4: the file of its parameters) or put a start
script in place. A session to write begins with one of the opcodes here.
"""

from __future__ import annotations

import struct

from ..controller.files._ftp import FtpOpcode
from ..controller.links._frames import Packer, payload_of, sender

FILE_TRANSFER_PROTOCOL = 110
# In the payload, behind network, system and component.
_TRANSFER_AT = 3
# MAVLink FTP: sequence, session, opcode, size, requested opcode, burst complete, padding, offset; then data.
_TRANSFER = struct.Struct("<HBBBBBBI")
_TRANSFER_BYTES = 251
_UPLOADS = frozenset({FtpOpcode.CREATE, FtpOpcode.OPEN_WRITE, FtpOpcode.TRUNCATE})
_CHANGES = _UPLOADS | {FtpOpcode.REMOVE, FtpOpcode.MAKE_FOLDER, FtpOpcode.REMOVE_FOLDER, FtpOpcode.RENAME}
# Plans are uploaded to virtual files of ArduPilot. Renaming is no upload: its second path may lead anywhere.
_PLANS = (b"@MISSION/", b"@FENCE/", b"@RALLY/")
_FILE_PROTECTED = 9
_AUTOPILOT_COMPONENT = 1


def file_refusal(frame: bytes) -> bytes | None:
    """The autopilot's refusal of a FILE_TRANSFER_PROTOCOL that changes anything but plans; None for any other.

    Without an answer a client would ask again and again.
    """
    payload = payload_of(frame, _TRANSFER_AT + _TRANSFER_BYTES)
    sequence, session, opcode, size, *_ = _TRANSFER.unpack_from(payload, _TRANSFER_AT)
    data_at = _TRANSFER_AT + _TRANSFER.size
    is_plan = payload[data_at : data_at + size].startswith(_PLANS)
    if opcode not in _CHANGES or (is_plan and opcode in _UPLOADS):
        return None
    refusal = _TRANSFER.pack((sequence + 1) & 0xFFFF, session, FtpOpcode.NAK, 1, opcode, 0, 0, 0)
    content = (refusal + bytes([_FILE_PROTECTED])).ljust(_TRANSFER_BYTES, b"\0")
    system, component = sender(frame)
    # The autopilot that was asked: its system stands behind the network in the payload.
    packer = Packer(payload[1] or 1, _AUTOPILOT_COMPONENT)
    return packer.pack(FILE_TRANSFER_PROTOCOL, 0, (0, system, component, *content))
