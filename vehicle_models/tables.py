"""The tables that `rebar tables` prints, read from the code: what the imitated autopilots do and have no effect on.

Each function gives rows of cells, the header first.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from bench.contracts import LinkSpec, VehiclePlan
from bench.simspec import SimSpec

from ._aircraft import X500, open_x500
from ._read_table import read_table
from .controller import AUTOPILOTS, WING_AUTOPILOTS, Autopilot, FlightState, ReferencePoint, open_links
from .controller.links._enums import MAV_FRAME
from .controller.links._frames import Packer
from .controller.links._radio import Channel
from .controller.links._signing import open_signing
from .controller.missions._item_actions import effect_of
from .controller.policies._tables import COMMAND_NAMES
from .controller.state._parameter_store import Parameter
from .controller.state._plan_store import MISSION, MissionItem
from .controller.state._service import Command, CommandResult, MessageSender

Rows = list[tuple[str, ...]]

CONFORMANCE = Path(__file__).parent / "controller" / "conformance.csv"
"""What was observed of the real autopilots, and whether it holds here."""

VERDICTS = ("same", "different", "missing")

PARAMETER_SECTIONS: dict[str, Autopilot] = {**AUTOPILOTS, "wing": WING_AUTOPILOTS["px4"]}
"""The autopilot behind each first cell of the table of parameters."""

SIMULATED_SENSORS = (
    *("HIL_STATE", "HIL_STATE_QUATERNION", "HIL_SENSOR", "HIL_GPS", "HIL_OPTICAL_FLOW", "HIL_RC_INPUTS_RAW"),
    *("HIL_CONTROLS", "HIL_ACTUATOR_CONTROLS", "SIM_STATE", "SIMSTATE"),
    *("GPS_INPUT", "GPS_INJECT_DATA", "GPS_RTCM_DATA"),
    *("VISION_POSITION_ESTIMATE", "VISION_SPEED_ESTIMATE", "VICON_POSITION_ESTIMATE", "ATT_POS_MOCAP"),
    *("GLOBAL_VISION_POSITION_ESTIMATE", "OPTICAL_FLOW", "OPTICAL_FLOW_RAD", "ODOMETRY"),
)
"""Messages with which a simulator, or a sensor on a link, would tell an autopilot what it measures."""

REFUSED_ITEM = "refused"
"""In the table of mission items."""

# Values of every parameter of a command with which its answer is tried. Policies compare with 0 and 1 (off, on) and with
# kinds of calibration (1, 2, 4); 1 is a servo channel in use and 5 a free one.
_TRIED_VALUES = (0.0, 1.0, 2.0, 4.0, 5.0)


def command_table() -> Rows:
    """Commands (COMMAND_LONG, COMMAND_INT) that an autopilot carries out or answers otherwise than UNSUPPORTED."""
    carried_out = {name: _commands_carried_out(name) for name in AUTOPILOTS}
    with open_links((LinkSpec("tables", "tcp_in"),)) as links:
        sender = MessageSender(1, 1, Channel(links[0], Packer(1, 1), open_signing([], 0)))
        columns = [_command_cells(AUTOPILOTS[name], *carried_out[name], sender) for name in AUTOPILOTS]
    rows: Rows = [("number", "MAV_CMD", *AUTOPILOTS)]
    for number in sorted(set().union(*columns)):
        cells = (column.get(number, "not known") for column in columns)
        rows.append((str(number), COMMAND_NAMES[number], *cells))
    return rows


def _commands_carried_out(autopilot: str) -> tuple[frozenset[int], frozenset[int]]:
    """The commands that a multicopter carries out without a gimbal, and with one."""
    return _built_commands(autopilot, {}), _built_commands(autopilot, {"camera": {"gimbal": True}})


def _built_commands(autopilot: str, vehicle: Mapping[str, object]) -> frozenset[int]:
    corners = [{"east_m": 0, "north_m": 0}, {"east_m": 9, "north_m": 0}, {"east_m": 9, "north_m": 9}]
    document = {
        "name": "tables",
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
    for number in COMMAND_NAMES:
        result = _result_without_effect(autopilot, number, sender)
        if number in without:
            cells[number] = "carried out"
        elif number in with_gimbal:
            cells[number] = f"carried out with a gimbal, else {result or 'not known'}"
        elif result:
            cells[number] = result
    return cells


def _result_without_effect(autopilot: Autopilot, number: int, sender: MessageSender) -> str | None:
    """The policy's answer to a command that no service carries out; None when it does not know it."""
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


