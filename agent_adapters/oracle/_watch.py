"""Announcements of faults and outages, from the schedule of the situation."""

from __future__ import annotations

from ..reference._log import Log
from ..reference._watch import Watch
from ..reference.flight._piloted_vehicle import PilotedVehicle
from ._log import SilentLog
from ._perception import TruthPerception
from ._truth import Truth

# The words by which a decision names a fault (docs/measures.md).
FAULT_WORDS = {
    "gps_off": "gps",
    "gps_drift": "gps",
    "battery_drop": "battery",
    "motor_off": "motor",
    "link_loss": "link",
}
# Degraded detections are announced by `degraded` and `restored` alone.
_ANNOUNCED = ("operator_link", "detections")


class OracleWatch(Watch):
    """Announces each fault and each outage of the situation as it begins and as it ends."""

    def __init__(self, vehicle: PilotedVehicle, eyes: TruthPerception, log: Log, truth: Truth) -> None:
        super().__init__(vehicle, eyes, SilentLog(log))
        self.perception = eyes
        self._announcing = log
        simspec = truth.simspec
        outages = [(o.at_s, o.duration_s, o.kind) for o in simspec.outages]
        faults = [(f.at_s, f.duration_s, FAULT_WORDS[f.kind]) for f in simspec.vehicle.failures]
        self._worse = [
            (at_s, at_s + span_s)
            for at_s, span_s, kind in outages
            if kind in ("detections", "detections_degraded")
        ]
        announced = faults + [(at_s, span_s, kind) for at_s, span_s, kind in outages if kind in _ANNOUNCED]
        begun = [(at_s, word, f"the situation says that {word} fails now") for at_s, _, word in announced]
        over = [
            (at_s + span_s, word, f"the situation says that {word} works again")
            for at_s, span_s, word in announced
            if span_s
        ]
        self._due = sorted([*begun, *over])

    def update(self) -> None:
        super().update()
        while self._due and self._due[0][0] <= self._announcing.now_s + 1e-6:
            _, word, text = self._due.pop(0)
            self._announcing.decide("notice", word, text)

    def _look_at_quality(self) -> None:
        """Tell the operator when perception is worse than usual, from the schedule."""
        now_s = self._announcing.now_s + 1e-6
        degraded = any(begun_s <= now_s < over_s for begun_s, over_s in self._worse)
        if degraded and not self.degraded:
            self._announcing.decide(
                "degraded", "detections", "the detections are worse than usual from now on"
            )
        elif self.degraded and not degraded:
            self._announcing.decide("restored", "detections", "the detections are as good as usual again")
        self.degraded = degraded
