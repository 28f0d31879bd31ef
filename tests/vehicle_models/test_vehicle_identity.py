"""Identity of the autopilot: version, protocol, modes, events, metadata; and its files over MAVLink FTP."""

from __future__ import annotations

import json
import lzma
import struct
import zlib
from typing import Any

from vehicle_client import Client, Make, mavlink, of, simspec

from vehicle_models.controller.links._enums import MAV_FTP_ERR, MAV_FTP_OPCODE

REQUEST = 512


def ask(client: Client, number: int, index: float = 0.0) -> tuple[list[int], list[Any]]:
    """Request a message: the results, and everything else messages."""
    begun = len(client.received)
    results = client.command(REQUEST, number, index)
    return results, client.received[begun:]


def ftp(client: Client, opcode: int, data: bytes = b"", **fields: int) -> list[Any]:
    """One request; the answers of three steps as (opcode, size, requested, complete, offset, data)."""
    size = fields.get("size", len(data))
    head = struct.pack(
        "<HBBBBBBI",
        fields.get("seq", 1),
        fields.get("session", 0),
        opcode,
        size,
        0,
        0,
        0,
        fields.get("offset", 0),
    )
    client.send(
        mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [*head, *data, *bytes(239 - len(data))])
    )
    replies = []
    for message in of("FILE_TRANSFER_PROTOCOL", client.fly(0.06)):
        payload = bytes(message.payload)
        _, _, op, length, requested, complete, _, offset = struct.unpack_from("<HBBBBBBI", payload)
        replies.append((op, length, requested, complete, offset, payload[12 : 12 + length]))
    return replies


def fetch(client: Client, path: str) -> bytes:
    """A whole file by open, read, terminate."""
    (opened,) = ftp(client, MAV_FTP_OPCODE.OPENFILERO, path.encode(), seq=10)
    assert opened[0] == MAV_FTP_OPCODE.ACK
    (size,) = struct.unpack("<I", opened[5])
    data, seq = b"", 11
    while len(data) < size:
        (answer,) = ftp(client, MAV_FTP_OPCODE.READFILE, size=239, offset=len(data), seq=seq)
        data, seq = data + answer[5], seq + 1
    assert ftp(client, MAV_FTP_OPCODE.READFILE, size=239, offset=len(data), seq=seq)[0][5] == bytes(
        [MAV_FTP_ERR.EOF]
    )
    assert ftp(client, MAV_FTP_OPCODE.TERMINATESESSION, seq=seq + 1)[0][0] == MAV_FTP_OPCODE.ACK
    return data


def plain_crc(data: bytes) -> int:
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def test_px4_answers_requests_for_its_identity(make: Make) -> None:
    """Version, protocol, component metadata and modes on request; a mode out of range and an unknown message
    are denied.
    """
    client = make()
    results, messages = ask(client, 148)
    assert (results, of("AUTOPILOT_VERSION", messages)[0].capabilities) == ([0], 59647)
    results, messages = ask(client, 300)
    protocol = of("PROTOCOL_VERSION", messages)[0]
    assert (results, protocol.version, protocol.min_version, protocol.max_version) == ([0], 200, 100, 203)
    results, messages = ask(client, 435)
    modes = of("AVAILABLE_MODES", messages)
    assert results == [0]
    assert [mode.mode_index for mode in modes] == list(range(1, modes[0].number_modes + 1))
    named = {mode.custom_mode: mode for mode in modes}
    assert (named[3 << 24 | 4 << 16].mode_name, named[3 << 24 | 4 << 16].standard_mode) == ("Hold", 0)
    assert (named[5 << 24 | 4 << 16].mode_name, named[5 << 24 | 4 << 16].standard_mode) == ("", 5)
    assert sum(mode.mode_name == "(Mode not available)" and mode.properties == 2 for mode in modes) == 8
    assert [len(of("AVAILABLE_MODES", ask(client, 435, index)[1])) for index in (1, 200)] == [1, 0]
    assert [
        ask(client, number, index)[0] for number, index in ((435, 200), (411, 0), (437, 0), (31999, 0))
    ] == [[2]] * 4
    assert of("CURRENT_MODE", ask(client, 436)[1])[0].custom_mode == 3 << 24 | 4 << 16


