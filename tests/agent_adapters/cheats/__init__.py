"""Cheating agents: test material that tries to gain by other means than flying well, or to harm.

The bench starts them from cheat.yaml, inside a session alone; `_catalogue` lists the tricks with what becomes of each. A trick may not harm a host whose walls do not hold: what could is bounded, or probed with a request that the
kernel judges in the same way and that changes nothing (signal 0, the priority that a process has already).
"""
