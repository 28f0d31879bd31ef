"""The tables of commands and parameters in docs/, written from the code: `python -m
vehicle_models.documentation`.

docs/flight-controller.md has one pair of markers for each table, docs/parameters.md likewise. The text between
them is replaced.
"""

from __future__ import annotations

import argparse
import ast
import csv
import itertools
import re
import sys
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from bench.contracts import LinkSpec, VehiclePlan
from bench.simspec import SimSpec

from ._aircraft import X500, open_x500
from .controller import AUTOPILOTS, WING_AUTOPILOTS, Autopilot, FlightState, ReferencePoint, open_links
from .controller._service import Command, CommandResult, MessageSender
from .controller.links._enums import MAV_CMD, MAV_FRAME
from .controller.links._frames import Packer
from .controller.links._radio import Channel
from .controller.links._signing import open_signing
from .controller.missions._mission_flight import effect_of
from .controller.missions._store import MISSION, MissionItem
from .controller.parameters._store import Parameter

DOCS = Path(__file__).parent.parent / "docs"
COMMANDS_PAGE = DOCS / "flight-controller.md"
PARAMETERS_PAGE = DOCS / "parameters.md"

CONFORMANCE = Path(__file__).parent / "controller" / "conformance.csv"
"""What was observed of the real autopilots, and whether it holds here."""

VERDICTS = ("same", "different", "missing")

PARAMETER_SECTIONS: dict[str, Autopilot] = {**AUTOPILOTS, "wing": WING_AUTOPILOTS["px4"]}
"""The autopilot of each table of parameters."""

SIMULATED_SENSORS = (
    *("HIL_STATE", "HIL_STATE_QUATERNION", "HIL_SENSOR", "HIL_GPS", "HIL_OPTICAL_FLOW", "HIL_RC_INPUTS_RAW"),
    *(
        "HIL_CONTROLS",
        "HIL_ACTUATOR_CONTROLS",
        "SIM_STATE",
        "SIMSTATE",
        "GPS_INPUT",
        "GPS_INJECT_DATA",
        "GPS_RTCM_DATA",
    ),
    *("VISION_POSITION_ESTIMATE", "VISION_SPEED_ESTIMATE", "VICON_POSITION_ESTIMATE", "ATT_POS_MOCAP"),
    *("GLOBAL_VISION_POSITION_ESTIMATE", "OPTICAL_FLOW", "OPTICAL_FLOW_RAD", "ODOMETRY"),
)
"""Messages with which a simulator, or a sensor on a link, would tell an autopilot what it measures."""

REFUSED_ITEM = "refused"
"""In the table of mission items."""

NOT_SHOWN = "not shown"
"""In the last column of a parameter that no test proves."""

_PARAMETER_ROW = re.compile(r"\| `(\w+)` \| .* \| (\S+|not shown) \|")
# Values of every parameter of a command with which its answer is tried. Policies compare with 0 and 1 (off, on) and with
# kinds of calibration (1, 2, 4); 1 is a servo channel in use and 5 a free one.
_TRIED_VALUES = (0.0, 1.0, 2.0, 4.0, 5.0)


def command_table() -> str:
    """A row for each command that an autopilot carries out or gives a result of its own."""
    carried_out = {name: _commands_carried_out(name) for name in AUTOPILOTS}
    with open_links((LinkSpec("documentation", "tcp_in"),)) as links:
        sender = MessageSender(1, 1, Channel(links[0], Packer(1, 1), open_signing([], 0)))
        columns = [_command_cells(AUTOPILOTS[name], *carried_out[name], sender) for name in AUTOPILOTS]
    lines = ["| number | MAV_CMD | PX4 | ArduPilot |", "| ---: | --- | --- | --- |"]
    for number in sorted(set().union(*columns)):
        cells = " | ".join(column.get(number, "not known") for column in columns)
        lines.append(f"| {number} | `{MAV_CMD(number).name}` | {cells} |")
    return "\n".join(lines) + "\n"


