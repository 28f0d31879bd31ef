"""Network interfaces of the host."""

from __future__ import annotations

import array
import fcntl
import socket
import struct

from bench.errors import SetupError
from bench.network_namespace import outside_socket

# From <linux/sockios.h> and <linux/if.h>: the address of an interface, and a list of those that have one.
_SIOCGIFADDR, _SIOCGIFCONF = 0x8915, 0x8912
_REQUEST = struct.Struct("16sH2x4s16x")
_CONFIGURATION = struct.Struct("iP")
_NAME_BYTES, _ENTRIES = 16, 64


def interface_address(name: str, field: str) -> str:
    """The IPv4 address of an interface of the host. Raises SetupError, which names `field` and the interfaces."""
    # A socket of the host's network: the session may be in one of its own, which has a loopback alone.
    with outside_socket(socket.SOCK_DGRAM) as probe:
        request = _REQUEST.pack(name.encode()[: _NAME_BYTES - 1], socket.AF_INET, bytes(4))
        try:
            answer = fcntl.ioctl(probe, _SIOCGIFADDR, request)
        except OSError as error:
            named = ", ".join(f"{other} ({address})" for other, address in interfaces(probe).items())
            what = f"no interface {name!r} with an IPv4 address: {error.strerror}"
            raise SetupError(field, what, f"there are {named or 'none'}") from None
    return socket.inet_ntoa(answer[20:24])


def interfaces(probe: socket.socket) -> dict[str, str]:
    """Interfaces with their IPv4 addresses, on the network of this socket."""
    entries = array.array("B", bytes(_ENTRIES * _REQUEST.size))
    request = _CONFIGURATION.pack(len(entries), entries.buffer_info()[0])
    size, _ = _CONFIGURATION.unpack(fcntl.ioctl(probe, _SIOCGIFCONF, request))
    addresses = {}
    for at in range(0, size, _REQUEST.size):
        entry = entries[at : at + _REQUEST.size].tobytes()
        addresses[entry[:_NAME_BYTES].rstrip(b"\0").decode()] = socket.inet_ntoa(entry[20:24])
    return addresses
