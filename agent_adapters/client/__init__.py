"""What a Python agent may use on its side of the air network; an agent in any other language needs
docs/agents-protocol.md alone.

    with open_bench("my_agent", read_environment(os.environ), subscriptions) as bench:
        for moment in bench.moments("my-agent"):
            for frame in moment.frames["onboard"]: ...
            for sample in moment.samples: ...
"""

from __future__ import annotations

from ._autopilots import ARDUPILOT as ARDUPILOT
from ._autopilots import PX4 as PX4
from ._autopilots import AutopilotKind as AutopilotKind
from ._autopilots import Mode as Mode
from ._autopilots import kind_of as kind_of
from ._bench import Bench as Bench
from ._bench import Moment as Moment
from ._bench import Wanted as Wanted
from ._bench import open_bench as open_bench
from ._environment import AgentEnvironment as AgentEnvironment
from ._environment import end_process as end_process
from ._environment import exit_code as exit_code
from ._environment import read_environment as read_environment
from ._environment import use_one_thread as use_one_thread
from ._eye import Eye as Eye
from ._eye import Sighting as Sighting
from ._eye import Thing as Thing
from ._eye import Things as Things
from ._link import MavlinkFrame as MavlinkFrame
from ._link import MavlinkLink as MavlinkLink
from ._link import open_link as open_link
from ._protocol import End as End
from ._protocol import Tick as Tick
from ._ticks import TickLine as TickLine
from ._ticks import open_tick_line as open_tick_line