def _commands_carried_out(autopilot: str) -> tuple[frozenset[int], frozenset[int]]:
    """The commands that a multicopter carries out without a gimbal, and with one."""
    without, with_gimbal = (
        _built_commands(autopilot, vehicle) for vehicle in ({}, {"camera": {"gimbal": True}})
    )
    return without, with_gimbal


def _built_commands(autopilot: str, vehicle: Mapping[str, object]) -> frozenset[int]:
    corners = [{"east_m": 0, "north_m": 0}, {"east_m": 9, "north_m": 0}, {"east_m": 9, "north_m": 9}]
    document = {
        "name": "documentation",
        "world": {"area": {"corners": corners}},
        "vehicle": {"autopilot": autopilot, **vehicle},
    }
    with open_x500(VehiclePlan(SimSpec.model_validate(document), ())) as opened:
        assert isinstance(opened, X500)
        return opened.commands()


def _command_cells(
    autopilot: Autopilot, without: frozenset[int], with_gimbal: frozenset[int], sender: MessageSender
) -> dict[int, str]:
    cells = {}
    for number in MAV_CMD:
        result = _result_without_effect(autopilot, number, sender)
        if number in without:
            cells[int(number)] = "carried out"
        elif number in with_gimbal:
            cells[int(number)] = f"carried out with a gimbal, else {result or 'not known'}"
        elif result:
            cells[int(number)] = result
    return cells


def _result_without_effect(autopilot: Autopilot, number: MAV_CMD, sender: MessageSender) -> str | None:
    """What the policy answers to a command that no service carries out; None when it does not know the
    command.
    """
    policy, results = autopilot.commands, set[str]()
    for value, armed in itertools.product(_TRIED_VALUES, (False, True)):
        flight = FlightState(
            step_s=0.02, origin=ReferencePoint(0, 0, 0.0), mode=autopilot.modes.initial, armed=armed
        )
        answer = policy.answer(flight, Command(number, (value,) * 7, None, sender))
        if answer:
            results.add(" then ".join(result.name for result in answer.first_time or answer.results))
        elif number in policy.fixed_results:
            fixed = policy.fixed_results[number]
            results.add("no answer" if fixed is None else fixed.name)
        else:
            results.add(CommandResult.UNSUPPORTED.name)
    if results == {CommandResult.UNSUPPORTED.name}:
        return None
    # A pair of results is the longest and reads best at the end.
    *others, last = sorted(results, key=lambda text: ("then" in text, text))
    return f"{', '.join(others)} or {last}" if others else last


