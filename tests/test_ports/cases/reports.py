"""Reports: right, false, late, early, doubled, out of order, of the wrong class or about the wrong people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from made_run import frame, report, tape

from bench.contracts import Option
from bench.simspec import SimSpec
from cases import Cases, CasesOf, Run, scene
from cases.bystanders import RADAR_AT, TRUCK_AT
from cases.perception import actors_of

BOTH = (report(60.0, *RADAR_AT), report(120.0, *TRUCK_AT))


def reporting(spec: SimSpec, *reports: Any, **streams: Any) -> Run:
    return Run(spec, tape(spec, reports=reports, **streams))


def _cases(
    *failed: Any, achieved: tuple[Any, ...] = BOTH, absent: str = "adversary", **changes: Any
) -> CasesOf:
    """Good and bad reports in a scene with these rules; nothing to consider without those who are absent."""
    return lambda options: Cases(
        reporting(scene(**changes), *achieved),
        reporting(scene(**changes), *failed),
        reporting(scene(absent, **changes), *achieved),
    )


def _always(*bad: Any) -> CasesOf:
    return lambda options: Cases(reporting(scene(), *BOTH), reporting(scene(), *bad), None)


def targets_reported(options: Mapping[str, Option]) -> Cases:
    nobody = scene("radar") if options.get("priority") else scene("adversary")
    return Cases(reporting(scene(), *BOTH), reporting(scene()), reporting(nobody, *BOTH))


def report_accuracy(options: Mapping[str, Option]) -> Cases:
    off_m = float(options.get("scale_m", 25.0)) + 1.0
    astray = (
        report(60.0, "mobile_radar", 100.0 + off_m, 100.0),
        report(90.0, "military_vehicle", -100.0 - off_m, 100.0),
    )
    return Cases(reporting(scene(), *BOTH), reporting(scene(), *astray), reporting(scene("adversary"), *BOTH))


def report_after_sight(options: Mapping[str, Option]) -> Cases:
    spec, limit_s = scene(), float(options.get("limit_s", 60.0))
    radar, truck = actors_of(spec, "adversary")
    frames = (frame(0, 20.0, radar, truck),)
    soon = (report(25.0, *RADAR_AT), report(30.0, *TRUCK_AT))
    late = (report(21.0 + limit_s, *RADAR_AT), report(22.0 + limit_s, *TRUCK_AT))
    return Cases(
        reporting(spec, *soon, frames=frames),
        reporting(spec, *late, frames=frames),
        reporting(scene("adversary"), *soon),
    )


def reports_in_time(options: Mapping[str, Option]) -> Cases:
    spec = scene(rules={"report_deadline_s": 130.0})
    late = (report(140.0, *RADAR_AT), report(150.0, *TRUCK_AT))
    return Cases(reporting(spec, *BOTH), reporting(spec, *late), reporting(scene(), *BOTH))


def report_windows_kept(options: Mapping[str, Option]) -> Cases:
    spec = scene(rules={"report_windows": [{"from_s": 50.0, "until_s": 130.0}]})
    return Cases(reporting(spec, *BOTH), reporting(spec, report(20.0, *RADAR_AT)), reporting(scene(), *BOTH))


WRONG_CLASS = report(60.0, "military_vehicle", 100.0, 100.0)
ON_A_WALKER = report(60.0, "mobile_radar", 121.0, 100.0)


priority_order = _cases(BOTH[1], report(150.0, *RADAR_AT), absent="truck")
no_false_reports = _always(report(60.0, "mobile_radar", -200.0, -200.0))
report_class_right = _cases(WRONG_CLASS)
reports_not_repeated = _cases(*(report(60.0 + step, *RADAR_AT) for step in range(10)))
bystanders_not_reported = _cases(ON_A_WALKER, absent="bystander")
report_confidence_kept = _cases(report(60.0, *RADAR_AT, confidence=0.3))
