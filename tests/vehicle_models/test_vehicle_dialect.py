"""The dialect has the messages that pymavlink lacks, packed as specified, and leaves pymavlink unchanged."""

from __future__ import annotations

import re
from pathlib import Path

from pymavlink.dialects.v20 import all as plain

import vehicle_models
from vehicle_models.controller.links import _enums
from vehicle_models.controller.links._dialect import dialect

# CRC_EXTRA of the specification, as its C headers have them.
KNOWN = {8: 117, 80: 14, 300: 217, 380: 232, 395: 0, 397: 182, 410: 160, 411: 106, 412: 33, 413: 77}


def test_added_messages_have_the_checksums_of_the_specification() -> None:
    """CRC_EXTRA covers names, types, order and lengths of fields: equal figures, equal definitions."""
    assert {number: dialect.mavlink_map[number].crc_extra for number in KNOWN} == KNOWN
    for number in (42, 44, 47, 111):
        extended, known = dialect.mavlink_map[number], plain.mavlink_map[number]
        assert extended.crc_extra == known.crc_extra
        assert extended.ordered_fieldnames[: len(known.ordered_fieldnames)] == known.ordered_fieldnames


def test_pymavlink_stays_as_it_was() -> None:
    """The additions are in a copy: another user of pymavlink in the same process sees none of them."""
    assert not set(KNOWN) & set(plain.mavlink_map)
    assert dialect.mavlink_map is not plain.mavlink_map


def test_added_messages_go_there_and_back() -> None:
    """Text, arrays and extensions survive packing and decoding; what is left out is zero."""
    mav = dialect.MAVLink(None, 1, 1)

    def there_and_back(message: object) -> dict[str, object]:
        fields: dict[str, object] = mav.decode(bytearray(message.pack(mav))).to_dict()  # type: ignore[attr-defined]
        return fields

    uri = there_and_back(dialect.MAVLink_component_metadata_message(5, 6, b"mftp://x"))
    assert uri == {"mavpackettype": "COMPONENT_METADATA", "time_boot_ms": 5, "file_crc": 6, "uri": "mftp://x"}
    event = there_and_back(dialect.MAVLink_event_message(id=77, sequence=3, arguments=[*range(40)]))
    assert (event["id"], event["sequence"], event["log_levels"]) == (77, 3, 0)
    assert event["arguments"] == [*range(40)]
    current = there_and_back(dialect.MAVLink_mission_current_message(1, 2, 3, 4, 5, 6, 7))
    assert (current["seq"], current["total"], current["rally_points_id"]) == (1, 2, 7)
    assert there_and_back(dialect.MAVLink_mission_ack_message(1, 2, 0))["opaque_id"] == 0


def test_every_entry_of_an_enumeration_that_the_controller_names_exists() -> None:
    """The type checker does not know pymavlink's names, and some stand in branches that few flights take."""
    paths = Path(vehicle_models.__file__).parent.rglob("*.py")
    text = "".join(path.read_text(encoding="utf-8") for path in paths)
    named = {*re.findall(r"\b((?:MAV_[A-Z_]+|GPS_FIX_TYPE))\.([A-Z]\w+)", text)}
    assert len(named) > 100
    missing = {(name, entry) for name, entry in named if entry not in getattr(_enums, name).__members__}
    assert not missing