def mission_table() -> str:
    """A row for each item of a mission that an autopilot takes, and what it does when its turn comes."""
    lines = ["| number | MAV_CMD | PX4 | ArduPilot |", "| ---: | --- | --- | --- |"]
    for number in MAV_CMD:
        cells = [_item_cell(autopilot, number) for autopilot in AUTOPILOTS.values()]
        if set(cells) != {REFUSED_ITEM}:
            lines.append(f"| {number} | `{number.name}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _item_cell(autopilot: Autopilot, number: MAV_CMD) -> str:
    frames = (MAV_FRAME.MISSION, MAV_FRAME.GLOBAL_RELATIVE_ALT)
    items = [MissionItem(number, frame, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0) for frame in frames]
    policy = autopilot.missions
    if all(policy.transfer.refuse_item(MISSION, item, False) is not None for item in items):
        return REFUSED_ITEM
    return effect_of(number, policy)


def simulation_table() -> str:
    """What of the simulation MAVLink clients can see or change, and what of it the bench allows them in a session."""
    lines = [
        "| of the simulation | in a session | with `simulation_control`, and in `rebar fly` |",
        "| --- | --- | --- |",
    ]
    read = parameters_read()
    for name, autopilot in AUTOPILOTS.items():
        names = [parameter.name for parameter in autopilot.parameters.definitions]
        for beginning in autopilot.parameters.simulation:
            members = [parameter for parameter in names if parameter.startswith(beginning)]
            effective = ", ".join(f"`{member}`" for member in members if member in read[name])
            spelled = f"`{beginning}*` ({len(members)} of them)" if len(members) > 1 else f"`{beginning}`"
            effect = f"set; with an effect: {effective}" if effective else "set, without effect"
            lines.append(f"| {name}: {spelled} | read only | {effect} |")
    lines.append("| px4: command `INJECT_FAILURE` | DENIED | carried out while SYS_FAILURE_EN is 1 |")
    lines.append(
        "| message `HIL_STATE_QUATERNION` (the true motion) | not sent, unless `vehicle.ground_truth` | the same; "
        "`rebar fly` sends it on request |"
    )
    lines.append("| ardupilot: message `SIMSTATE` | the estimate, not the truth | the same |")
    ignored = ", ".join(f"`{message}`" for message in SIMULATED_SENSORS)
    lines.append(f"| messages that would replace a sensor: {ignored} | ignored, and counted | the same |")
    return "\n".join(lines) + "\n"


def conformance_counts() -> str:
    """How many observations of the real autopilots hold here, by autopilot and subject, and those that do not."""
    with CONFORMANCE.open(newline="", encoding="ascii") as file:
        observations = list(csv.DictReader(file))
    lines = [f"| autopilot | subject | {' | '.join(VERDICTS)} |", "| --- | --- | ---: | ---: | ---: |"]
    for autopilot in AUTOPILOTS:
        found = [row for row in observations if row["autopilot"] == autopilot]
        for subject in ("all", *dict.fromkeys(row["subject"] for row in found)):
            verdicts = [row["verdict"] for row in found if subject in ("all", row["subject"])]
            counts = " | ".join(str(verdicts.count(verdict)) for verdict in VERDICTS)
            lines.append(f"| {autopilot} | {subject} | {counts} |")
    lines += ["", "| autopilot | observed | here |", "| --- | --- | --- |"]
    lines += [
        f"| {row['autopilot']} | {row['observation']} | {row['verdict']}: {row['note']} |"
        for row in observations
        if row["verdict"] != "same"
    ]
    return "\n".join(lines) + "\n"


def parameter_table(section: str, page: str) -> str:
    """A row for each parameter that the code reads.

    The last column is written by hand and taken from `page`.
    """
    shown_by = {
        row[1]: row[2]
        for row in map(_PARAMETER_ROW.fullmatch, _section_of(page, section).splitlines())
        if row
    }
    lines = ["| parameter | default | what it is | shown by |", "| --- | --- | --- | --- |"]
    definitions = {
        parameter.name: parameter for parameter in PARAMETER_SECTIONS[section].parameters.definitions
    }
    for name in sorted(parameters_read()[section]):
        parameter = definitions[name]
        lines.append(
            f"| `{name}` | {parameter.default:g} | {_explained(parameter)} | {shown_by.get(name, NOT_SHOWN)} |"
        )
    return "\n".join(lines) + "\n"


def parameter_counts(autopilot: str) -> str:
    """How many parameters an autopilot has and how many of them the code reads: in all, and by the first word of
    the name.
    """
    read = parameters_read()[autopilot]
    names = [parameter.name for parameter in AUTOPILOTS[autopilot].parameters.definitions]
    groups: dict[str, list[str]] = {}
    for name in sorted(names):
        groups.setdefault(name.partition("_")[0], []).append(name)
    lines = ["| names | parameters | with an effect | without |", "| --- | ---: | ---: | ---: |"]
    for label, members in [("all", names), *((f"`{word}`", group) for word, group in groups.items())]:
        effective = len(read.intersection(members))
        lines.append(f"| {label} | {len(members)} | {effective} | {len(members) - effective} |")
    return "\n".join(lines) + "\n"


def parameters_read() -> dict[str, set[str]]:
    """Names of the parameters that the code looks up, by section of the page."""
    names_by_section: dict[str, set[str]] = {name: set() for name in PARAMETER_SECTIONS}
    known = {
        name: {parameter.name for parameter in autopilot.parameters.definitions}
        for name, autopilot in PARAMETER_SECTIONS.items()
    }
    for path in Path(__file__).parent.rglob("*.py"):
        looked_up = constant_subscripts(path)
        if path.parent.name == "px4_wing":
            names_by_section["wing"] |= looked_up & known["wing"]
            continue
        for name in AUTOPILOTS:
            # What neither autopilot's folder holds is read for both.
            if path.parent.name == name or not set(AUTOPILOTS) & set(
                path.relative_to(Path(__file__).parent).parts
            ):
                names_by_section[name] |= looked_up & known[name]
    for name, autopilot in AUTOPILOTS.items():
        # The policies name these, and services look them up by that name.
        named = (
            autopilot.parameters.system_id,
            autopilot.safety.failure_parameter,
            autopilot.safety.fence.enable_parameter,
        )
        names_by_section[name] |= {parameter for parameter in named if parameter}
        names_by_section[name] |= {f"SR0_{suffix}" for suffix in autopilot.telemetry.stream_parameters}
    return names_by_section


@cache  # six tables ask for every module, and parsing them is what the pages cost
def constant_subscripts(path: Path) -> frozenset[str]:
    """Every text in square brackets of a module, as in `p["RTL_ALT"]`."""
    return frozenset(
        node.slice.value
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Subscript)
        and isinstance(node.slice, ast.Constant)
        and isinstance(node.slice.value, str)
    )


