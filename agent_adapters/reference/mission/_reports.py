"""Saying what was found: when it may be said, under which id, and what must be said again."""

from __future__ import annotations

from bench.contracts import MissionOrder, TargetReport

from .._log import Log
from .._orders import Orders
from .._watch import Watch
from ..perception._tracks import Track
from ._policy import Judgement

# While perception is worse than usual a report states less confidence and a larger error. Chosen.
DEGRADED_CONFIDENCE, DEGRADED_SIGMA = 0.8, 1.5


class Reports:
    """Every report that was made.

    One that the operator could not hear is remembered until it has been said again.
    """

    def __init__(self, log: Log, order: MissionOrder, orders: Orders, watch: Watch) -> None:
        self.unheard: list[str] = []  # subjects, oldest first
        self._log = log
        self._windows = order.report_windows
        self._orders = orders
        self._watch = watch
        self._min_confidence = order.min_report_confidence
        self._first: dict[str, str] = {}  # id of the first report, by subject
        self._counts: dict[str, int] = {}

    def closed(self, now_s: float) -> str:
        """Why nothing may be reported at this moment; empty when it may."""
        if reason := self._orders.silenced:
            return reason
        if self._windows and not any(window.from_s <= now_s < window.until_s for window in self._windows):
            later = [window.from_s for window in self._windows if window.from_s > now_s]
            return (
                f"reports are allowed again from {min(later):g} s"
                if later
                else "no report is allowed any more"
            )
        return ""

    def opens(self, now_s: float, until_s: float) -> bool:
        """Whether a report may be allowed up to `until_s`: an order to go on may come at any time."""
        if self._orders.silenced_for_good:
            # An order to abort or to deactivate is never taken back, other than one to stop reporting.
            return False
        return not self._windows or any(
            window.until_s > now_s and window.from_s < until_s for window in self._windows
        )

    def forget(self, subject: str) -> None:
        """It need not be said again."""
        self.unheard = [unheard for unheard in self.unheard if unheard != subject]

    def publish(
        self,
        subject: str,
        target: Track,
        judgement: Judgement,
        sigma_m: float | None,
        *,
        heard: bool,
        why: str = "",
    ) -> TargetReport:
        """Report a target, with the decisions behind it.

        What is said twice has an id of its own and names the first.
        """
        number = self._counts[subject] = self._counts.get(subject, 0) + 1
        # The id of a TargetReport has at most 64 characters: 54, `-target`, and two digits with their hyphen.
        report_id = f"{subject[:54]}-target" + (f"-{number}" if number > 1 else "")
        evidence = target.evidence
        confidence = round(target.confidence, 4)
        if self._watch.degraded:
            # Never below what the rules ask for: the track has passed that with its own confidence.
            confidence = max(
                round(confidence * DEGRADED_CONFIDENCE, 4), min(confidence, self._min_confidence)
            )
            sigma_m = None if sigma_m is None else sigma_m * DEGRADED_SIGMA
            why = "; ".join(filter(None, [why, "perception is worse than usual"]))
        sightings = (
            f"{target.confidence:.2f} from {target.frames} frames over {target.viewpoint_deg:.0f} degrees"
        )
        because = f"{target.label} identified: {sightings}" + (f"; {why}" if why else "")
        self._log.decide("report", subject, because, evidence=evidence, confidence=confidence)
        action = "mark" if judgement.mark else "withhold_mark"
        self._log.decide(action, subject, judgement.reason, evidence=evidence, confidence=confidence)
        report = TargetReport(
            id=report_id,
            time_s=self._log.now_s,
            class_label=target.label,
            east_m=round(target.east_m, 2),
            north_m=round(target.north_m, 2),
            confidence=confidence,
            mark=judgement.mark,
            intelligence_id=subject,
            bystanders_seen=judgement.bystanders_seen,
            nearest_bystander_m=judgement.nearest_bystander_m,
            evidence=evidence,
            reason=judgement.reason,
            people_expected=judgement.people_expected,
            position_sigma_m=None if sigma_m is None else round(sigma_m, 2),
            repeats=self._first.get(subject),
        )
        self._first.setdefault(subject, report_id)
        self.forget(subject)
        if not heard:
            self.unheard.append(subject)
        self._log.report(report)
        return report
