"""PX4's version, its texts, and the events that go with them."""

from __future__ import annotations

from pathlib import Path

from ..._read_table import read_table
from ..files._metadata import Metadata
from ..links._enums import MAV_AUTOPILOT
from ..policies._choices import announcements, choices
from ..policies._identity import CalibrationProtocol, IdentityPolicy
from ..state._texts import EventName
from ._parameters import PARAMETERS

# The beginning of a text, and the event that goes with it. The names imitate PX4's; the file that we serve as
# metadata explains exactly these.
EVENTS = tuple(EventName(**row) for row in read_table(Path(__file__).with_name("events.csv")))

IDENTITY = IdentityPolicy(
    **choices(IdentityPolicy, "px4"),
    name="px4",
    autopilot=MAV_AUTOPILOT.PX4,
    flight_custom_version=b"\0" * 8,
    protocol_versions=(200, 100, 203),
    texts=announcements("px4"),
    text_ending="\t",
    event_names=EVENTS,
    metadata=Metadata(PARAMETERS.definitions, EVENTS),
    folders=("log",),
    calibration=CalibrationProtocol.TEXTS,
)
