"""What around the agent works and what has failed: operator's link, detections, GPS, battery, autopilot.

Says each change once.
"""

from __future__ import annotations

import math

from bench.contracts import OperatorLinkDocument

from ._log import Log
from .flight._piloted_vehicle import PilotedVehicle
from .perception._perception import ObjectPerception

# Several frames at the rates that cameras have: one late frame is not blindness. Chosen, not measured.
BLIND_S = 1.6
# Of the charge, lost between two messages: PX4 states whole percent, and flying costs less than one between
# two. Chosen, not measured.
DROP = 0.07
# After GPS is back, places are trusted as before: the estimator needs a while to converge. Chosen.
GPS_AGAIN_S = 10.0
# How fast a place becomes wrong without GPS. Chosen, not measured.
DEAD_RECKONING_MPS = 0.6


class Watch:
    """Looks at everything once a moment.

    A decision with the failed thing's name as its subject says what it means.
    """

    def __init__(self, vehicle: PilotedVehicle, eyes: ObjectPerception, log: Log) -> None:
        self.blind = False
        self.degraded = False  # perception is worse than usual, and the operator was told
        self.charge_lost = 0.0  # by sudden drops, not by flying
        self.link_down_s: float | None = None  # since when the operator cannot be reached
        self._vehicle = vehicle
        self._eyes = eyes
        self._log = log
        self._gps_lost_s: float | None = None
        self._gps_back_s = -math.inf
        self._gps_doubt_m = 0.0
        self._drifting = False
        self._drift_doubt_m = 0.0  # the latest while it drifted
        self._drift_over_s = -math.inf
        self._silent = False
        self._battery: float | None = None  # the charge as last heard; None before the first time

    @property
    def link_up(self) -> bool:
        return self.link_down_s is None

    def operator_link(self, link: OperatorLinkDocument) -> None:
        """The bench says whether the operator can be reached."""
        now_s = self._log.now_s
        if link.up and self.link_down_s is not None:
            self._notice(
                "operator_link",
                f"the operator's link is back after {now_s - self.link_down_s:.1f} s",
            )
            self.link_down_s = None
        elif not link.up and self.link_down_s is None:
            self._notice("operator_link", "the operator's link is down: reports will be said again")
            self.link_down_s = now_s

    def link_down_for_s(self, now_s: float) -> float:
        return 0.0 if self.link_down_s is None else now_s - self.link_down_s

    def _notice(self, subject: str, reason: str) -> None:
        self._log.decide("notice", subject, reason)

    def update(self) -> None:
        """Notice what has changed since the moment before."""
        self._look_at_detections()
        self._look_at_quality()
        self._look_at_gps()
        self._look_at_drift()
        self._look_at_battery()
        heard_ever = self._vehicle.heard_s >= 0.0
        if heard_ever and self._vehicle.silent != self._silent:
            self._silent = not self._silent
            what = "the autopilot has fallen silent" if self._silent else "the autopilot is heard again"
            self._notice("link", what)

    def doubt_m(self) -> float:
        """One sigma that GPS trouble adds to a place that is found now; 0 when all is well."""
        now_s = self._log.now_s
        if self._gps_lost_s is not None:
            return 2.0 + DEAD_RECKONING_MPS * (now_s - self._gps_lost_s)
        lately_m = [
            doubt_m
            for doubt_m, over_s in (
                (self._gps_doubt_m, self._gps_back_s),
                (self._drift_doubt_m, self._drift_over_s),
            )
            if now_s - over_s < GPS_AGAIN_S
        ]
        return max([self._vehicle.drift.doubt_m, *lately_m])

    def _look_at_detections(self) -> None:
        eyes, vehicle = self._eyes, self._vehicle
        quiet_s = self._log.now_s - eyes.heard_s
        blind = quiet_s > BLIND_S and vehicle.armed and not vehicle.landed and not vehicle.silent
        if blind and not self.blind:
            self._notice(
                "detections",
                f"no detections for {quiet_s:.1f} s: nothing new can be found or ruled out",
            )
        elif self.blind and not blind:
            self._notice("detections", "detections come again")
        self.blind = blind

    def _look_at_quality(self) -> None:
        """Tell the operator when perception is worse than usual, and when it is good again."""
        flaw = self._perception_flaw()
        if flaw and not self.degraded:
            self._log.decide("degraded", "detections", f"perception is worse than usual: {flaw}")
        elif self.degraded and not flaw:
            self._log.decide("restored", "detections", "perception is as good as usual again")
        self.degraded = bool(flaw)

    def _perception_flaw(self) -> str:
        """Why perception is worse than usual; empty when it is not."""
        quality = self._eyes.quality
        if self.blind:
            return "no detections come"
        if not quality.degraded:
            return ""
        return f"the best scores fell from {quality.usual or 0.0:.2f} to {quality.best:.2f}"

    def _look_at_gps(self) -> None:
        now_s = self._log.now_s
        if self._vehicle.gps_ok is False and self._gps_lost_s is None:
            self._gps_lost_s = now_s
            self._notice("gps", "no GPS fix: places become uncertain, the autopilot may land")
        elif self._vehicle.gps_ok and self._gps_lost_s is not None:
            self._gps_doubt_m, self._gps_back_s = self.doubt_m(), now_s
            self._notice("gps", f"GPS is back after {now_s - self._gps_lost_s:.1f} s")
            self._gps_lost_s = None

    def _look_at_drift(self) -> None:
        drift = self._vehicle.drift
        if drift.since_s is not None:
            self._drift_doubt_m = drift.doubt_m
        if (drift.since_s is not None) == self._drifting:
            return
        self._drifting = not self._drifting
        if self._drifting:
            text = f"the position drifts, {math.hypot(*drift.offset_en_m):.1f} m so far: places are reckoned from the velocity"
        else:
            self._drift_over_s = self._log.now_s
            text = "the position agrees with the velocity again"
        self._notice("gps", text)

    def _look_at_battery(self) -> None:
        if not self._vehicle.battery_heard:
            return
        before, charge = self._battery, self._vehicle.battery_fraction
        self._battery = charge
        # A battery that was not full at the start has not dropped: its first charge is only news.
        if before is not None and before - charge >= DROP:
            self.charge_lost += before - charge
            self._notice("battery", f"the charge fell from {before:.0%} to {charge:.0%} at once")
