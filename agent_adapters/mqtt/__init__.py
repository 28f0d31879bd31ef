"""For agents that speak MQTT: a bridge that mirrors the air network of a session as JSON on a broker.

    python -m agent_adapters.mqtt -- node my_agent.js

is the command in such an agent's manifest. The bridge is part of the agent: it has the agent's credentials and box and
nothing more, so what the router refuses to an agent it refuses to the bridge. docs/mqtt-agents.md describes it.
"""
