"""What parameters do: each is set to two values, and what the vehicle does is measured. docs/parameters.md
lists them all.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from copter_effects import ARDUPILOT
from parameter_effect import Effect
from px4_effects import PX4
from vehicle_client import Client, mavlink, simspec
from wing_effects import WING

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_wing, open_x500
from vehicle_models.controller.ardupilot import _modes, _telemetry
from vehicle_models.documentation import PARAMETER_SECTIONS, parameters_read

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "parameters.md"
# ArduPilot stands for 42 s before it may be armed: half of each flight, and no effect that is shown here.
START_SHORTENED = 8.0
START_TIMES = (
    "STANDBY_S",
    "ESTIMATOR_S",
    "ALIGNED_S",
    "RECEIVER_S",
    "POSITION_S",
    "AHRS_S",
    "STABILIZE_READY_S",
    "USES_GPS_S",
    "GUIDED_READY_S",
)


@pytest.fixture
def client_of(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Client]]:
    """A vehicle that is ready to fly, with the given parameters."""
    for module in (_modes, _telemetry):
        for name in START_TIMES:
            if hasattr(module, name):
                monkeypatch.setattr(module, name, getattr(module, name) / START_SHORTENED)
    with ExitStack() as stack:

        def build(autopilot: str, parameters: dict[str, float]) -> Client:
            client = Client(255)
            stack.callback(client.socket.close)
            wing = autopilot == "wing"
            vehicle = {"parameters": parameters, **({"model": "wing"} if wing else {})}
            link = LinkSpec("onboard", "udp_out", port=client.port, streams="none")
            plan = VehiclePlan(simspec("px4" if wing else autopilot, vehicle=vehicle), (link,))
            client.vehicle = stack.enter_context((open_wing if wing else open_x500)(plan))
            client.fly(1.1)
            client.fly(42.0 / START_SHORTENED if autopilot == "ardupilot" else 4.0)
            client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION)
            return client

        yield build


QUICK = {
    "px4": {"MPC_TKO_SPEED": 4.0},
    "ardupilot": {"WPNAV_SPEED_UP": 400.0},
    "wing": {},
}  # to the height where something is measured


def shown(client_of: Callable[..., Client], autopilot: str, effect: Effect) -> None:
    for value, comes in zip(effect.values, effect.comes, strict=True):
        measured = effect.measure(
            client_of(autopilot, {**QUICK[autopilot], **dict(effect.beside), effect.name: value})
        )
        expected = comes if isinstance(comes, str) else pytest.approx(comes, abs=effect.within)
        assert measured == expected, f"{effect.name} {value:g}"


@pytest.mark.parametrize("effect", PX4, ids=lambda case: case.name)
def test_px4_does_what_the_parameter_says(client_of: Callable[..., Client], effect: Effect) -> None:
    shown(client_of, "px4", effect)


@pytest.mark.parametrize("effect", ARDUPILOT, ids=lambda case: case.name)
def test_ardupilot_does_what_the_parameter_says(client_of: Callable[..., Client], effect: Effect) -> None:
    shown(client_of, "ardupilot", effect)


@pytest.mark.parametrize("effect", WING, ids=lambda case: case.name)
def test_the_wing_does_what_the_parameter_says(client_of: Callable[..., Client], effect: Effect) -> None:
    shown(client_of, "wing", effect)


EFFECTS = {"px4": PX4, "ardupilot": ARDUPILOT, "wing": WING}
ROW = re.compile(r"\| `(\w+)` \| ([-\d.]+) \| (.+) \| (\S+|not shown) \|")


def on_the_page() -> dict[str, dict[str, tuple[float, str]]]:
    """Default and proof of each parameter, by section and name."""
    rows_by_section: dict[str, dict[str, tuple[float, str]]] = {}
    tables, _, _ = PAGE.read_text().partition("## How many have an effect")
    for line in tables.splitlines():
        if line.startswith("## "):
            section = rows_by_section.setdefault(line.removeprefix("## "), {})
        elif row := ROW.fullmatch(line):
            section[row[1]] = (float(row[2]), row[4])
    return rows_by_section


def test_the_page_lists_every_parameter_that_the_code_reads() -> None:
    """A parameter that comes to have an effect gets a row, and one that loses it loses the row."""
    assert {name: set(rows) for name, rows in on_the_page().items()} == parameters_read()


def test_the_page_has_the_defaults() -> None:
    for section, rows in on_the_page().items():
        defaults = {
            parameter.name: parameter.default
            for parameter in PARAMETER_SECTIONS[section].parameters.definitions
        }
        assert {name: default for name, (default, _) in rows.items()} == {
            name: defaults[name] for name in rows
        }


def test_the_page_says_where_each_effect_is_shown() -> None:
    """By the tables above, or by a test that sets the parameter, or nowhere."""
    for section, rows in on_the_page().items():
        names = {effect.name for effect in EFFECTS[section]}
        assert names == {name for name, (_, proof) in rows.items() if proof == "effects"}
        for name, (_, proof) in rows.items():
            if proof not in ("effects", "not shown"):
                assert name in (Path(__file__).parent / f"test_vehicle_{proof}.py").read_text(), name
    assert min(len(PX4), len(ARDUPILOT)) >= 25
