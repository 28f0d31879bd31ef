"""What parameters do: each is set to two values, and what the vehicle does is measured."""

from __future__ import annotations

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
from vehicle_models.tables import parameters_read


@pytest.fixture
def client_of() -> Iterator[Callable[..., Client]]:
    """A vehicle that is ready to fly, with the given parameters."""
    with ExitStack() as stack:

        def build(autopilot: str, parameters: dict[str, float]) -> Client:
            client = Client(255)
            client.is_station = autopilot != "ardupilot"
            stack.callback(client.socket.close)
            wing = autopilot == "wing"
            vehicle = {"parameters": parameters, "model": "wing" if wing else "x500"}
            link = LinkSpec("onboard", "udp_out", port=client.port, streams="none")
            plan = VehiclePlan(simspec("px4" if wing else autopilot, vehicle=vehicle), (link,))
            client.vehicle = stack.enter_context((open_wing if wing else open_x500)(plan))
            client.fly(1.1)
            if autopilot != "ardupilot":
                client.fly(4.0)
            client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION)
            return client

        yield build


# To the height where something is measured.
QUICK = {
    "px4": {"MPC_TKO_SPEED": 4.0, "MPC_TKO_RAMP_T": 1.0},
    "ardupilot": {"WPNAV_SPEED_UP": 400.0, "WPNAV_ACCEL_Z": 250.0},
    "wing": {},
}
EFFECTS = {"px4": PX4, "ardupilot": ARDUPILOT, "wing": WING}


@pytest.mark.parametrize(
    ("autopilot", "effect"),
    [
        pytest.param(autopilot, effect, id=f"{autopilot}-{effect.name}")
        for autopilot, effects in EFFECTS.items()
        for effect in effects
    ],
)
def test_it_does_what_the_parameter_says(
    client_of: Callable[..., Client], autopilot: str, effect: Effect
) -> None:
    for value, comes in zip(effect.values, effect.comes, strict=True):
        parameters = {**QUICK[autopilot], **dict(effect.beside), effect.name: value}
        expected = comes if isinstance(comes, str) else pytest.approx(comes, abs=effect.within)
        assert effect.measure(client_of(autopilot, parameters)) == expected, f"{effect.name} {value:g}"


# The code reads these, and no test measures what they do.
NOT_SHOWN = {
    "px4": {
        *("COM_FLIGHT_UUID", "COM_RC_STICK_OV", "MPC_ACC_DOWN_MAX", "MPC_Z_VEL_P_ACC", "NAV_MC_ALT_RAD"),
    },
    "ardupilot": {
        *("ACRO_RP_RATE", "BATT_CAPACITY", "FS_EKF_ACTION", "LAND_ALT_LOW", "PSC_JERK_Z", "PSC_VELXY_I"),
        *("PSC_VELXY_P", "SR0_EXTRA2", "SR0_EXTRA3", "SR0_EXT_STAT", "SR0_RAW_SENS"),
    },
    "wing": {
        *("FW_AIRSPD_MAX", "FW_AIRSPD_MIN", "FW_LND_AIRSPD", "FW_LND_ANG", "FW_LND_FLALT", "FW_LND_FL_SINK"),
    },
}


@pytest.mark.parametrize("section", EFFECTS)
def test_every_parameter_that_the_code_reads_is_shown_or_known_not_to_be(section: str) -> None:
    """In the tables above, or by another test of vehicles that names it."""
    others = [path for path in Path(__file__).parent.glob("test_vehicle_*.py") if path != Path(__file__)]
    text = "".join(path.read_text() for path in others)
    unmeasured = parameters_read()[section] - {effect.name for effect in EFFECTS[section]}
    assert {name for name in unmeasured if name not in text} == NOT_SHOWN[section]
