"""What has been found for each task: its candidates, when one is identified, and when it is reported."""

from __future__ import annotations

from dataclasses import replace

from bench.contracts import MissionOrder

from .._log import Log
from .._orders import Orders
from .._settings import Settings
from .._watch import Watch
from ..perception._perception import ObjectPerception
from ..perception._tracks import Track
from ._consents import Consents
from ._planner import Planner, SearchTask
from ._policy import Judgement, Policy, missing_for
from ._reports import Reports

# Of the votes: an object that may be the target is worth a closer look. Chosen, not measured.
CANDIDATE_SHARE = 0.25

# One frame may be a false detection. Chosen, not measured.
CANDIDATE_FRAMES = 2

# Before a report falls due, what is known has to do. Chosen, not measured.
DEADLINE_S = 15.0

# Half of what is asked for otherwise (Settings.min_frames), for want of time. Chosen, not measured.
DEADLINE_FRAMES = 3


# Weighing a granted mark looks at every track near the target. Chosen, not measured.
WEIGHED_EVERY_S = 1.0


class Findings:
    """Turns tracks into reports, task by task. What may not be reported yet is kept until it may."""

    deadline_margin_s = DEADLINE_S

    def __init__(
        self,
        order: MissionOrder,
        policy: Policy,
        planner: Planner,
        perception: ObjectPerception,
        log: Log,
        watch: Watch,
        orders: Orders,
        settings: Settings,
    ) -> None:
        self.policy = policy
        self.reports = Reports(log, order, orders, watch)
        self.consents = Consents(log, order, watch)
        self._order = order
        self._planner = planner
        self._perception = perception
        self._log = log
        self._watch = watch
        self._orders = orders
        self._settings = settings
        self._weighed_s = 0.0  # when granted marks were last weighed
        self._verdicts: dict[str, str] = {}  # the latest reason of the policy, by task

    # Called by the clock.

    def update(self) -> None:
        """After a frame: report the target of every task that is searched for and identified, once the policy is
        content.

        A search that was broken off may have found its target by then: flying back for a report would keep the others
        waiting. Nothing is marked from afar, though, for nobody sees who has come near since; and where the operator
        ordered a search, it is flown.
        """
        for task in self._planner.tasks.values():
            broken_off = task.state == "waiting" and task.passes > 0 and not task.ordered
            if not (task.active or broken_off):
                continue
            if (candidate := self.candidate(task)) and not self.missing(candidate, task):
                judgement = self.judge(candidate)
                self._verdicts[task.id] = judgement.reason
                if not (judgement.look or (broken_off and judgement.mark)):
                    self.settle(task, candidate, judgement)

    def send_reports(self) -> None:
        """At every moment: report what falls due, what may be reported by now, and what went unheard."""
        if self._orders.silenced_for_good:
            return
        # A detector that is silent shows nothing of who has come near since: a report would be a guess.
        if self._order.report_deadline_s is not None and not self._watch.blind:
            self._meet_deadlines(self._order.report_deadline_s)
        for task in self.unsaid():
            target = self.target_of(task)
            if target is None:
                self._drop(task)
            elif not self.reports.closed(self._log.now_s):
                reason = (
                    "not said before"
                    if task.state == "found"
                    else "said again: the operator could not hear it"
                )
                self.report(task, target, self.judge(target), why=reason)
        if not self.reports.closed(self._log.now_s):
            self._ask_and_mark()

    def _ask_and_mark(self) -> None:
        """Ask the operator about what was reported unmarked, and mark what was granted since."""
        self.consents.expire()
        weigh = self._log.now_s - self._weighed_s >= WEIGHED_EVERY_S
        if weigh:
            self._weighed_s = self._log.now_s
        for task in self._planner.tasks.values():
            if task.state != "reported" or not task.withheld:
                continue
            if self.consents.wants_asking(task):
                if target := self.target_of(task):
                    self.consents.ask(task, target, self.judge(target))
            # A grant that has come while the agent looks elsewhere is used if it still knows the surroundings.
            elif weigh and not self._watch.blind and self.consents.granted(task):
                target = self.target_of(task)
                if target is not None and (judgement := self.judge(target)).mark:
                    self.report(task, target, judgement, why="the operator consents")

    def unsaid(self) -> list[SearchTask]:
        """Tasks found while no report was allowed, and tasks reported while the operator could not hear."""
        unheard = self.reports.unheard if self._watch.link_up else []
        return [task for task in self._planner.tasks.values() if task.state == "found" or task.id in unheard]

    def _drop(self, task: SearchTask) -> None:
        """People who walked off before they could be reported are not reported as being there."""
        self.reports.forget(task.id)
        if task.state == "found":
            task.state = "not_found"
        self._log.decide("drop", task.id, "what was found is not there any more")

    def _meet_deadlines(self, deadline_s: float) -> None:
        """Report what is known well enough when a report falls due."""
        for task in self._planner.tasks.values():
            left_s = task.told_s + deadline_s - self._log.now_s
            if not 0.0 < left_s <= self.deadline_margin_s or task.state in ("reported", "found"):
                continue
            if (candidate := self.candidate(task)) and self._good_enough(candidate, task):
                judgement = self.judge(candidate)
                self.settle(task, candidate, judgement, why=f"the report is due in {left_s:.0f} s")

    def _good_enough(self, candidate: Track, task: SearchTask) -> bool:
        sure = candidate.confidence >= self._order.min_report_confidence
        return (
            sure and candidate.label == task.intelligence.class_label and candidate.frames >= DEADLINE_FRAMES
        )

    # Candidates and judgements.

    def candidate(self, task: SearchTask) -> Track | None:
        """The track most likely to be what the intelligence speaks of; None where there is none."""
        about = task.intelligence
        within_m = about.uncertainty_m + self._settings.search_margin_m
        # A track that was reported for one task, or dismissed here, is not the target of another.
        taken = {other.target for other in self._planner.tasks.values()} | task.dismissed
        candidates = [
            (-track.share(about.class_label) * track.confidence, track.number, track)
            for _, track in self._perception.tracks.within(*task.place, within_m)
            if track.number not in taken
            and track.frames >= CANDIDATE_FRAMES
            and track.share(about.class_label) >= CANDIDATE_SHARE
        ]
        return min(candidates)[2] if candidates else None

    def missing(self, candidate: Track, task: SearchTask) -> str:
        """What is missing before the candidate counts as identified, in words; empty when nothing is."""
        return missing_for(candidate, task.intelligence.class_label, self._order, self._settings)

    def verdict(self, task: SearchTask) -> str:
        """Why the policy is not content with the identified target of a task."""
        return self._verdicts.get(task.id, "look round it")

    def judge(self, target: Track) -> Judgement:
        """The policy's judgement of an identified target at this moment."""
        return self.policy.judge(
            target, self._perception.tracks, self._log.now_s, self._perception.unseen_share
        )

    def target_of(self, task: SearchTask) -> Track | None:
        """What was reported for a task, or would be: an identified candidate. None where there is neither."""
        if task.target is not None:
            return next((track for track in self._perception.tracks if track.number == task.target), None)
        candidate = self.candidate(task)
        return candidate if candidate is not None and not self.missing(candidate, task) else None

    # Reports.

    def settle(self, task: SearchTask, target: Track, judgement: Judgement, why: str = "") -> None:
        """Report the target of a task, or keep it until that is allowed."""
        if closed := self.reports.closed(self._log.now_s):
            task.state, task.target = "found", target.number
            self._log.decide("keep", task.id, f"{target.label} identified, and not reported: {closed}")
        else:
            self.report(task, target, judgement, why=why)

    def report(self, task: SearchTask, target: Track, judgement: Judgement, why: str = "") -> None:
        """Report a target now, marked if that was judged right and the operator consents where it must."""
        if self.consents.wants_asking(task):
            self.consents.ask(task, target, judgement)
        if judgement.mark and (against := self.consents.against_marking(task)):
            judgement = replace(judgement, mark=False, reason=f"{judgement.reason}; {against}")
        task.state, task.target, task.withheld = "reported", target.number, not judgement.mark
        sigma_m = self.policy.sigma_m(target)
        self.reports.publish(task.id, target, judgement, sigma_m, heard=self._watch.link_up, why=why)