def test_ardupilot_acknowledges_first_and_has_no_modes_to_list(make: Make) -> None:
    """The acknowledgement comes before the message; what it has no slot for is FAILED."""
    client = make(simspec("ardupilot"))
    results, messages = ask(client, 148)
    assert results == [0]
    assert [
        message.get_type()
        for message in messages
        if message.get_type() in ("COMMAND_ACK", "AUTOPILOT_VERSION")
    ] == [
        "COMMAND_ACK",
        "AUTOPILOT_VERSION",
    ]
    version = of("AUTOPILOT_VERSION", messages)[0]
    assert (version.capabilities, bytes(version.uid2)[17]) == (64495, 0)
    assert [ask(client, number)[0] for number in (300, 397, 435, 436, 411)] == [[4]] * 5


def test_px4_events_are_numbered_and_kept(make: Make) -> None:
    """A text that is an event comes as EVENT too; what was missed can be requested for, what never was is an
    error.
    """
    client = make()
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [1]
    (event,) = of("EVENT", client.received)
    assert (event.sequence, event.id >> 24, event.log_levels) == (0, 1, 0x22)
    client.send(mavlink.MAVLink_request_event_message(1, 1, 0, 0))
    assert [message.id for message in of("EVENT", client.fly(0.02))] == [event.id]
    client.send(mavlink.MAVLink_request_event_message(1, 1, 7, 9))
    (error,) = of("RESPONSE_EVENT_ERROR", client.fly(0.02))
    assert (error.sequence, error.sequence_oldest_available) == (7, 0)


def test_px4_metadata_can_be_followed(make: Make) -> None:
    """COMPONENT_METADATA leads to the general file, and that to parameters and events, with checksums that
    hold.
    """
    client = make()
    (metadata,) = of("COMPONENT_METADATA", ask(client, 397)[1])
    assert metadata.uri == "mftp://etc/extras/component_general.json.xz"
    packed = fetch(client, "etc/extras/component_general.json.xz")
    assert plain_crc(packed) == metadata.file_crc
    files = {}
    for load in json.loads(lzma.decompress(packed))["metadataTypes"]:
        content = fetch(client, load["uri"].removeprefix("mftp://"))
        assert plain_crc(content) == load["fileCrc"]
        files[load["type"]] = json.loads(lzma.decompress(content))
    described = {file["name"]: file for file in files[1]["parameters"]}
    takeoff = described["MIS_TAKEOFF_ALT"]
    assert (takeoff["type"], takeoff["default"], takeoff["units"]) == ("Float", 2.5, "m")
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    listed = {message.param_id for message in of("PARAM_VALUE", client.fly(1.5))} - {"_HASH_CHECK"}
    assert listed == set(described)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    event = of("EVENT", client.received)[-1]
    events = files[4]["components"]["1"]["event_groups"]["default"]["events"]
    assert events[str(event.id & 0xFFFFFF)]["name"] == "commander_armed_by"


