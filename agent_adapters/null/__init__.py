"""Null agents: programs that do not do what a mission asks for, whatever they say.

The best confidence that any of them reaches is the floor of an observable (docs/rulings.md, 24). Run as
`python -m agent_adapters.null BEHAVIOUR`; docs/agents-bounds.md lists the behaviours. They write their documents by
hand: the models of bench.contracts would cost each session four times the CPU of the rest of the agent.
"""
