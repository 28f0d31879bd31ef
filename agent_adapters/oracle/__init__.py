"""The oracle: the reference agent with perfect knowledge, openly given the truth by the bench.

What it reaches is the ceiling of an observable (docs/rulings.md, 24). Run as `python -m agent_adapters.oracle`.
"""
