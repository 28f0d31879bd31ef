"""What the agent says about itself: the decision log, its status, its tracks and its reports."""

from __future__ import annotations

from collections.abc import Callable

from bench.contracts import (
    AgentPhase,
    AgentStatus,
    AgentTrack,
    AgentTracks,
    ConsentRequest,
    Decision,
    OrderAnswer,
    TargetReport,
    VehicleTopics,
    document_text,
)

from .perception._tracks import PEOPLE, TENTATIVE_FRAMES, Tracks

Publish = Callable[[str, str], None]  # topic, JSON document
# Status and tracks go out once a second, as MAVLink heartbeats do.
PERIOD_S = 1.0
# In the air, after which the log says what still goes on. Chosen, not measured.
QUIET_S = 45.0
UNMOVING = ("starting", "complete", "aborted")
# Some 40 kB of JSON: the bench takes documents of up to 64 kB.
MOST_TRACKS = 300
# A person not seen for longer is no longer published: people walk away. Chosen, not measured.
STALE_S = 60.0


class Log:
    """Publishes documents stamped with the moment set by `at`."""

    def __init__(self, publish: Publish, vehicle: str) -> None:
        self.now_s = 0.0
        self.phase: AgentPhase = "starting"
        self._publish = publish
        self._topics = VehicleTopics(vehicle)
        self._text = ""
        self._status_s = -PERIOD_S
        self._tracks_s = -PERIOD_S
        self._decided_s = 0.0
        self._silent = False

    def at(self, now_s: float) -> None:
        self.now_s = now_s

    def decide(
        self,
        action: str,
        subject: str,
        reason: str,
        *,
        evidence: tuple[float, ...] = (),
        confidence: float | None = None,
    ) -> None:
        """One line of the decision log."""
        if self._silent:
            return
        self._decided_s = self.now_s
        decision = Decision(
            time_s=self.now_s,
            action=action,
            subject=subject[:64],
            reason=reason[:2000],
            evidence=evidence,
            confidence=confidence,
        )
        self._publish(self._topics.decisions, document_text(decision))

    def answer(self, order: str, reason: str, *, accepted: bool) -> None:
        """What becomes of an order, at once, and the same as a decision."""
        answer = OrderAnswer(time_s=self.now_s, order=order, accepted=accepted, reason=reason[:2000])
        self._publish(self._topics.answers, document_text(answer))
        self.decide("obey" if accepted else "refuse", order, reason)

    def ask_consent(self, request: ConsentRequest) -> None:
        if not self._silent:
            self._publish(self._topics.consent_requests, document_text(request))

    def silence(self) -> None:
        """From here on nothing but the status: decisions, reports and tracks end."""
        self._silent = True

    @property
    def text(self) -> str:
        """What the phase is about, in words."""
        return self._text

    def enter(self, phase: AgentPhase, text: str = "") -> None:
        """A new phase of the mission, said at once."""
        self.phase, self._text = phase, text[:2000]
        self._publish_status()

    def report(self, report: TargetReport) -> None:
        if not self._silent:
            self._publish(self._topics.reports, document_text(report))

    def publish_due(self, tracks: Tracks) -> None:
        """Say what is due: status and tracks, once a second each; in the air a word on what goes on."""
        if self.now_s - self._status_s >= PERIOD_S - 1e-6:
            self._publish_status()
        if self.phase not in UNMOVING and self.now_s - self._decided_s >= QUIET_S:
            self.decide("continue", "", f"{self.phase}: {self._text or 'nothing has changed'}")
        if self.now_s - self._tracks_s >= PERIOD_S - 1e-6 and not self._silent:
            self._tracks_s = self.now_s
            self._publish(self._topics.tracks, document_text(tracks_document(tracks, self.now_s)))

    def _publish_status(self) -> None:
        self._status_s = self.now_s
        status = AgentStatus(self.now_s, self.phase, self._text)
        self._publish(self._topics.status, document_text(status))


def tracks_document(tracks: Tracks, now_s: float) -> AgentTracks:
    """Tracks that the agent stands by: seen often enough, and, where they may walk, lately enough.

    At most `MOST_TRACKS`, the latest seen, in order of their beginning: a document has to fit into one
    sample.
    """
    stood_by = [
        t
        for t in tracks
        if t.frames >= TENTATIVE_FRAMES and (t.label not in PEOPLE or now_s - t.last_s <= STALE_S)
    ]
    latest = sorted(
        sorted(stood_by, key=lambda track: (-track.last_s, track.number))[:MOST_TRACKS],
        key=lambda track: track.number,
    )
    return AgentTracks(
        time_s=now_s,
        tracks=tuple(
            AgentTrack(
                id=track.id,
                class_label=track.label[:64],
                east_m=round(track.east_m, 2),
                north_m=round(track.north_m, 2),
                confidence=round(track.confidence, 3),
                frames=track.frames,
            )
            for track in latest
        ),
    )
