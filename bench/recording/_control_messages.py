"""Which MAVLink messages of an agent could move the vehicle, read from their headers alone.

A list of what cannot: a message that nobody thought of counts as one that moves. Numbers are those of the
MAVLink common message set (mavlink.io/en/messages/common.html).
"""

from __future__ import annotations

from collections.abc import Iterator

_V1, _V2 = 0xFE, 0xFD
_COMMAND_INT, _COMMAND_LONG = 75, 76
# Of both messages: seven parameters of four bytes come first on the wire.
_COMMAND_AT = 28

# Heartbeats, clocks, requests to be told something, files and logs, and what a payload of camera, gimbal and
# beacons needs.
_HARMLESS_MESSAGES = frozenset(
    {
        0,  # HEARTBEAT
        2,  # SYSTEM_TIME
        4,  # PING
        20,  # PARAM_REQUEST_READ
        21,  # PARAM_REQUEST_LIST
        40,  # MISSION_REQUEST
        43,  # MISSION_REQUEST_LIST
        47,  # MISSION_ACK
        51,  # MISSION_REQUEST_INT
        66,  # REQUEST_DATA_STREAM
        77,  # COMMAND_ACK
        110,  # FILE_TRANSFER_PROTOCOL
        111,  # TIMESYNC
        117,  # LOG_REQUEST_LIST
        119,  # LOG_REQUEST_DATA
        122,  # LOG_REQUEST_END
        253,  # STATUSTEXT
        282,  # GIMBAL_MANAGER_SET_ATTITUDE
        287,  # GIMBAL_MANAGER_SET_PITCHYAW
        412,  # REQUEST_EVENT
    }
)
_HARMLESS_COMMANDS = frozenset(
    {
        205,  # DO_MOUNT_CONTROL
        206,  # DO_SET_CAM_TRIGG_DIST
        203,  # DO_DIGICAM_CONTROL
        410,  # GET_HOME_POSITION
        *range(510, 529),  # message intervals and requests
        *range(530, 535),  # camera settings
        1000,  # DO_GIMBAL_MANAGER_PITCHYAW
        1001,  # DO_GIMBAL_MANAGER_CONFIGURE
        *range(2000, 2600),  # images, video, tracking by the camera
    }
)


def moving_messages(data: bytes) -> Iterator[str]:
    """The names of the messages in `data`, whole frames one after the other, that could move the vehicle."""
    at = 0
    while at + 6 <= len(data):
        length = data[at + 1]
        if data[at] == _V2 and at + 10 <= len(data):
            # A signed frame has thirteen bytes more (incompatibility flag 1).
            head, tail = 10, 15 if data[at + 2] & 1 else 2
            message = int.from_bytes(data[at + 7 : at + 10], "little")
        elif data[at] == _V1:
            head, tail, message = 6, 2, data[at + 5]
        else:
            at += 1
            continue
        payload = data[at + head : at + head + length]
        at += head + length + tail
        if message in (_COMMAND_INT, _COMMAND_LONG):
            # MAVLink 2 leaves out zeros at the end of a payload.
            command = int.from_bytes(payload[_COMMAND_AT : _COMMAND_AT + 2], "little")
            if command not in _HARMLESS_COMMANDS:
                yield f"command {command}"
        elif message not in _HARMLESS_MESSAGES:
            yield f"message {message}"
