"""Reads properties of one group: motion, density, concealment."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Protocol

from bench.simspec import ASSETS

from .._draft import Draft, FieldPath
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ..language._vocabulary import MotionWords

DIRECTIONS = {"north": 0.0, "east": 90.0, "south": 180.0, "west": 270.0}


def _assets_of_class(*labels: str) -> frozenset[str]:
    return frozenset(name for name, asset in ASSETS.items() if asset.class_label in labels)


PERSONS = _assets_of_class("civilian", "aid_worker", "combatant")
IMMOVABLE = _assets_of_class("building", "tree", "crate", "tent")
VEHICLES = _assets_of_class("civilian_vehicle")
"""Civilian vehicles: people sit in those that move."""
ROOFED = _assets_of_class("building")
"""What one can be inside of."""
DEFAULT_SPEED_NOTE = "the word's own speed"


class DensityWriter(Protocol):
    """Sets densities and roles."""

    def seek(self, group: str, span: Span) -> None:
        """Make a group the one that is sought."""

    def density_of(self, group: str, count: Part, per: Part, span: Span) -> None:
        """Set the density of a group."""


class TraitReader:
    """Reads properties of one group into a draft.

    Each rule of the grammar is read by the method with its name.
    """

    RULES = frozenset(
        ["motion", "travel", "depart", "halt", "nonstop", "radius", "concealment", "density", "sought"]
    )

    def __init__(
        self, draft: Draft, who: DensityWriter, refine: Callable[[str, Quantity, Span], None]
    ) -> None:
        self._draft, self._groups, self._refine = draft, who, refine

    def density(self, group: str, phrase: Phrase) -> None:
        count, per = phrase.first("COUNT"), phrase.first("PERAREA")
        assert count is not None
        assert per is not None
        self._groups.density_of(group, count, per, phrase.span)

    def sought(self, group: str, phrase: Phrase) -> None:
        self._groups.seek(group, phrase.span)

    def motion(self, group: str, phrase: Phrase) -> None:
        motion = phrase.first("MOTION")
        assert motion is not None
        speed = phrase.first("SPEED")
        put_motion(self._draft, group, motion, speed)

    def travel(self, group: str, phrase: Phrase) -> None:
        """`towards the west`: the way itself is laid out with the ground."""
        if ("actors", group, "motion", "kind") not in self._draft.entries:
            self._draft.unread(phrase.span, "the text does not say that it moves", expressible=True)

    def depart(self, group: str, phrase: Phrase) -> None:
        self._moment(group, phrase, "depart_s", time_of(phrase))

    def halt(self, group: str, phrase: Phrase) -> None:
        time = time_of(phrase)
        depart = self._draft.entries.get(("actors", group, "motion", "depart_s"))
        if depart is not None and phrase.first("AFTER") and not phrase.first("HOME"):
            # `sets off at 60 s and halts after two minutes`.
            later = Quantity("TIME", time.low + depart.value, time.high + depart.value)
            readings = [f"{time.low:g} s after the start", f"{time.low:g} s after it has set off"]
            time = (time, later)[self._draft.ask(phrase.span, "from when on is this counted?", readings)]
        self._moment(group, phrase, "halt_s", time)

    def _moment(self, group: str, phrase: Phrase, name: str, time: Quantity) -> None:
        """Set a time of a group's motion; what sets off or halts does move."""
        base: FieldPath = ("actors", group, "motion")
        if (*base, "kind") not in self._draft.entries:
            self._draft.put((*base, "kind"), "wander", None, "the text says when it moves")
        self._draft.vary((*base, name), time.low, time.high, phrase.span, unit="s")

    def nonstop(self, group: str, phrase: Phrase) -> None:
        self._draft.put(("actors", group, "motion", "pause_s"), 0.0, phrase.span)

    def radius(self, group: str, phrase: Phrase) -> None:
        base: FieldPath = ("actors", group, "motion")
        kind = self._draft.entries.get((*base, "kind"))
        length = length_of(self._draft, phrase)
        # `within 30 m` after `walking` bounds the walk; otherwise it is a distance.
        if kind is None or kind.value != "wander":
            self._refine(group, length, phrase.span)
            return
        self._draft.vary((*base, "radius_m"), length.low, length.high, phrase.span, unit="m")

    def concealment(self, group: str, phrase: Phrase) -> None:
        path: FieldPath = ("actors", group, "concealment")
        given = phrase.first("PERCENT") or phrase.first("COUNT")
        fraction = phrase.first("FRACTION")
        before = self._draft.entries.get(path)
        if given is not None and isinstance(given.value, Quantity):
            if (
                before is not None
                and before.span is not None
                and not re.search(r"\d", self._draft.quote(before.span))
            ):
                # A number replaces a word: `hidden so well that its concealment is 0.8`.
                self._draft.forget(path)
            self._draft.vary(path, given.value.low, given.value.high, phrase.span, unit=None)
        elif fraction is not None and isinstance(fraction.value, float):
            self._draft.put(path, round(fraction.value, 3), phrase.span)
        elif word := phrase.first("CONCEAL"):
            self._draft.put(path, word.value, phrase.span)


def put_speed(draft: Draft, group: str, quantity: Quantity, span: Span) -> None:
    """Set a stated speed; it replaces the default speed of a word such as `driving`."""
    path: FieldPath = ("actors", group, "motion", "speed_mps")
    before = draft.entries.get(path)
    # Two stated speeds are a contradiction, which `vary` asks about. A word's default is not.
    if before is not None and before.note == DEFAULT_SPEED_NOTE:
        del draft.entries[path]
    draft.vary(path, quantity.low, quantity.high, span, unit="m/s")


def put_motion(draft: Draft, group: str, part: Part, speed: Part | None) -> None:
    """Set the motion of a group, with the stated speed or the word's default."""
    assert isinstance(part.value, MotionWords)
    base: FieldPath = ("actors", group, "motion")
    before = draft.entries.get((*base, "kind"))
    if part.value.pace and part.value.speed_mps is not None and before is not None:
        # `driving at walking pace`.
        speed_mps = part.value.speed_mps
        put_speed(draft, group, Quantity("SPEED", speed_mps, speed_mps), part.span)
        return
    if before is None or before.value in ("still", "wander") or part.value.kind == "still":
        draft.put((*base, "kind"), part.value.kind, part.span)
    elif speed is None:
        # `patrols between ..., moving`: the general word adds nothing.
        return
    if speed is not None and isinstance(speed.value, Quantity):
        put_speed(draft, group, speed.value, speed.span)
    elif part.value.speed_mps is not None and (*base, "speed_mps") not in draft.entries:
        draft.put((*base, "speed_mps"), part.value.speed_mps, part.span, DEFAULT_SPEED_NOTE)


def time_of(phrase: Phrase) -> Quantity:
    """The time that a phrase states, in seconds."""
    part = phrase.first("TIME")
    assert part is not None
    assert isinstance(part.value, Quantity)
    return part.value


def length_of(draft: Draft, phrase: Phrase) -> Quantity:
    """The length that a phrase states, in metres."""
    part = phrase.first("LENGTH")
    assert part is not None
    assert isinstance(part.value, Quantity)
    if part.value.low > part.value.high:
        draft.fault(part.span, "the range runs downwards", "write the lower number first")
    return part.value
