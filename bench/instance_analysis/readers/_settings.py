"""Reads the mission, the rules and the vehicle: forms that set fields to numbers."""

from __future__ import annotations

from typing import Any

from bench.simspec import Mission, Role, Rules

from .._draft import Draft, FieldPath
from ..language._grammar import Part
from ..language._quantities import Quantity
from ..language._tokens import Span
from ._groups import IMMOVABLE
from ._not_read import NotReadError
from ._scene import Scene

UNITS = {"LENGTH": "m", "TIME": "s", "SPEED": "m/s", "ANGLE": "deg"}
NO_MARK_CHOICES_M = (50.0, 20.0, 100.0)
"""Distances that are offered for `near`. The first is the default of the SimSpec."""


def put_fields(draft: Draft, base: FieldPath, part: Part) -> None:
    """Set the fields of a form, under a base, to its values or to what its slots hold; one that holds nothing sets none."""
    for path, value in part.form.sets.items():
        where: FieldPath = (*base, *path.split("."))
        stated: Any = part.first(value[1:]) if isinstance(value, str) and value.startswith("$") else value
        if isinstance(stated, Quantity):
            low = stated.low % 360 if stated.kind == "ANGLE" else stated.low
            draft.vary(where, low, stated.high, part.span, unit=UNITS.get(stated.kind))
        elif where[0] == "seeds":
            draft.vary(where, stated, stated, part.span, unit=None, integer=True)
        elif stated is not None:
            draft.put(where, float(stated) if type(stated) is int else stated, part.span)


class SettingsReader:
    """Reads settings into a draft; each form by the method that `does` names, or by its `sets`."""

    def __init__(self, draft: Draft, scene: Scene) -> None:
        self._draft, self._scene = draft, scene
        self._windows: list[tuple[float, float, Span]] = []
        self._silences: list[tuple[float, float, Span]] = []

    def sets(self, part: Part) -> None:
        put_fields(self._draft, (), part)

    def height_band(self, part: Part) -> None:
        """Read the heights between which the drone stays."""
        band = part.first("band")
        if band.single:
            raise NotReadError("a height to stay at is that of the mission: `Fly at 80 m`")
        self._draft.put(("rules", "min_altitude_m"), band.low, part.span)
        self._draft.put(("rules", "max_altitude_m"), band.high, part.span)

    def no_mark_near(self, part: Part) -> None:
        """Read a ban on marking near people whose distance the text leaves open."""
        readings = [f"within {choice:g} m" for choice in NO_MARK_CHOICES_M]
        chosen = self._draft.ask(part.span, "how near is `near`?", readings)
        self._draft.put(("rules", "no_mark_within_m"), NO_MARK_CHOICES_M[chosen], part.span)

    def report_windows(self, part: Part) -> None:
        """Read when reports are allowed or forbidden."""
        for begin, end in zip(part.all("from"), part.all("until"), strict=True):
            self._windows.append((begin, end, part.span))
        for begin, end in zip(part.all("closed"), part.all("reopened"), strict=True):
            self._silences.append((begin, end, part.span))
        self._draft.acknowledge(part.span)

    def escort(self, part: Part) -> None:
        """Read whom the drone escorts, how near it stays, and how early it warns."""
        group = self._scene.single_group(part.first("group"))
        if self._scene.asset(group) in IMMOVABLE or self._scene.role(group) in (Role.ADVERSARY, Role.SOUGHT):
            raise NotReadError("an escort is of one group that moves and is no target")
        base: FieldPath = ("mission", "escort")
        self._draft.put((*base, "group"), group, part.span)
        if (length := part.first("length")) is not None:
            self._draft.put((*base, "within_m"), length.high, part.span)
        if (length := part.first("warn")) is not None:
            self._draft.put((*base, "warn_before_m"), length.high, part.span)

    # At the end.

    def finish(self) -> None:
        """Put what depends on several sentences: windows of reports, the ceiling, the role of the escorted."""
        self._put_windows()
        self._ceiling()
        escorted = self._draft.entries.get(("mission", "escort", "group"))
        if (
            escorted is not None
            and self._scene.role(escorted.value) is Role.CLUTTER
            and escorted.span is not None
        ):
            self._scene.set_role(escorted.value, Role.BYSTANDER, escorted.span)
        if (
            escorted is not None
            and ("actors", escorted.value, "motion", "pause_s") not in self._draft.entries
        ):
            path: FieldPath = ("actors", escorted.value, "motion", "pause_s")
            self._draft.put(path, 0.0, None, "an escorted group does not rest")

    def _put_windows(self) -> None:
        end = self._draft.entries.get(("mission", "time_limit_s"))
        limit = float(end.value) if end else Mission().time_limit_s
        windows = sorted(self._windows, key=lambda window: window[:2])
        for low, high, span in self._silences:
            # Without stated windows reports are allowed all the time, so a silence cuts a hole into the whole mission.
            windows = [
                part
                for window in windows or [(0.0, limit, span)]
                for part in _without(window, low, high, span)
            ]
        for number, (low, high, span) in enumerate(windows):
            self._draft.put(("rules", "report_windows", number, "from_s"), low, span)
            self._draft.put(("rules", "report_windows", number, "until_s"), high, span)

    def _ceiling(self) -> None:
        height = self._draft.entries.get(("mission", "altitude_m"))
        if height is None or height.span is None or ("rules", "max_altitude_m") in self._draft.entries:
            return
        highs = [varied.high for varied in self._draft.ranges if "mission.altitude_m" in varied.paths]
        # A range of heights must stay below the ceiling at its upper end too.
        top = max([height.value, *(varied for varied in highs if varied is not None)])
        usual = Rules().max_altitude_m
        if top <= usual:
            return
        readings = [
            f"rules.max_altitude_m = {top:g}",
            f"keep the ceiling of {usual:g} m, and the mission at it",
        ]
        question = f"it is above the ceiling of {usual:g} m that rules have by default"
        if self._draft.ask(height.span, question, readings) == 0:
            self._draft.put(("rules", "max_altitude_m"), top, height.span)
        else:
            self._draft.forget(("mission", "altitude_m"))
            self._draft.put(("mission", "altitude_m"), usual, height.span)


def _without(
    window: tuple[float, float, Span], low: float, high: float, span: Span
) -> list[tuple[float, float, Span]]:
    """The parts of a time window that remain outside another one."""
    begin, end, _ = window
    if high <= begin or low >= end:
        return [window]
    parts = [(begin, min(low, end)), (max(high, begin), end)]
    return [(a, b, span) for a, b in parts if a < b]
