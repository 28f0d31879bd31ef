"""What is said of a group to fields: where it stands, how it moves, how many there are in a place, how well it hides."""

from __future__ import annotations

from typing import Protocol

from ._draft import Draft, Path
from ._ground import Ground
from ._phrases import Part, Phrase, Quantity
from ._tokens import Span
from ._vocabulary import Defaults, MotionWords

OWN_SPEED = "the word's own speed"
NO_SUCH_FIELD = "a SimSpec has no relation for this yet"


class Who(Protocol):
    """Who is spoken of, as the reader knows it."""

    groups: dict[str, str]

    def ref(self, phrase: Phrase) -> list[str] | None:
        """Ids of the groups that a relation is to; None for the vehicle's start."""

    def density_of(self, group: str, count: Part, per: Part, span: Span) -> None:
        """Say how many of a group there are in a place."""


class Traits:
    """Reads what is said of one group into a draft; each rule of the grammar by the method of its name."""

    RELATIONS = frozenset(
        [
            *("near", "within", "atleast", "exact", "away", "mean", "bearing", "part", "road", "inside", "behind"),
            *("facing", "hidden", "visible", "between", "apart", "spread"),
        ]
    )
    RULES = RELATIONS | {"motion", "radius", "concealment", "density"}

    def __init__(self, draft: Draft, defaults: Defaults, ground: Ground, who: Who) -> None:
        self._draft, self._defaults, self._ground, self._who = draft, defaults, ground, who

    def _distance(
        self, group: str, phrase: Phrase, low: float, high: float | None, *, every: bool = False, note: str = ""
    ) -> None:
        of = self._who.ref(phrase)
        if of is None:
            self._draft.unread(phrase.span, "a SimSpec has no distance to the vehicle's start")
            return
        for other in of:
            self._keep(group, other, phrase.span, low, high, every=every, note=note)

    def _keep(self, group: str, other: str, span: Span, low: float, high: float | None, *, every: bool, note: str) -> None:
        if other == group:
            self._draft.unread(span, "a group has no distance to itself")
            return
        base: Path = ("actors", group, "placement")
        low, high = round(low, 6), None if high is None else round(high, 6)
        defaulted = span if note != "default" else None
        if not every and (*base, "near", "of") not in self._draft.entries:
            where: Path = (*base, "near")
        else:
            number = sum(1 for path in self._draft.entries if path[:4] == (*base, "distances") and path[-1] == "of")
            where = (*base, "distances", number)
            self._draft.put((*where, "whom"), "every" if every else "some", span)
        self._draft.put((*where, "of"), other, span)
        if low > 0.0:
            self._draft.put((*where, "min_m"), low, span, note)
        if high is not None:
            self._draft.put((*where, "max_m"), high, defaulted, "what near means" if defaulted is None else note)

    def near(self, group: str, phrase: Phrase) -> None:
        self._distance(group, phrase, 0.0, self._defaults.near_m, note="default")

    def within(self, group: str, phrase: Phrase) -> None:
        length = length_of(self._draft, phrase)
        self._distance(group, phrase, 0.0 if length.single else length.low, length.high)

    def atleast(self, group: str, phrase: Phrase) -> None:
        if not phrase.refs:
            self._draft.unread(phrase.span, "it is not said from what")
            return
        self._distance(group, phrase, length_of(self._draft, phrase).low, None, every=True)

    def _band(self, length: Quantity) -> tuple[float, float, str]:
        if not length.single:
            return length.low, length.high, ""
        share = self._defaults.exact_share
        return length.low * (1 - share), length.high * (1 + share), f"{length.low:g} m within {share:.0%}"

    def exact(self, group: str, phrase: Phrase) -> None:
        low, high, note = self._band(length_of(self._draft, phrase))
        self._distance(group, phrase, low, high, note=note)

    def away(self, group: str, phrase: Phrase) -> None:
        others = [one for one in self._who.groups if one != group]
        low, high, note = self._band(length_of(self._draft, phrase))
        readings = [*others, "the vehicle's start"]
        chosen = self._draft.ask(phrase.span, "away from what?", readings) if others else 0
        if chosen == len(others):
            self._draft.unread(phrase.span, "a SimSpec has no distance to the vehicle's start")
        else:
            self._keep(group, others[chosen], phrase.span, low, high, every=False, note=note)

    def mean(self, group: str, phrase: Phrase) -> None:
        length, of = length_of(self._draft, phrase), self._who.ref(phrase)
        if not of:
            self._draft.unread(phrase.span, "a SimSpec has no distance to the vehicle's start")
            return
        base: Path = ("actors", group, "placement", "mean_distance")
        self._draft.put((*base, "of"), of[0], phrase.span)
        self._draft.vary((*base, "mean_m"), length.low, length.high, phrase.span, unit="m")

    def bearing(self, group: str, phrase: Phrase) -> None:
        part = phrase.first("DIR")
        assert part is not None
        assert isinstance(part.value, float | int)
        half = 45.0 if part.value % 90 == 0 else 22.5
        of = self._who.ref(phrase)
        base: Path = ("actors", group, "placement", "bearing")
        self._seen(base, of, phrase.span)
        self._draft.put((*base, "from_deg"), (part.value - half) % 360, phrase.span)
        self._draft.put((*base, "to_deg"), (part.value + half) % 360, phrase.span)
        if phrase.first("LENGTH") and of:
            low, high, note = self._band(length_of(self._draft, phrase))
            self._keep(group, of[0], phrase.span, low, high, every=False, note=note)
        elif phrase.first("LENGTH"):
            self._draft.unread(phrase.span, "a SimSpec has no distance to the vehicle's start")

    def _seen(self, base: Path, of: list[str] | None, span: Span) -> None:
        if of is None:
            self._draft.put((*base, "point"), {"east_m": 0.0, "north_m": 0.0}, span, "the vehicle's start")
        elif of:
            self._draft.put((*base, "of"), of[0], span)

    def part(self, group: str, phrase: Phrase) -> None:
        part = phrase.first("DIR")
        assert part is not None
        assert isinstance(part.value, float | int)
        self._ground.parts.append((group, float(part.value), phrase.span))

    def road(self, group: str, phrase: Phrase) -> None:
        base: Path = ("actors", group, "placement", "along")
        self._draft.put((*base, "road"), "road", phrase.span)
        self._draft.put((*base, "where"), "beside" if phrase.first("BESIDE") else "on", phrase.span)
        self._ground.road = self._ground.road or phrase.span

    def inside(self, group: str, phrase: Phrase) -> None:
        if phrase.refs:
            self._who.ref(phrase)
            self._draft.unread(phrase.span, "actors' footprints never overlap: nobody can stand inside another")

    def behind(self, group: str, phrase: Phrase) -> None:
        of = self._who.ref(phrase)
        if not of:
            self._draft.unread(phrase.span, NO_SUCH_FIELD)
            return
        base: Path = ("actors", group, "placement", "hidden_from")
        near = f"near {of[0]}"
        if len(phrase.refs) > 1:
            self._seen(base, self._who.ref(phrase.refs[1]), phrase.span)
        else:
            readings = [f"{near}, out of sight of the vehicle's start", f"{near}, on whichever side"]
            if self._draft.ask(phrase.span, "behind it as seen from where?", readings) == 0:
                self._seen(base, None, phrase.span)
        self._keep(group, of[0], phrase.span, 0.0, self._defaults.near_m, every=False, note="default")

    def facing(self, group: str, phrase: Phrase) -> None:
        if not phrase.refs:
            self._draft.unread(phrase.span, "actors can face a group or a point, not a direction")
            return
        self._seen(("actors", group, "placement", "facing"), self._who.ref(phrase), phrase.span)

    def hidden(self, group: str, phrase: Phrase) -> None:
        self._seen(("actors", group, "placement", "hidden_from"), self._who.ref(phrase), phrase.span)

    def visible(self, group: str, phrase: Phrase) -> None:
        self._seen(("actors", group, "placement", "visible_from"), self._who.ref(phrase), phrase.span)

    def between(self, group: str, phrase: Phrase) -> None:
        for ref in phrase.refs:
            self._who.ref(ref)
        self._draft.unread(phrase.span, NO_SUCH_FIELD)

    def apart(self, group: str, phrase: Phrase) -> None:
        self._draft.vary(
            ("actors", group, "placement", "spread_m"), (q := length_of(self._draft, phrase)).low, q.high, phrase.span, unit="m"
        )

    def spread(self, group: str, phrase: Phrase) -> None:
        """Anywhere in the area, which is what a group without a relation has."""

    def density(self, group: str, phrase: Phrase) -> None:
        count, per = phrase.first("COUNT"), phrase.first("PERAREA")
        assert count is not None
        assert per is not None
        self._who.density_of(group, count, per, phrase.span)

    def motion(self, group: str, phrase: Phrase) -> None:
        motion = phrase.first("MOTION")
        assert motion is not None
        speed = phrase.first("SPEED")
        self.moves(group, motion, speed)

    def radius(self, group: str, phrase: Phrase) -> None:
        base: Path = ("actors", group, "motion")
        kind = self._draft.entries.get((*base, "kind"))
        if kind is None or kind.value != "wander":
            self._draft.unread(phrase.span, "it is not said of what", expressible=True)
            return
        length = length_of(self._draft, phrase)
        self._draft.vary((*base, "radius_m"), length.low, length.high, phrase.span, unit="m")

    def say_speed(self, group: str, quantity: Quantity, span: Span) -> None:
        """A speed that is said goes before the one that `driving` has by itself."""
        path: Path = ("actors", group, "motion", "speed_mps")
        before = self._draft.entries.get(path)
        if before is not None and before.note == OWN_SPEED:
            del self._draft.entries[path]
        self._draft.vary(path, quantity.low, quantity.high, span, unit="m/s")

    def moves(self, group: str, part: Part, speed: Part | None) -> None:
        assert isinstance(part.value, MotionWords)
        base: Path = ("actors", group, "motion")
        self._draft.put((*base, "kind"), part.value.kind, part.span)
        if speed is not None and isinstance(speed.value, Quantity):
            self.say_speed(group, speed.value, speed.span)
        elif part.value.speed_mps is not None and (*base, "speed_mps") not in self._draft.entries:
            self._draft.put((*base, "speed_mps"), part.value.speed_mps, part.span, OWN_SPEED)

    def concealment(self, group: str, phrase: Phrase) -> None:
        path: Path = ("actors", group, "concealment")
        given = phrase.first("PERCENT") or phrase.first("COUNT")
        if given is not None and isinstance(given.value, Quantity):
            self._draft.vary(path, given.value.low, given.value.high, phrase.span, unit=None)
        elif word := phrase.first("CONCEAL"):
            self._draft.put(path, word.value, phrase.span)


def length_of(draft: Draft, phrase: Phrase) -> Quantity:
    """The length that a phrase states, in metres."""
    part = phrase.first("LENGTH")
    assert part is not None
    assert isinstance(part.value, Quantity)
    if part.value.low > part.value.high:
        draft.fault(part.span, "the range runs downwards", "write the lower number first")
    return part.value
