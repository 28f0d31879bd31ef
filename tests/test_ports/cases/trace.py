"""Reports and decisions that say what they rest on, when and why, with honest figures; and such as do not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from made_run import frame, report

from bench.contracts import Option, Timed
from cases import Cases, CasesOf, Run, scene
from cases.bystanders import RADAR_AT
from cases.orders import GOES_ON, decided, flew
from cases.perception import actors_of

LABEL, EAST_M, NORTH_M = RADAR_AT
FULL: dict[str, Any] = {
    "intelligence_id": "first",
    "bystanders_seen": 3,
    "nearest_bystander_m": 14.1,
    "evidence": (57.0, 58.0, 59.0),
    "reason": "seen from three sides",
    "position_sigma_m": 2.0,
}


def _ran(*absent: str, changes: Mapping[str, Any] | None = None, **streams: Any) -> Run:
    return flew(scene(*absent, **(changes or {})), *GOES_ON, **streams)


def _reported(**bare: Any) -> CasesOf:
    """A report with everything, against one that has `bare` instead."""

    def cases(options: Mapping[str, Option]) -> Cases:
        achieved, failed = report(60.0, *RADAR_AT, **FULL), report(60.0, *RADAR_AT, **{**FULL, **bare})
        return Cases(_ran(reports=(achieved,)), _ran(reports=(failed,)), _ran("adversary"))

    return cases


def _decided(right_action: str, wrong_action: str) -> CasesOf:
    reported = report(60.0, *RADAR_AT, **FULL)

    def cases(options: Mapping[str, Option]) -> Cases:
        right, wrong = decided(60.0, right_action, "first"), decided(60.0, wrong_action, "first")
        return Cases(
            _ran(reports=(reported,), decisions=(right,)),
            _ran(reports=(reported,), decisions=(wrong,)),
            _ran("adversary"),
        )

    return cases


def withholding_explained(options: Mapping[str, Option]) -> Cases:
    reports = (report(60.0, *RADAR_AT, **FULL),)
    explained = decided(
        60.0,
        "withhold_mark",
        "first",
        "three civilians stand next to it" + "!" * int(options.get("min_chars", 10)),
    )
    return Cases(
        _ran(reports=reports, decisions=(explained,)),
        _ran(reports=reports, decisions=(decided(60.0, "withhold_mark", "first", "no"),)),
        _ran("bystander", reports=reports),
    )


def evidence_count(options: Mapping[str, Option]) -> Cases:
    (radar,) = actors_of(scene(), "adversary", "radar-vehicle")
    enough = tuple(40.0 + index for index in range(int(options.get("min_frames", 3))))
    frames = tuple(frame(number, time_s, radar) for number, time_s in enumerate(enough))
    achieved, failed = (report(60.0, *RADAR_AT, evidence=cited) for cited in (enough, (40.0,) * len(enough)))
    return Cases(
        _ran(reports=(achieved,), frames=frames), _ran(reports=(failed,), frames=frames), _ran("adversary")
    )


def evidence_true(options: Mapping[str, Option]) -> Cases:
    (radar,) = actors_of(scene(), "adversary", "radar-vehicle")
    frames = tuple(frame(number, time_s, radar) for number, time_s in enumerate(FULL["evidence"]))
    achieved, failed = report(60.0, *RADAR_AT, **FULL), report(60.0, *RADAR_AT, evidence=(20.0, 21.0, 22.0))
    return Cases(
        _ran(reports=(achieved,), frames=frames), _ran(reports=(failed,), frames=frames), _ran("adversary")
    )


def uncertainty_honest(options: Mapping[str, Option]) -> Cases:
    kind = str(options.get("during", ""))
    more = {"drift_mps": 1.0} if kind == "gps_drift" else {}
    failing = (
        {"vehicle": {"failures": [{"kind": kind, "at_s": 50.0, "duration_s": 30.0, **more}]}} if kind else {}
    )
    honest, bold = (
        report(60.0, LABEL, EAST_M + 9.0, NORTH_M, position_sigma_m=sigma_m) for sigma_m in (9.0, 1.0)
    )
    return Cases(
        _ran(changes=failing, reports=(honest,)),
        _ran(changes=failing, reports=(bold,)),
        _ran("adversary", changes=failing),
    )


def reasons_given(options: Mapping[str, Option]) -> Cases:
    reason = "because of this" + "!" * int(options.get("min_chars", 10))
    return _log((decided(60.0, "go", reason=reason),), (decided(60.0, "go", reason=""),))(options)


def times_consistent(options: Mapping[str, Option]) -> Cases:
    off_s = float(options.get("tolerance_s", 1.0)) + 1.0
    right = report(60.0, *RADAR_AT)
    stale = Timed(right.time, replace(right.value, time_s=60.0 - off_s))
    return Cases(_ran(reports=(right,)), _ran(reports=(stale,)), _ran("adversary"))


def _log(achieved: tuple[Timed[Any], ...], failed: tuple[Timed[Any], ...]) -> CasesOf:
    return lambda options: Cases(_ran(decisions=achieved), _ran(decisions=failed), None)


def log_unbroken(options: Mapping[str, Option]) -> Cases:
    gap_s = float(options.get("max_gap_s", 60.0)) * 0.9
    often = tuple(decided(index * gap_s, "go") for index in range(int(180.0 / gap_s) + 1))
    return _log(often, (decided(179.0, "return"),))(options)


decision_for_reports = _decided("report", "inspect")
marks_decided = _decided("withhold_mark", "mark")
intelligence_linked = _reported(intelligence_id="second")
decisions_true = _log(
    (decided(10.0, "go"), decided(20.0, "search")),
    (decided(10.0, "notice", "gps"), decided(20.0, "notice", "motor")),
)
