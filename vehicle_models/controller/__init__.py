"""The flight controller: small MAVLink services around one flight state (`_flight_state.py`), and the policies
of the autopilots.

- `links/`: sockets that never block, whole frames from any bytes, signing, the queue of messages to send,
  MAVLink's numbers by name
- `services/`: commands and their acknowledgements, modes, arming, home, takeoff/land/return/reposition/orbit,
  setpoints, sticks, following a target, identity, clock, motor test, restart
- `guidance/`: manoeuvres of a multicopter and of a fixed wing, the legs of a mission, flight limits, the land
  detector
- `missions/`: the transfer of plans, stored plans, missions in the air, items for gimbal and camera
- `safety/`: failsafes, fence, rally points, battery monitor, checks before arming, injected failures
- `telemetry/`: streams (which client gets which message at which rate), contents of messages, texts, events
- `payload/`: camera and gimbal
- `files/`: MAVLink FTP, component metadata, packed parameters
- `policies/`: what an autopilot must define: identity, parameters, modes (with arming), commands, setpoints,
  telemetry, missions, safety; with tables of what is plain data
- `px4/`, `ardupilot/`: the eight policies of each autopilot, under the same file names; in `px4/_topics.py` the topics of
  its ROS 2 companions, a second face of the services
- `px4_wing/`: the identity and the parameters of PX4 on a fixed wing

`_service.py` says which methods a service may have. `_controller.py` lists the services in the order in which
they tick: to add one, write a module and a line there. A service never asks which autopilot it serves: it asks
its policy for a number, a text, a result or a refusal. To add an autopilot, write another folder of eight files, and a
column in the tables of `policies/`.
"""

from __future__ import annotations

from ._controller import Controller as Controller
from ._controller import Equipment as Equipment
from .ardupilot import ARDUPILOT as ARDUPILOT
from .guidance._guidance import Manoeuvres as Manoeuvres
from .guidance._wing import WingManoeuvres as WingManoeuvres
from .guidance._wing import WingTarget as WingTarget
from .links._link import Link as Link
from .links._links import link_counters as link_counters
from .links._links import open_links as open_links
from .policies import Autopilot as Autopilot
from .px4 import PX4 as PX4
from .px4_wing import PX4_WING as PX4_WING
from .services._restart import PersistentState as PersistentState
from .state._flight_state import Airframe as Airframe
from .state._flight_state import FlightState as FlightState
from .state._flight_state import FlightTarget as FlightTarget
from .state._flight_state import ReferencePoint as ReferencePoint
from .state._flight_state import TargetAttitude as TargetAttitude
from .state._shaping import MotionShaping as MotionShaping
from .telemetry._attitude import attitude_quaternion as attitude_quaternion
from .telemetry._attitude import turned_to_body as turned_to_body

AUTOPILOTS: dict[str, Autopilot] = {"px4": PX4, "ardupilot": ARDUPILOT}
WING_AUTOPILOTS: dict[str, Autopilot] = {"px4": PX4_WING}
