"""How much of what an agent says is recorded: by simulated time alone, so that every host drops the same."""

from __future__ import annotations

from dataclasses import dataclass

from bench.contracts import SimTime


@dataclass(frozen=True, slots=True)
class Limit:
    """So much at once, and so much more for each simulated second since the session's start."""

    at_once: int
    each_s: int

    def reached(self, amount: int, time: SimTime) -> bool:
        """Whether `amount` is more than what was allowed until `time`."""
        # Integers: a float would round differently on another host for long sessions.
        return (amount - self.at_once) * 1_000_000_000 > self.each_s * time.ns


TOPIC_SAMPLES = Limit(500, 50)
"""Of each topic. Of 40 sessions with the reference agents, the busiest topic had 8 samples in its busiest second and
2.4 a second over the session.
"""
PX4_SAMPLES = Limit(2000, 500)
"""Of each of PX4's topics. Its companions send setpoints of attitude at 100 Hz and of rates at 200 Hz."""
TOPIC_BYTES = Limit(8 * 1024 * 1024, 256 * 1024)
"""Of each topic. The reference agents' tracks, the longest documents, are 4.4 kB a second."""
MAX_DROPPED_SAMPLES = 10_000
"""Of all topics together, after which the session ends: 200 s of one topic at its full rate."""
MAX_DROPPED_BYTES = 64 * 1024 * 1024

MAVLINK_FROM_AGENT_BYTES = Limit(8 * 1024 * 1024, 64 * 1024)
"""Of each link, after which the session ends. The reference agents send up to 0.5 kB a second; every setpoint at 50 Hz
and a sensor at 30 Hz beside it make 10 kB.
"""
MAVLINK_TO_AGENT_BYTES = Limit(64 * 1024 * 1024, 1024 * 1024)
"""Of each link, what is recorded. Every stream at the controller's rate of 50 Hz is 0.3 MB a second."""


@dataclass(slots=True)
class TopicAllowance:
    """What one topic has used of its limits, and what was dropped beyond them."""

    limit: Limit = TOPIC_SAMPLES
    samples: int = 0
    size: int = 0
    dropped: int = 0
    dropped_bytes: int = 0

    def admits(self, time: SimTime, size: int) -> bool:
        """Count one sample. False: it is dropped, and uses up nothing of the limits."""
        if self.limit.reached(self.samples + 1, time) or TOPIC_BYTES.reached(self.size + size, time):
            self.dropped += 1
            self.dropped_bytes += size
            return False
        self.samples += 1
        self.size += size
        return True