def _explained(parameter: Parameter) -> str:
    """The description with the unit behind its first clause."""
    # "norm", a share of one, is in PX4's metadata only.
    if parameter.unit in ("", "norm"):
        return parameter.description
    clause, semicolon, details = parameter.description.partition(";")
    return f"{clause}, {parameter.unit}{semicolon}{details}"


def with_commands(page: str) -> str:
    """docs/flight-controller.md with its tables updated."""
    page = _with_section(page, "conformance", conformance_counts())
    page = _with_section(page, "mission items", mission_table())
    page = _with_section(page, "simulation", simulation_table())
    return _with_section(page, "commands", command_table())


def with_parameters(page: str) -> str:
    """docs/parameters.md with its tables updated."""
    for section in PARAMETER_SECTIONS:
        page = _with_section(page, f"parameters of {section}", parameter_table(section, page))
    for autopilot in AUTOPILOTS:
        page = _with_section(page, f"counts of {autopilot}", parameter_counts(autopilot))
    return page


def _with_section(page: str, name: str, text: str) -> str:
    before, _, remaining = page.partition(_opening(name))
    _, closing, after = remaining.partition("<!-- end -->\n")
    if not closing:
        raise ValueError(f"the page lacks the line {_opening(name).strip()} or <!-- end --> behind it")
    return f"{before}{_opening(name)}{text}{closing}{after}"


def _section_of(page: str, section: str) -> str:
    _, _, remaining = page.partition(_opening(f"parameters of {section}"))
    return remaining.partition("<!-- end -->\n")[0]


def _opening(name: str) -> str:
    return f"<!-- {name} -->\n"


def main(arguments: list[str] | None = None) -> int:
    """Write the tables, or with `--check` only say whether the pages are up to date.

    Returns the exit status.
    """
    parser = argparse.ArgumentParser(
        description="Write the tables of commands and parameters in docs/ from the code."
    )
    parser.add_argument(
        "--check", action="store_true", help="change nothing; exit with 1 when a page is out of date"
    )
    check = parser.parse_args(arguments).check
    updates: dict[Path, Callable[[str], str]] = {
        COMMANDS_PAGE: with_commands,
        PARAMETERS_PAGE: with_parameters,
    }
    out_of_date = False
    for path, update in updates.items():
        page = path.read_text(encoding="utf-8")
        updated = update(page)
        if check and updated != page:
            print(f"{path} is out of date; run `python -m vehicle_models.documentation`", file=sys.stderr)
            out_of_date = True
        elif not check:
            path.write_text(updated, encoding="utf-8")
    return int(out_of_date)


if __name__ == "__main__":
    sys.exit(main())
