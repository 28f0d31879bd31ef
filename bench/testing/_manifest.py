"""Manifests of the fake agents."""

from __future__ import annotations

from bench.contracts import AgentManifest, MavlinkNeed

BEHAVIOURS = {
    "idle": "acknowledges every tick and does nothing",
    "finish": "says at once that its mission is complete",
    "crash": "exits with code 3 at the tenth tick",
    "hang": "stops answering at the tenth tick",
    "silent": "never connects",
    "mute": "connects and never says hello",
    "babble": "answers a tick with a line that is no message",
    "liar": "claims MAVLink messages that it never sent",
    "pretender": "says it subscribes to a topic and does not",
    "leaver": "closes the tick socket and lives on",
    "spam": "publishes far more than anybody needs",
    "dawdle": "takes 0.3 s of the host's time for each answer",
    "flood": "writes to stdout without end while it answers",
}


def agent_manifest(behaviour: str) -> AgentManifest:
    """The manifest of a fake agent. Raises KeyError for an unknown behaviour."""
    return AgentManifest(
        name=f"fake-{behaviour}",
        description=BEHAVIOURS[behaviour],
        command=("{python}", "-m", "bench.testing.agent", "--behaviour", behaviour),
        pace=("lockstep", "realtime"),
        mavlink=(MavlinkNeed(),),
    )
