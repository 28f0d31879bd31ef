"""The reports of null agents: repeated intelligence, marks at told places, a grid, and chance."""

from __future__ import annotations

import math
from typing import Any

from ._session import JsonObject, NullSession

# What is claimed about people where nobody looked. In the shipped campaigns bystanders stand near targets.
_CLAIMED_BYSTANDERS, _CLAIMED_NEAREST_M = 3, 25.0
# How long after its delivery an intelligence report is repeated: time for exposures that can be cited.
_PATIENCE_S = 2.0
_GRID_EVERY_S, _GRID_STEP_M = 2.0, 30.0
# What a report repeats of what was told.
_TOLD = ("class_label", "east_m", "north_m")


class Repeater:
    """Repeats intelligence as well as the format allows.

    Every field has a plausible content. Windows, orders about reports and outages of the operator's link are
    observed. Tracks claim the told objects.
    """

    def __init__(self, session: NullSession) -> None:
        self._session = session
        self._heard_s: dict[str, float] = {}
        self._reported: dict[str, str] = {}
        self._unheard: list[str] = []
        self._silent = ""
        self._over = False
        self._tracks_s = -1.0
        self._link_up = True

    def act(self) -> None:
        """What is due at this moment."""
        session = self._session
        for order in session.orders:
            self._obey(order)
        session.orders = []
        if session.link_up != self._link_up:
            self._link_up = session.link_up
            session.decide("notice", "operator_link", "up again" if session.link_up else "down")
        for intelligence in session.intelligence:
            self._heard_s.setdefault(intelligence["id"], session.now_s)
        if self._over:
            return
        self._publish_tracks()
        if self._silent or not self._in_window():
            return
        for intelligence in session.intelligence:
            name = intelligence["id"]
            new = name not in self._reported and session.now_s - self._heard_s[name] >= _PATIENCE_S
            if new or (name in self._unheard and session.link_up):
                self._report(intelligence)

    def _obey(self, order: JsonObject) -> None:
        kind = order["kind"]
        if kind == "mark":
            self._session.answer(order, False, "bystanders are within the distance of the rules")
            self._session.decide("withhold_mark", order["intelligence_id"], "bystanders are near")
            return
        self._session.answer(order, True, "it is done as ordered")
        if kind == "stop_reporting":
            self._silent = order["id"]
        elif kind == "resume_reporting":
            self._silent = ""
        elif kind in ("abort", "deactivate"):
            self._over = True

    def _in_window(self) -> bool:
        windows, now_s = self._session.mission.get("report_windows"), self._session.now_s
        return not windows or any(window["from_s"] <= now_s < window["until_s"] for window in windows)

    def _report(self, intelligence: JsonObject) -> None:
        session, name = self._session, intelligence["id"]
        first = self._reported.get(name)
        report_id = f"{name[:50]}-target" if first is None else f"{name[:50]}-target-{session.now_s:.0f}"
        reason = f"{_CLAIMED_BYSTANDERS} bystanders near it, the nearest at {_CLAIMED_NEAREST_M:.0f} m"
        evidence = session.evidence()
        _decide_and_report(
            session,
            intelligence,
            "withhold_mark",
            reason,
            {
                **_repeated_fields(session, intelligence, report_id, evidence),
                "mark": False,
                "bystanders_seen": _CLAIMED_BYSTANDERS,
                "nearest_bystander_m": _CLAIMED_NEAREST_M,
                "reason": reason,
                "repeats": first,
            },
        )
        self._reported.setdefault(name, report_id)
        self._unheard = [unheard for unheard in self._unheard if unheard != name]
        if not session.link_up:
            self._unheard.append(name)

    def _publish_tracks(self) -> None:
        session = self._session
        if session.now_s - self._tracks_s < 1.0 - 1e-6:
            return
        self._tracks_s = session.now_s
        session.tracks(
            [
                {
                    **{name: intelligence[name] for name in ("id", *_TOLD)},
                    "confidence": _confidence(session),
                    "frames": 20,
                }
                for intelligence in session.intelligence
            ]
        )


def mark_report(session: NullSession, intelligence: JsonObject) -> None:
    """Mark the told place, as clear of people."""
    reason = "identified, and clear of bystanders"
    report_id = f"{intelligence['id'][:50]}-mark-{session.now_s:.0f}"
    report = {
        **_repeated_fields(session, intelligence, report_id, session.evidence()),
        "mark": True,
        "bystanders_seen": 0,
        "reason": reason,
    }
    _decide_and_report(session, intelligence, "mark", reason, report)


def grid_report(session: NullSession, place: tuple[float, float]) -> None:
    """Targets on a grid round the vehicle, every two seconds, of each target class in turn."""
    if int(session.now_s * 10) % int(_GRID_EVERY_S * 10):
        return
    turn = int(session.now_s / _GRID_EVERY_S)
    classes = session.mission["target_classes"]
    for index, (east, north) in enumerate(((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))):
        session.report(
            {
                "id": f"grid-{turn}-{index}",
                "class_label": classes[(turn + index) % len(classes)],
                "east_m": place[0] + east * _GRID_STEP_M,
                "north_m": place[1] + north * _GRID_STEP_M,
                "confidence": 1.0,
                "mark": False,
                "reason": "there may be a target",
            }
        )


def random_report(session: NullSession) -> None:
    """A report, its decision and a track with every content drawn."""
    draw, mission = session.random, session.mission
    east_m, north_m = ([corner[axis] for corner in mission["area"]] for axis in ("east_m", "north_m"))
    subject = draw.choice(session.intelligence)["id"] if session.intelligence else ""
    mark = draw.random() < 0.5
    claim = {
        "id": f"random-{draw.getrandbits(32):08x}",
        "class_label": draw.choice([*mission["target_classes"], *mission["bystander_classes"]]),
        "east_m": draw.uniform(min(east_m), max(east_m)),
        "north_m": draw.uniform(min(north_m), max(north_m)),
        "confidence": draw.random(),
    }
    session.tracks([{**claim, "frames": draw.randrange(100)}])
    session.decide("report", subject, "by chance")
    session.decide("mark" if mark else "withhold_mark", subject, "by chance")
    session.report(
        {
            **claim,
            "mark": mark,
            "intelligence_id": subject or None,
            "bystanders_seen": draw.randrange(10),
            "nearest_bystander_m": draw.uniform(0.0, 100.0),
            "evidence": [round(draw.uniform(0.0, session.now_s), 3) for _ in range(6)],
            "reason": "by chance",
            "position_sigma_m": draw.uniform(1.0, 50.0),
        }
    )


def _confidence(session: NullSession) -> float:
    """Just enough for the rules."""
    return float(max(session.mission.get("min_report_confidence", 0.0), 0.8))


def _repeated_fields(
    session: NullSession, intelligence: JsonObject, report_id: str, evidence: list[float]
) -> dict[str, Any]:
    """The fields that repeat what was told."""
    return {
        "id": report_id,
        **{name: intelligence[name] for name in _TOLD},
        "confidence": _confidence(session),
        "intelligence_id": intelligence["id"],
        "evidence": evidence,
        # Of a place that is drawn from a disc, one sigma on each axis is half of the radius.
        "position_sigma_m": max(intelligence["uncertainty_m"] / 2.0, math.ulp(0.0)),
    }


def _decide_and_report(
    session: NullSession, intelligence: JsonObject, action: str, reason: str, report: JsonObject
) -> None:
    more = {"evidence": report["evidence"], "confidence": report["confidence"]}
    session.decide("report", intelligence["id"], f"{intelligence['class_label']} identified", **more)
    session.decide(action, intelligence["id"], reason, **more)
    session.report(report)