def mission_table() -> Rows:
    """Items of a mission that an autopilot takes, and what each does when its turn comes."""
    rows: Rows = [("number", "MAV_CMD", *AUTOPILOTS)]
    for number, name in COMMAND_NAMES.items():
        cells = [_item_cell(autopilot, number) for autopilot in AUTOPILOTS.values()]
        if set(cells) != {REFUSED_ITEM}:
            rows.append((str(number), name, *cells))
    return rows


def _item_cell(autopilot: Autopilot, number: int) -> str:
    frames = (MAV_FRAME.MISSION, MAV_FRAME.GLOBAL_RELATIVE_ALT)
    items = [MissionItem(number, frame, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0) for frame in frames]
    policy = autopilot.missions
    if all(policy.transfer.refuse_item(MISSION, item, False) is not None for item in items):
        return REFUSED_ITEM
    return effect_of(number, policy)


def simulation_table() -> Rows:
    """What of the simulation MAVLink clients see or change, in a session and with `simulation_control`."""
    rows: Rows = [("of the simulation", "in a session", "with simulation_control, and in rebar fly")]
    read = parameters_read()
    for name, autopilot in AUTOPILOTS.items():
        names = [parameter.name for parameter in autopilot.parameters.definitions]
        for beginning in autopilot.parameters.simulation:
            members = [parameter for parameter in names if parameter.startswith(beginning)]
            effective = ", ".join(member for member in members if member in read[name])
            spelled = f"{beginning}* ({len(members)} of them)" if len(members) > 1 else beginning
            effect = f"set; with an effect: {effective}" if effective else "set, without effect"
            rows.append((f"{name}: {spelled}", "read only", effect))
    return [
        *rows,
        ("px4: command INJECT_FAILURE", "DENIED", "carried out while SYS_FAILURE_EN is 1"),
        (
            "message HIL_STATE_QUATERNION (the true motion)",
            "not sent, unless vehicle.ground_truth",
            "the same; rebar fly sends it on request",
        ),
        ("ardupilot: message SIMSTATE", "the estimate, not the truth", "the same"),
        *((f"message {message}", "ignored, and counted", "the same") for message in SIMULATED_SENSORS),
    ]


def conformance_table() -> Rows:
    """What was observed of the real autopilots, and whether it is the same here, different or missing."""
    columns = ("autopilot", "subject", "observation", "verdict", "note")
    return [columns, *(tuple(row[column] for column in columns) for row in read_table(CONFORMANCE))]


def parameter_table() -> Rows:
    """Parameters that have an effect; `wing` has those that PX4 on the fixed wing reads beside the quadrotor's."""
    rows: Rows = [("autopilot", "parameter", "default", "meaning")]
    for section, names in parameters_read().items():
        definitions = {
            parameter.name: parameter for parameter in PARAMETER_SECTIONS[section].parameters.definitions
        }
        rows += [
            (section, name, f"{definitions[name].default:g}", _explained(definitions[name]))
            for name in sorted(names)
        ]
    return rows


def parameters_read() -> dict[str, set[str]]:
    """Names of the parameters that the code looks up, by autopilot and `wing`."""
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
            shared = not set(AUTOPILOTS) & set(path.relative_to(Path(__file__).parent).parts)
            if shared or path.parent.name == name:
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


@cache  # two tables ask for every module, and parsing them is what they cost
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
