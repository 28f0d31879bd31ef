"""Announcements of faults and outages, from the schedule of the situation."""

from __future__ import annotations

from ..reference._log import Log
from ..reference._watch import Watch
from ..reference.flight._piloted_vehicle import PilotedVehicle
from ._perception import TruthPerception

# Degraded detections are announced by `degraded` and `restored` alone.
_ANNOUNCED = ("operator_link", "detections")


class OracleWatch(Watch):
    """Announces each fault and each outage of the situation as it begins and as it ends."""

    def __init__(self, vehicle: PilotedVehicle, eyes: TruthPerception, log: Log) -> None:
        super().__init__(vehicle, eyes, log)
        self._outages = eyes.truth.simspec.outages
        # A decision names a fault by the first word of its kind (docs/measures.md): gps, battery, motor, link.
        faults = [
            (f.at_s, f.duration_s, f.kind.partition("_")[0]) for f in eyes.truth.simspec.vehicle.failures
        ]
        outages = [(o.at_s, o.duration_s, o.kind) for o in self._outages if o.kind in _ANNOUNCED]
        announced = [*faults, *outages]
        begun = [(at_s, word, f"the situation says that {word} fails now") for at_s, _, word in announced]
        over = [
            (at_s + span_s, word, f"the situation says that {word} works again")
            for at_s, span_s, word in announced
            if span_s
        ]
        self._due = sorted([*begun, *over])

    def update(self) -> None:
        super().update()
        while self._due and self._due[0][0] <= self._log.now_s + 1e-6:
            super()._notice(*self._due.pop(0)[1:])

    def _notice(self, subject: str, reason: str) -> None:
        """Nothing that it notices: the schedule says it."""

    def _perception_flaw(self) -> str:
        now_s = self._log.now_s + 1e-6
        worse = any(
            outage.at_s <= now_s < outage.at_s + outage.duration_s
            for outage in self._outages
            if outage.kind in ("detections", "detections_degraded")
        )
        return "so the situation says" if worse else ""
