"""Names on the wire: keys, liveliness tokens, QoS strings, endpoint ids and attachments, as rmw_zenoh has
them.

A ROS 2 graph over Zenoh is nothing but these texts: data flows on a *data key*, and the *tokens* make nodes
and endpoints visible to whoever looks for them (`ros2 topic list`, nodes that wait for a match).
"""

from __future__ import annotations

import re
import struct
from typing import Any

import xxhash

from bench.values import value_class

from ._schemas import type_hash
from ._types import type_name_of

GRAPH = "@ros2_lv"
# The default depth of rmw_zenoh. In a token, a value equal to its default is left out.
_DEFAULT_DEPTH = 42
_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_-]*)+")
# Sequence number, time in ns, length of the id, id: the layout since Jazzy 0.2.4 and Humble 0.1.2.
_ATTACHMENT = struct.Struct("<qqB16s")
_GID_BYTES = 16


@value_class(frozen=True, slots=True)
class QoS:
    """What an endpoint says of itself. Over Zenoh it is advertised and never negotiated: anybody hears
    anybody.

    `latched` is transient_local: who subscribes late still gets the last `depth` samples.
    """

    reliable: bool = True
    latched: bool = False
    depth: int = 10

    @property
    def text(self) -> str:
        reliability = "" if self.reliable else "2"
        durability = "1" if self.latched else ""
        depth = "" if self.depth == _DEFAULT_DEPTH else str(self.depth)
        return f"{reliability}:{durability}:,{depth}:,:,:,,"


# The profiles that ROS 2 uses for these topics by default.
RELIABLE_10 = QoS()
SENSOR_DATA = QoS(reliable=False, depth=5)
CLOCK_QOS = QoS(reliable=False, depth=1)
TF_QOS = QoS(depth=100)


def is_name(name: str) -> bool:
    """Whether this is a fully qualified name (`/drone_1/detections`); no other text ever becomes part of a
    key.

    Hyphens pass, as in the SimSpec's identifiers, though ROS 2 itself has none in names: its nodes cannot ask
    for such a topic.
    """
    return _NAME.fullmatch(name) is not None


def dds_name(kind: str | type[Any]) -> str:
    """`std_msgs/msg/String` as keys write it: `std_msgs::msg::dds_::String_`."""
    package, part, name = (kind if isinstance(kind, str) else type_name_of(kind)).split("/")
    return f"{package}::{part}::dds_::{name}_"


def mangle(name: str) -> str:
    """A name as tokens write it, every slash a percent sign."""
    return name.replace("/", "%")


def data_key(domain: int, topic: str, kind: str | type[Any]) -> str:
    """Where the samples of a topic travel; `kind` is a message class or the name of its type. KeyError for a type that the
    bench does not speak.
    """
    return f"{domain}/{topic.strip('/')}/{dds_name(kind)}/{type_hash(kind)}"


def node_token(domain: int, zid: str, node_id: int, namespace: str, name: str) -> str:
    """The token that shows a node."""
    return f"{GRAPH}/{domain}/{zid}/{node_id}/{node_id}/NN/%/{mangle(namespace)}/{name}"


def endpoint_token(
    domain: int,
    zid: str,
    ids: tuple[int, int],
    kind: str,
    node: tuple[str, str],
    topic: str,
    message: str | type[Any],
    qos: QoS,
) -> str:
    """The token that shows an endpoint. `ids` are the node's and its own; `kind` MP publishes, MS subscribes, SS answers
    a service; `node` is its namespace and name.
    """
    node_id, own_id = ids
    namespace, name = node
    place = f"{GRAPH}/{domain}/{zid}/{node_id}/{own_id}/{kind}/%/{mangle(namespace)}/{name}"
    return f"{place}/{mangle(topic)}/{dds_name(message)}/{type_hash(message)}/{qos.text}"


def endpoint_gid(token: str) -> bytes:
    """The 16 bytes that identify a publisher: XXH3-128 of its token, low half first, each half little
    endian.
    """
    # The digest is big endian with the high half first, so one reversal puts everything right.
    return xxhash.xxh3_128_digest(token.encode())[::-1]


def write_attachment(sequence: int, source_ns: int, gid: bytes) -> bytes:
    """The 33 bytes beside every sample. `source_ns` is wall clock since 1970 by the contract."""
    return _ATTACHMENT.pack(sequence, source_ns, _GID_BYTES, gid)


def read_sequence(attachment: bytes) -> int | None:
    """The sequence number in an attachment, from 0 or from 1 by its publisher; None when it is not one."""
    if len(attachment) != _ATTACHMENT.size:
        return None
    sequence: int
    sequence, _, length, _ = _ATTACHMENT.unpack(attachment)
    # rmw_zenoh counts from 1, and independent ROS 2 clients from 0.
    return sequence if sequence >= 0 and length == _GID_BYTES else None


def answer_attachment(attachment: bytes, source_ns: int) -> bytes:
    """The attachment of a service's answer to a request: the request's number and id, and a time of its own."""
    sequence, _, length, gid = _ATTACHMENT.unpack(attachment)
    return _ATTACHMENT.pack(sequence, source_ns, length, gid)
