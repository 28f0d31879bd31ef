"""The reference agent put together with perfect knowledge of objects, people and faults."""

from __future__ import annotations

from dataclasses import replace

from agent_adapters.client import AgentEnvironment, open_bench

from ..reference._agent import LINK, Agent, AgentParts, wanted
from ..reference._log import Log
from ..reference._settings import Settings
from ..reference.flight._piloted_vehicle import PilotedVehicle
from ..reference.perception._pose import PoseHistory
from ._mission import SECOND_SIDE_DEG, OracleMission
from ._perception import TruthPerception
from ._truth import load_truth
from ._watch import OracleWatch

NAME = "oracle"
# Round a target it flies some 2 m/s faster than it is told, by the place ahead that it aims at: recordings of campaign
# full show 10.2 m/s for 8 m/s. So it stays below the 9 m/s that the rules allow there.
INSPECT_MPS = 6.5
# It knows what stands in its way.
RESERVE_S = 8.0


def run(environment: AgentEnvironment, truth_path: str) -> str:
    """Fly one session; returns why it ended. Raises SetupError and LinkLost."""
    truth = load_truth(truth_path)
    # What it knows needs no second look, but what it reports has to rest on one, from another side. It picks the
    # moment to come down by itself.
    settings = replace(
        Settings.of(environment.options),
        min_viewpoint_deg=SECOND_SIDE_DEG,
        min_streak=1,
        landing_wait_s=0.0,
        inspect_speed_mps=INSPECT_MPS,
        reserve_s=RESERVE_S,
    )
    with open_bench(NAME, environment, wanted(environment, settings.camera)) as bench:
        poses, name = PoseHistory(), environment.vehicle
        vehicle, log = PilotedVehicle(bench.links[LINK], poses), Log(bench.publish, name)
        eyes = TruthPerception(poses, settings.mount, truth)
        watch = OracleWatch(vehicle, eyes, log)
        mission = OracleMission(vehicle, eyes, log, watch, settings)
        agent = Agent(name, AgentParts(vehicle, eyes, log, watch, mission))
        for moment in bench.moments(NAME):
            eyes.truth_tracks.advance(moment.time.s)
            agent.act(moment)
        return bench.ended
