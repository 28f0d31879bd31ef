"""What parameters do: each is set to two values, and what the vehicle does is measured.
`rebar tables parameters` lists them all.
"""

from __future__ import annotations

from collections import Counter
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
            vehicle = {"parameters": parameters, **({"model": "wing"} if wing else {})}
            link = LinkSpec("onboard", "udp_out", port=client.port, streams="none")
            plan = VehiclePlan(simspec("px4" if wing else autopilot, vehicle=vehicle), (link,))
            client.vehicle = stack.enter_context((open_wing if wing else open_x500)(plan))
            client.fly(1.1)
            if autopilot != "ardupilot":
                client.fly(4.0)
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
ELSEWHERE: dict[str, dict[str, tuple[str, ...]]] = {
    "px4": {
        "failures": ("SYS_FAILURE_EN",),
        "fence": (
            "GF_ACTION",
            "GF_MAX_HOR_DIST",
            "GF_MAX_VER_DIST",
            "RTL_TYPE",
        ),
        "external_modes": ("COM_MODE_ARM_CHK",),
        "identity": ("MAV_SYS_ID",),
        "manoeuvres": ("COM_RC_OVERRIDE",),
        "remarks": (
            "SIM_BAT_DRAIN",
            "SIM_BAT_ENABLE",
            "SIM_BAT_MIN_PCT",
        ),
        "waypoints": ("MPC_XY_TRAJ_P",),
    },
    "ardupilot": {
        "calibration": (
            "COMPASS_ENABLE",
            "COMPASS_USE",
            "COMPASS_USE2",
            "COMPASS_USE3",
        ),
        "failsafes": (
            "SIM_BATT_VOLTAGE",
            "SYSID_MYGCS",
        ),
        "remarks": (
            "TERRAIN_ENABLE",
            "TERRAIN_SPACING",
        ),
        "restart": ("SYSID_THISMAV",),
        "streams": ("SR0_EXTRA1",),
        "waypoints": (
            "WPNAV_ACCEL_C",
            "WPNAV_RADIUS",
        ),
    },
    "wing": {
        "wing": (
            "NAV_LOITER_RAD",
            "RTL_DESCEND_ALT",
            "RTL_LAND_DELAY",
            "RTL_LOITER_RAD",
        ),
    },
}
"""By the word in the name of the test file that sets the parameter."""
NOT_SHOWN = {
    "px4": {
        *(
            "COM_FLIGHT_UUID",
            "COM_RC_STICK_OV",
            "MPC_ACC_DOWN_MAX",
            "MPC_Z_VEL_P_ACC",
            "NAV_MC_ALT_RAD",
        )
    },
    "ardupilot": {
        *(
            "ACRO_RP_RATE",
            "BATT_CAPACITY",
            "FS_EKF_ACTION",
            "LAND_ALT_LOW",
            "PSC_JERK_Z",
            "PSC_VELXY_I",
            "PSC_VELXY_P",
            "RALLY_INCL_HOME",
            "RALLY_LIMIT_KM",
            "SR0_EXTRA2",
            "SR0_EXTRA3",
            "SR0_EXT_STAT",
            "SR0_RAW_SENS",
            "SR0_RC_CHAN",
        )
    },
    "wing": {
        *(
            "FW_AIRSPD_MAX",
            "FW_AIRSPD_MIN",
            "FW_LND_AIRSPD",
            "FW_LND_ANG",
            "FW_LND_FLALT",
            "FW_LND_FL_SINK",
        )
    },
}
"""The code reads these, and no test measures what they do."""


@pytest.mark.parametrize("section", EFFECTS)
def test_every_parameter_that_the_code_reads_is_shown_or_known_not_to_be(section: str) -> None:
    """Each stands once: in the tables above, in a test that sets the parameter, or among those not shown."""
    elsewhere = [name for names in ELSEWHERE[section].values() for name in names]
    names = [*{effect.name for effect in EFFECTS[section]}, *elsewhere, *NOT_SHOWN[section]]
    assert Counter(names) == Counter(parameters_read()[section])
    for word, parameters in ELSEWHERE[section].items():
        test = (Path(__file__).parent / f"test_vehicle_{word}.py").read_text()
        assert [name for name in parameters if name not in test] == []


def test_many_effects_are_measured() -> None:
    assert min(len(PX4), len(ARDUPILOT)) >= 25
