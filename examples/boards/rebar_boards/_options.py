"""What a SimSpec says of a board."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bench.documents import Document
from bench.simspec import DEFAULT_BAUD

_OPTIONS = "vehicle.autopilot.options"
DEVICE_FIELD, BAUD_FIELD, STREAMS_FIELD = (f"{_OPTIONS}.{name}" for name in ("device", "baud", "streams_hz"))


class BoardOptions(Document):
    """A flight controller board with PX4 in hardware-in-the-loop mode, in real time.

    TAKE THE PROPELLERS OFF. The board is restarted at the start of each session, and its parameters are put back at the
    end.
    """

    device: Annotated[
        str,
        Field(
            min_length=1,
            description="The serial device of the board, such as /dev/serial/by-id/usb-... or /dev/ttyACM0.",
        ),
    ]
    baud: int = Field(
        DEFAULT_BAUD,
        ge=9600,
        le=4_000_000,
        description="Speed of the line. A board on USB ignores it, but rates of messages are planned for it.",
    )
    parameters: dict[str, float] = Field(
        {}, description="Set at the start, behind those of the airframe and those of vehicle.parameters."
    )
    streams_hz: dict[str, Annotated[float, Field(ge=0.0, le=200.0)]] = Field(
        {},
        max_length=32,
        description="Rates of messages that the board is asked for, by MAVLink name, such as LOCAL_POSITION_NED: 10. "
        "What does not fit on the line is refused.",
    )
