"""The client library for Python agents, and the reference agents with their manifests.

`agent_adapters.client` is what a Python agent may use on its side of the air network;
`agent_adapters.reference` is an agent like any other. How agents are started and bounded is `bench.agents`.
"""
