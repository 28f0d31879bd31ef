"""An agent that says at once that its mission is complete."""

import os

from agent_adapters.client import open_bench, read_environment
from bench.contracts import AgentStatus, VehicleTopics, document_text

environment = read_environment(os.environ)
with open_bench("outside", environment, []) as bench:
    for moment in bench.moments("outside-agent"):
        status = AgentStatus(time_s=moment.time.s, phase="complete")
        bench.publish(VehicleTopics(environment.vehicle).status, document_text(status))