def test_files_are_listed_burst_and_guarded(make: Make) -> None:
    """Listings, a burst with its end marked, checksums, and a refusal with its code for everything that
    cannot be.
    """
    client = make()
    assert ftp(client, MAV_FTP_OPCODE.RESETSESSION, seq=1)[0][0] == MAV_FTP_OPCODE.ACK
    listed = ftp(client, MAV_FTP_OPCODE.LISTDIRECTORY, b"/etc/extras", seq=2)[0][5]
    assert [part.split(b"\t")[0] for part in listed.split(b"\0")[:-1]] == [
        b"Fall_events.json.xz",
        b"Fcomponent_general.json.xz",
        b"Fparameters.json.xz",
    ]
    assert ftp(client, MAV_FTP_OPCODE.LISTDIRECTORY, b"/etc/extras", seq=3, offset=3)[0][5] == bytes(
        [MAV_FTP_ERR.EOF]
    )
    whole = fetch(client, "/etc/extras/parameters.json.xz")
    ftp(client, MAV_FTP_OPCODE.OPENFILERO, b"/etc/extras/parameters.json.xz", seq=4)
    assert ftp(client, MAV_FTP_OPCODE.OPENFILERO, b"/etc/extras/parameters.json.xz", seq=5)[0][5] == bytes(
        [MAV_FTP_ERR.NOSESSIONSAVAILABLE]
    )
    answers = ftp(client, MAV_FTP_OPCODE.BURSTREADFILE, seq=6, size=239)
    while not answers[-1][3]:
        answers += [
            (op, length, requested, complete, offset, data)
            for message in of("FILE_TRANSFER_PROTOCOL", client.fly(0.02))
            for (_, _, op, length, requested, complete, _, offset), data in [
                (
                    struct.unpack_from("<HBBBBBBI", bytes(message.payload)),
                    bytes(message.payload)[12 : 12 + bytes(message.payload)[4]],
                )
            ]
        ]
    assert b"".join(message[5] for message in answers) == whole
    assert [message[3] for message in answers[:-1]] == [0] * (len(answers) - 1)
    (checksum,) = ftp(client, MAV_FTP_OPCODE.CALCFILECRC, b"etc/extras/parameters.json.xz", seq=7)
    assert struct.unpack("<I", checksum[5])[0] == plain_crc(whole)
    refusals = {
        (MAV_FTP_OPCODE.OPENFILERO, b"@PARAM/param.pck"): MAV_FTP_ERR.NOSESSIONSAVAILABLE,
        (MAV_FTP_OPCODE.CALCFILECRC, b"nothing"): MAV_FTP_ERR.FILENOTFOUND,
        (MAV_FTP_OPCODE.LISTDIRECTORY, b"nowhere"): MAV_FTP_ERR.FILENOTFOUND,
        (MAV_FTP_OPCODE.REMOVEFILE, b"etc/extras/parameters.json.xz"): MAV_FTP_ERR.FILEPROTECTED,
        (99, b""): MAV_FTP_ERR.UNKNOWNCOMMAND,
    }
    for seq, ((opcode, data), error) in enumerate(refusals.items(), start=20):
        assert ftp(client, opcode, data, seq=seq) == [(MAV_FTP_OPCODE.NAK, 1, opcode, 0, 0, bytes([error]))]
    client.fly(11.0)  # the session that nobody used is closed by now
    assert ftp(client, MAV_FTP_OPCODE.OPENFILERO, b"@PARAM/param.pck", seq=40)[0][5] == bytes(
        [MAV_FTP_ERR.FILENOTFOUND]
    )
    assert ftp(client, MAV_FTP_OPCODE.READFILE, seq=41)[0][5] == bytes([MAV_FTP_ERR.INVALIDSESSION])


def test_ardupilot_serves_all_parameters_in_one_file(make: Make) -> None:
    """`@PARAM/param.pck` as pymavlink's own decoder reads it: every name, kind and value."""
    from pymavlink.mavftp import MAVFTP

    client = make(simspec("ardupilot"))
    assert ftp(client, MAV_FTP_OPCODE.RESETSESSION, seq=1)[0][0] == MAV_FTP_OPCODE.ACK
    decoded = MAVFTP.ftp_param_decode(fetch(client, "@PARAM/param.pck?withdefaults=1"))
    assert decoded is not None
    values = {name.decode(): value for name, value, _ in decoded.params}
    assert len(values) == len(decoded.params) > 700
    assert (values["RTL_ALT"], values["GUID_TIMEOUT"], values["DISARM_DELAY"]) == (1500, 3.0, 10)


def test_the_system_id_is_a_parameter_read_at_the_start(make: Make) -> None:
    """A vehicle started as system 7 sends as 7 and takes messages to 7; writing the parameter has no effect
    before a restart.
    """
    client = make(simspec(vehicle={"parameters": {"MAV_SYS_ID": 7}}))
    assert {message.get_srcSystem() for message in client.received} == {7}
    assert client.command(REQUEST, 148) == []
    client.send(mavlink.MAVLink_command_long_message(7, 1, REQUEST, 0, 148, 0, 0, 0, 0, 0, 0))
    assert [message.result for message in of("COMMAND_ACK", client.fly(0.02))] == [0]
    (bits,) = struct.unpack("<f", struct.pack("<i", 9))
    client.send(mavlink.MAVLink_param_set_message(7, 1, b"MAV_SYS_ID", bits, 6))
    assert {message.get_srcSystem() for message in client.fly(2.0)} == {7}
