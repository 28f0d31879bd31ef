"""Identity of the autopilot: version, protocol, modes, events, metadata; and its files over MAVLink FTP."""

from __future__ import annotations

import json
import lzma
import struct
from typing import Any

from pymavlink.mavftp import MAVFTP
from test_vehicle_files import Ftp, plain_crc
from vehicle_client import Client, Make, mavlink, of, simspec

from vehicle_models.controller.links._enums import MAV_FTP_ERR, MAV_FTP_OPCODE

REQUEST = 512


def ask(client: Client, number: int, index: float = 0.0) -> tuple[list[int], list[Any]]:
    """Request a message: the results, and everything else messages."""
    begun = len(client.received)
    results = client.command(REQUEST, number, index)
    return results, client.received[begun:]


def test_px4_answers_requests_for_its_identity(make: Make) -> None:
    """Version, protocol and modes; a mode out of range and an unknown message are denied."""
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
    names = [message.get_type() for message in messages]
    assert names.index("COMMAND_ACK") < names.index("AUTOPILOT_VERSION")
    version = of("AUTOPILOT_VERSION", messages)[0]
    assert (version.capabilities, bytes(version.uid2)[17]) == (64495, 0)
    assert [ask(client, number)[0] for number in (300, 397, 435, 436, 411)] == [[4]] * 5


def test_px4_metadata_can_be_followed(make: Make) -> None:
    """COMPONENT_METADATA leads to the general file, that to parameters and events, with checksums that hold."""
    client = make()
    (metadata,) = of("COMPONENT_METADATA", ask(client, 397)[1])
    assert metadata.uri == "mftp://etc/extras/component_general.json.xz"
    ftp = Ftp(client)
    packed = ftp.fetch("etc/extras/component_general.json.xz")
    assert plain_crc(packed) == metadata.file_crc
    files = {}
    for load in json.loads(lzma.decompress(packed))["metadataTypes"]:
        content = ftp.fetch(load["uri"].removeprefix("mftp://"))
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
    """Listings, a burst, checksums, and a refusal with its code for everything that cannot be."""
    client = make()
    ftp = Ftp(client)
    ftp.done(MAV_FTP_OPCODE.RESETSESSION)
    listed = ftp.done(MAV_FTP_OPCODE.LISTDIRECTORY, b"/etc/extras")
    assert [part.split(b"\t")[0] for part in listed.split(b"\0")[:-1]] == [
        b"Fall_events.json.xz",
        b"Fcomponent_general.json.xz",
        b"Fparameters.json.xz",
    ]
    end = bytes([MAV_FTP_ERR.EOF])
    assert ftp.refused(MAV_FTP_OPCODE.LISTDIRECTORY, b"/etc/extras", offset=3) == end
    whole = ftp.fetch("/etc/extras/parameters.json.xz")
    ftp.done(MAV_FTP_OPCODE.OPENFILERO, b"/etc/extras/parameters.json.xz")
    answers = ftp.answers(MAV_FTP_OPCODE.BURSTREADFILE, b"", size=239)
    assert b"".join(data for _, _, data in answers) == whole
    assert [end for _, end, _ in answers] == [0] * (len(answers) - 1) + [1]
    checksum = ftp.done(MAV_FTP_OPCODE.CALCFILECRC, b"etc/extras/parameters.json.xz")
    assert checksum == struct.pack("<I", plain_crc(whole))
    for opcode, data, error in (
        (MAV_FTP_OPCODE.OPENFILERO, b"@PARAM/param.pck", MAV_FTP_ERR.NOSESSIONSAVAILABLE),
        (MAV_FTP_OPCODE.CALCFILECRC, b"nothing", MAV_FTP_ERR.FILENOTFOUND),
        (MAV_FTP_OPCODE.LISTDIRECTORY, b"nowhere", MAV_FTP_ERR.FILENOTFOUND),
        (MAV_FTP_OPCODE.REMOVEFILE, b"etc/extras/parameters.json.xz", MAV_FTP_ERR.FILEPROTECTED),
        (99, b"", MAV_FTP_ERR.UNKNOWNCOMMAND),
    ):
        assert ftp.refused(opcode, data) == bytes([error]), data
    client.fly(11.0)  # the session that nobody used is closed by now
    assert ftp.refused(MAV_FTP_OPCODE.OPENFILERO, b"@PARAM/param.pck") == bytes([MAV_FTP_ERR.FILENOTFOUND])
    assert ftp.refused(MAV_FTP_OPCODE.READFILE) == bytes([MAV_FTP_ERR.INVALIDSESSION])


def test_ardupilot_serves_all_parameters_in_one_file(make: Make) -> None:
    """`@PARAM/param.pck` as pymavlink's own decoder reads it: every name, kind and value."""
    packed = Ftp(make(simspec("ardupilot"))).fetch("@PARAM/param.pck?withdefaults=1")
    decoded = MAVFTP.ftp_param_decode(packed)
    assert decoded is not None
    values = {name.decode(): value for name, value, _ in decoded.params}
    assert len(values) == len(decoded.params) > 700
    assert (values["RTL_ALT"], values["GUID_TIMEOUT"], values["DISARM_DELAY"]) == (1500, 3.0, 10)


def test_the_system_id_is_a_parameter_read_at_the_start(make: Make) -> None:
    """It sends as 7 and takes messages to 7; writing the parameter has no effect before a restart."""
    client = make(simspec(vehicle={"parameters": {"MAV_SYS_ID": 7}}))
    assert {message.get_srcSystem() for message in client.received} == {7}
    assert client.command(REQUEST, 148) == []
    client.send(mavlink.MAVLink_command_long_message(7, 1, REQUEST, 0, 148, 0, 0, 0, 0, 0, 0))
    assert [message.result for message in of("COMMAND_ACK", client.fly(0.02))] == [0]
    (bits,) = struct.unpack("<f", struct.pack("<i", 9))
    client.send(mavlink.MAVLink_param_set_message(7, 1, b"MAV_SYS_ID", bits, 6))
    assert {message.get_srcSystem() for message in client.fly(2.0)} == {7}
