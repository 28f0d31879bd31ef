"""What crosses the recorder's door."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

from bench.clock import SimTime
from bench.values import value_class


@value_class(frozen=True, slots=True)
class Record:
    """One message on one topic at one simulated moment, in the very bytes of the wire.

    `type_name` is a ROS 2 type (`std_msgs/msg/String`), `data` its CDR encoding with the 4-byte header.
    Everything that was said in a session is a sequence of these, in order of time; what a recording holds is
    this sequence, so whatever is computed from records can be computed from a recording.
    """

    time: SimTime
    topic: str
    type_name: str
    data: bytes
    value: object = field(default=None, compare=False, repr=False)
    """What the bench itself made `data` of: the message, or the document in a String. Equal to what decoding `data` gives,
    so that a tap may take it in place of decoding; None where the bytes came from elsewhere, but for PX4's topics: their types
    have another layout in each release.
    """


# A function and not a class: recorder, tape builder and tests all are taps.
Tap = Callable[[Record], None]
"""Where records go; must not block and must not raise."""
