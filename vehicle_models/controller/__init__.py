"""The flight controller: small MAVLink services around one vehicle state, and the personalities that tell them how."""

from __future__ import annotations

from ._controller import Controller as Controller
from ._flight import Airframe as Airframe
from ._flight import Attitude as Attitude
from ._flight import Flight as Flight
from ._flight import Home as Home
from ._flight import Target as Target
from ._personality import Personality as Personality
from .ardupilot import ArduPilot as ArduPilot
from .guidance._manoeuvres import Manoeuvres as Manoeuvres
from .guidance._wing import WingManoeuvres as WingManoeuvres
from .guidance._wing import WingTarget as WingTarget
from .links._links import Link as Link
from .links._links import open_links as open_links
from .payload._equipment import Equipment as Equipment
from .px4 import Px4 as Px4
from .px4 import Px4Wing as Px4Wing
from .services._restart import Kept as Kept
from .telemetry._telemetry import attitude_quaternion as attitude_quaternion

PERSONALITIES: dict[str, Personality] = {"px4": Px4(), "ardupilot": ArduPilot()}
WING_PERSONALITIES: dict[str, Personality] = {"px4": Px4Wing()}
