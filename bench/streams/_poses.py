"""geometry_msgs/PoseArray straight from and to arrays: the stream of actors, which is long and frequent.

NumPy is imported where it is used: an agent never meets this stream, and its client starts in half the time
without.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from ._cdr import HEADER, encode
from ._types import Header, Time

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_POSE = "<f8"
# Position x y z, quaternion x y z w.
_WIDTH = 7


def encode_pose_array(
    stamp: Time,
    frame_id: str,
    positions_m: NDArray[np.float64],
    quaternions: NDArray[np.float64] | None = None,
) -> bytes:
    """The CDR bytes of a PoseArray of (n, 3) positions in metres and (n, 4) unit quaternions x y z w
    (identity when None).

    The same bytes as `encode` gives for the same poses. Raises ValueError when the shapes do not fit.
    """
    import numpy as np

    count = len(positions_m)
    head = encode(Header(stamp, frame_id))
    head += bytes(-len(head) % 4) + struct.pack("<I", count)
    if not count:
        return head
    poses = np.empty((count, _WIDTH), dtype=_POSE)
    poses[:, :3] = positions_m
    poses[:, 3:] = (0.0, 0.0, 0.0, 1.0) if quaternions is None else quaternions
    # The first double is aligned to 8, counted from after the header; poses then follow without gaps.
    return head + bytes((len(HEADER) - len(head)) % 8) + poses.tobytes()


def decode_pose_array(data: bytes) -> tuple[int, NDArray[np.float64], NDArray[np.float64]] | None:
    """Stamp in ns, (n, 3) positions and (n, 4) quaternions of a PoseArray's CDR bytes; None when they are not
    one.

    Takes little-endian bytes alone, which is what every known writer sends. The arrays are read-only views of
    `data`.
    """
    import numpy as np

    if len(data) < 16 or data[:2] != HEADER[:2]:
        return None
    sec, nanosec, length = struct.unpack_from("<iII", data, 4)
    at = 16 + length
    at += -at % 4
    if at + 4 > len(data) or (length and data[16 + length - 1]):
        return None
    (count,) = struct.unpack_from("<I", data, at)
    at += 4
    if count:
        at += (len(HEADER) - at) % 8
    # Up to three bytes of padding may follow, as in `_cdr`.
    if not 0 <= len(data) - at - count * _WIDTH * 8 <= 3:
        return None
    poses = np.frombuffer(data, dtype=_POSE, count=count * _WIDTH, offset=at).reshape(count, _WIDTH)
    return sec * 1_000_000_000 + nanosec, poses[:, :3], poses[:, 3:]
