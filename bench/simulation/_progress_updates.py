"""When a session says how far it is."""

from __future__ import annotations

from bench.contracts import START, OnProgress, ProgressUpdate, SimTime

UPDATE_PERIOD_S = 2.0
"""Host seconds between two updates. Chosen: somebody who watches sees it move, thirty sessions at once give fifteen
messages a second, and a minute of a session adds 8 kB to the file of --events (measured).
"""


class ProgressUpdates:
    """The updates of one session: one for each period of the host's time, however fast simulated time passes."""

    def __init__(self, on_progress: OnProgress, time_limit_s: float, host_s: float) -> None:
        self._on_progress, self._time_limit_s = on_progress, time_limit_s
        self._began_s = self._updated_s = host_s
        self._updated = START
        self.phase: str | None = None

    def publish_due(self, now: SimTime, host_s: float) -> None:
        """Publish an update if one is due at `host_s`, a reading of the session's host clock."""
        elapsed_s = host_s - self._updated_s
        if elapsed_s < UPDATE_PERIOD_S:
            return
        speed = (now.s - self._updated.s) / elapsed_s
        self._updated, self._updated_s = now, host_s
        self._on_progress(
            ProgressUpdate(
                simulated_s=round(now.s, 3),
                time_limit_s=self._time_limit_s,
                wall_s=round(host_s - self._began_s, 3),
                speed=round(speed, 3),
                phase=self.phase,
            )
        )
