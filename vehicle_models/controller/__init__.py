"""The flight controller: small MAVLink services around one flight state, and the policies of the
autopilots.
"""

from __future__ import annotations

from ._autopilot import Autopilot as Autopilot
from ._controller import Controller as Controller
from ._flight_state import Airframe as Airframe
from ._flight_state import FlightState as FlightState
from ._flight_state import FlightTarget as FlightTarget
from ._flight_state import ReferencePoint as ReferencePoint
from ._flight_state import TargetAttitude as TargetAttitude
from .ardupilot import ARDUPILOT as ARDUPILOT
from .guidance._manoeuvres import Manoeuvres as Manoeuvres
from .guidance._wing import WingManoeuvres as WingManoeuvres
from .guidance._wing import WingTarget as WingTarget
from .links._links import Link as Link
from .links._links import open_links as open_links
from .payload._equipment import Equipment as Equipment
from .px4 import PX4 as PX4
from .px4_wing import PX4_WING as PX4_WING
from .services._restart import PersistentState as PersistentState
from .telemetry._attitude import attitude_quaternion as attitude_quaternion

AUTOPILOTS: dict[str, Autopilot] = {"px4": PX4, "ardupilot": ARDUPILOT}
WING_AUTOPILOTS: dict[str, Autopilot] = {"px4": PX4_WING}
