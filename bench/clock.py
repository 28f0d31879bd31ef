"""The session's clock as a type, and the topic on which agents hear it.

It stands outside `bench.contracts` because the agent's client needs it, and must start without pydantic and
NumPy.
"""

from __future__ import annotations

from bench.values import value_class


@value_class(frozen=True, order=True, slots=True)
class SimTime:
    """A moment on the session's simulated clock, in nanoseconds since its start. Spans are float seconds.

    Host clocks never become a `SimTime`; only a session (or a fake of one) makes the first.
    """

    ns: int

    @property
    def s(self) -> float:
        """Seconds since the session's start."""
        return self.ns * 1e-9

    def after(self, span_s: float) -> SimTime:
        """The moment `span_s` seconds later, rounded to the nanosecond."""
        return SimTime(self.ns + round(span_s * 1e9))

    def since(self, earlier: SimTime) -> float:
        """Seconds from `earlier` to this moment."""
        return (self.ns - earlier.ns) * 1e-9


START = SimTime(0)

CLOCK = "/clock"
"""rosgraph_msgs/msg/Clock on the air network: every step of simulated time that the agent may see."""
