"""Asking the operator before a mark: what was asked, what was answered, and whether a mark may still be hoped for."""

from __future__ import annotations

from dataclasses import dataclass

from bench.contracts import ConsentAnswer, ConsentRequest, MissionOrder

from .._log import Log
from .._watch import Watch
from ..perception._tracks import Track
from ._planner import SearchTask
from ._policy import Judgement

# For so long the agent waits for an answer where it has nothing better to do. Chosen, not measured.
CONSENT_WAIT_S = 60.0


@dataclass(slots=True)
class _Inquiry:
    """One request and what became of it; `request` is its id."""

    request: str
    sent_s: float
    granted: bool | None = None  # None without an answer
    expired: bool = False


class Consents:
    """The requests by task. Without the rule, every mark is allowed and no request is made."""

    def __init__(self, log: Log, order: MissionOrder, watch: Watch) -> None:
        self._log = log
        self._watch = watch
        self._needed = order.mark_consent
        self._inquiries: dict[str, _Inquiry] = {}
        self._ordered: set[str] = set()

    def ordered(self, task: SearchTask) -> None:
        """The operator ordered to mark the target of a task, which is consent."""
        self._ordered.add(task.id)

    def against_marking(self, task: SearchTask) -> str:
        """Why the target of a task may not be marked now; empty when it may."""
        if not self._needed or task.id in self._ordered:
            return ""
        inquiry = self._inquiries.get(task.id)
        if inquiry is None:
            return "the operator has not been asked yet"
        if inquiry.granted is None:
            return f"the operator has not answered {inquiry.request}"
        return "" if inquiry.granted else f"the operator refuses {inquiry.request}"

    def granted(self, task: SearchTask) -> bool:
        """Whether the operator has granted a request about a task."""
        inquiry = self._inquiries.get(task.id)
        return inquiry is not None and inquiry.granted is True

    def awaited(self, task: SearchTask) -> bool:
        """Whether an answer about a task may still come in time."""
        inquiry = self._inquiries.get(task.id)
        return inquiry is not None and inquiry.granted is None and not inquiry.expired

    def hopeless(self, task: SearchTask) -> bool:
        """Whether no consent is to be waited for: refused, or without an answer for too long."""
        inquiry = self._inquiries.get(task.id)
        if not self.against_marking(task) or inquiry is None:
            return False
        return inquiry.granted is False or inquiry.expired

    def wants_asking(self, task: SearchTask) -> bool:
        """Whether to ask about a reported task now: once, and when the operator can hear it."""
        return (
            self._needed
            and task.id not in self._ordered
            and task.id not in self._inquiries
            and self._watch.link_up
        )

    def ask(self, task: SearchTask, target: Track, judgement: Judgement) -> None:
        """Ask whether the target of a task may be marked, and say what is known of it and of people near it."""
        request = ConsentRequest(
            # An id has at most 64 characters: 56 and `-consent`.
            id=f"{task.id[:56]}-consent",
            time_s=self._log.now_s,
            intelligence_id=task.id,
            class_label=target.label,
            east_m=round(target.east_m, 2),
            north_m=round(target.north_m, 2),
            confidence=round(target.confidence, 4),
            bystanders_seen=judgement.bystanders_seen,
            people_expected=judgement.people_expected,
            evidence=target.evidence,
            reason=judgement.reason,
        )
        self._inquiries[task.id] = _Inquiry(request.id, self._log.now_s)
        self._log.decide("ask_consent", task.id, f"whether {target.label} may be marked: {judgement.reason}")
        self._log.ask_consent(request)

    def take(self, answer: ConsentAnswer) -> None:
        """The operator's answer to a request; one about no request of this agent is left aside."""
        for task_id, inquiry in self._inquiries.items():
            if inquiry.request == answer.request:
                inquiry.granted = answer.granted
                if not answer.granted:
                    self._log.decide("withhold_mark", task_id, "the operator refuses")

    def expire(self) -> None:
        """Give up waiting for answers that are overdue: silence is no consent."""
        for task_id, inquiry in self._inquiries.items():
            overdue = inquiry.granted is None and self._log.now_s - inquiry.sent_s > CONSENT_WAIT_S
            if overdue and not inquiry.expired:
                inquiry.expired = True
                self._log.decide(
                    "withhold_mark", task_id, f"no answer within {CONSENT_WAIT_S:g} s is no consent"
                )
