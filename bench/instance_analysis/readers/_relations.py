"""Reads where a group stands: its relations to other groups, to places and to the vehicle's home."""

from __future__ import annotations

import math

from bench.simspec import ASSETS, HOME

from .._draft import Draft, FieldPath
from ..language._coordinates import Coordinates
from ..language._phrases import Phrase, Quantity
from ..language._tokens import Span
from ..language._vocabulary import Defaults
from ._ground import GroundReader
from ._group_references import GroupReferences
from ._places import PlaceReader
from ._traits import DIRECTIONS, PERSONS, length_of

MAX_WORDS_TO_DISTANCE = 3
"""Words between `beside the road` and a distance without an origin at most. Chosen."""
MAX_SHARE_OF_SIZE = 0.25
"""Above this share of a distance the size of a thing decides whether its centre or its edge is meant. Chosen."""
NO_OWN_DISTANCE = "a group has no distance to itself"


class RelationReader:
    """Reads the relations of one group into a draft; each rule of the grammar by the method of its name."""

    RULES = frozenset(
        [
            "near", "within", "atleast", "exact", "away", "mean", "polar", "midpoint", "bearing", "part", "inside", "behind",
            "landgap", "facing", "hidden", "visible", "between", "apart", "together", "avoids", "spread",
        ]
    )  # fmt: skip

    def __init__(
        self,
        draft: Draft,
        defaults: Defaults,
        ground: GroundReader,
        places: PlaceReader,
        references: GroupReferences,
    ) -> None:
        self._draft, self._defaults, self._ground = draft, defaults, ground
        self._places, self._references, self._groups = places, references, references.groups

    def _distance(
        self,
        group: str,
        phrase: Phrase,
        low: float,
        high: float | None,
        *,
        every: bool = False,
        note: str = "",
    ) -> None:
        for other in self._references.ref(phrase.refs[-1]):
            self._keep(group, other, phrase.span, low, high, every=every, note=note)

    def _keep(
        self,
        group: str,
        other: str | Coordinates,
        span: Span,
        low: float,
        high: float | None,
        *,
        every: bool,
        note: str,
    ) -> None:
        if other == group:
            self._draft.unread(span, NO_OWN_DISTANCE)
            return
        base: FieldPath = ("actors", group, "placement")
        low, high = round(low, 6), None if high is None else round(high, 6)
        defaulted = span if note != "default" else None
        # `near the radar, 20 to 40 m from it` states one relation, not two.
        self._closer(base, other, note)
        # A placement has one `near`, to a group or home. Everything else goes into its list of distances.
        if isinstance(other, Coordinates) or every or (*base, "near", "of") in self._draft.entries:
            where: FieldPath = (*base, "distances", self._rows(base))
            if isinstance(other, str):
                self._draft.put((*where, "whom"), "every" if every else "some", span)
        else:
            where = (*base, "near")
        if isinstance(other, str):
            self._draft.put((*where, "of"), other, span)
        else:
            self._draft.put((*where, "point"), self._places.point(other), span)
        if low > 0.0:
            self._draft.put((*where, "min_m"), low, span, note)
        if high is not None:
            self._draft.put(
                (*where, "max_m"), high, defaulted, "the default for `near`" if defaulted is None else note
            )

    def _closer(self, base: FieldPath, other: str | Coordinates, note: str) -> None:
        """Replace the default for `near` by a distance from the same group."""
        of, most = (self._draft.entries.get((*base, "near", name)) for name in ("of", "max_m"))
        if (
            of is not None
            and of.value == other
            and most is not None
            and most.span is None
            and note != "default"
        ):
            self._draft.forget((*base, "near"))

    def _rows(self, base: FieldPath) -> int:
        return len({path[4] for path in self._draft.entries if path[:4] == (*base, "distances")})

    def near(self, group: str, phrase: Phrase) -> None:
        asset = phrase.refs[0].first("ASSET")
        if (
            asset is not None
            and asset.value in PERSONS
            and self._draft.quote(phrase.span).lower().startswith("by ")
        ):
            # `seen by a farmer`: who has done it stands anywhere.
            self._draft.unread(phrase.span, "who has done it is not where somebody stands", expressible=True)
            return
        self._distance(group, phrase, 0.0, self._defaults.near_m, note="default")

    def within(self, group: str, phrase: Phrase) -> None:
        length = length_of(self._draft, phrase)
        self._distance(group, phrase, 0.0 if length.single else length.low, length.high)

    def atleast(self, group: str, phrase: Phrase) -> None:
        if not phrase.refs:
            self._draft.unread(phrase.span, "the text does not say from what")
            return
        if len(phrase.refs) > 1:
            # `no civilian is within 50 m of the radar` names its own subject.
            phrase.every("NONE")
            asset = phrase.refs[0].first("ASSET")
            subject = [known for known, kind in self._groups.kinds.items() if asset and kind == asset.value]
            if len(subject) != 1:
                self._draft.unread(phrase.span, "the text does not say for whom", expressible=True)
                return
            [group] = subject
        # A minimum holds for every member of the other group, a maximum for the nearest one.
        self._distance(group, phrase, length_of(self._draft, phrase).low, None, every=True)

    def refine(self, group: str, length: Quantity, span: Span) -> None:
        """Read a distance on its own: it refines a `near` before it (`near the houses, within 25 m`); else
        ask from which group.
        """
        path: FieldPath = ("actors", group, "placement", "near", "max_m")
        before = self._draft.entries.get(path)
        low = 0.0 if length.single else length.low
        if before is not None and before.span is None:
            self._draft.forget(path)
            self._draft.put(path, length.high, span)
            if low:
                self._draft.put((*path[:-1], "min_m"), low, span)
            return
        self._away(group, low, length.high, span, "")

    def _away(self, group: str, low: float, high: float, span: Span, note: str) -> None:
        if self._off_the_road(group, low, high, span):
            return
        others: list[str] = [other for other in self._groups.kinds if other != group]
        if not others:
            self._draft.unread(span, "the text does not say from what", expressible=True)
            return
        self._keep(group, self._distance_origin(group, span), span, low, high, every=False, note=note)

    def _off_the_road(self, group: str, low: float, high: float, span: Span) -> bool:
        """Read `beside the road, no more than 12 m off`; whether the distance follows such words."""
        base: FieldPath = ("actors", group, "placement", "along")
        where = self._draft.entries.get((*base, "where"))
        if (
            where is None
            or where.value != "beside"
            or where.span is None
            or (*base, "within_m") in self._draft.entries
        ):
            return False
        between = self._draft.text[where.span.end : span.start]
        if len(between.split()) > MAX_WORDS_TO_DISTANCE or not {".", ";"}.isdisjoint(between):
            return False
        self._draft.put((*base, "within_m"), high, span)
        if low:
            self._draft.put((*base, "at_least_m"), low, span)
        return True

    def _distance_origin(self, group: str, span: Span) -> str:
        """The origin of a distance without one: the only other group, or home; with several groups, ask."""
        others: list[str] = [other for other in self._groups.kinds if other != group]
        # A group of the same sentence is the likeliest, and the start the least likely one.
        others.sort(key=lambda other: other not in self._groups.mentioned)
        readings = [*others, "the vehicle's start"]
        return [*others, HOME][self._draft.ask(span, "away from what?", readings)]

    def _lengths(self, phrase: Phrase) -> list[Quantity]:
        return [part.value for part in phrase.every("LENGTH") if isinstance(part.value, Quantity)]

    def _band(self, length: Quantity) -> tuple[float, float, str]:
        if not length.single:
            return length.low, length.high, ""
        share = self._defaults.exact_share
        return length.low * (1 - share), length.high * (1 + share), f"{length.low:g} m within {share:.0%}"

    def exact(self, group: str, phrase: Phrase) -> None:
        first, *rest = [length_of(self._draft, phrase), *self._lengths(phrase)[1:]]
        if rest:
            # `at least 20 m and at most 50 m from it`.
            first = Quantity("LENGTH", first.low, rest[0].high)
        low, high, note = self._band(first)
        self._distance(group, phrase, low, high, note=note)
        # `70 m from home, due east`.
        if due := phrase.first("DUE"):
            direction = DIRECTIONS[self._draft.quote(due.span).lower().split()[-1]]
            self.towards(group, self._references.ref(phrase), direction, phrase.span)

    def away(self, group: str, phrase: Phrase) -> None:
        low, high, note = self._band(length_of(self._draft, phrase))
        self._keep(
            group, self._distance_origin(group, phrase.span), phrase.span, low, high, every=False, note=note
        )

    def mean(self, group: str, phrase: Phrase) -> None:
        length, of = length_of(self._draft, phrase), self._references.ref(phrase.refs[-1])
        # `the mean distance of the civilians to the radar` names its own subject.
        if len(phrase.refs) > 1:
            group = next(
                (target for target in self._references.ref(phrase.refs[0]) if isinstance(target, str)), group
            )
        groups = [target for target in of if isinstance(target, str)]
        if not groups:
            self._draft.unread(phrase.span, "a mean distance is to a group or to the vehicle's start")
            return
        base: FieldPath = ("actors", group, "placement", "mean_distance")
        self._draft.put((*base, "of"), groups[0], phrase.span)
        self._draft.vary((*base, "mean_m"), length.low, length.high, phrase.span, unit="m")

    def bearing(self, group: str, phrase: Phrase) -> None:
        part = phrase.first("DIR")
        assert part is not None
        assert isinstance(part.value, float | int)
        of, lengths = self._references.ref(phrase), self._lengths(phrase)
        if not lengths:
            self.towards(group, of, float(part.value), phrase.span)
            return
        low, high, note = self._band(lengths[0])
        self.towards(group, of, float(part.value), phrase.span, self._aside(lengths[0]))
        for other in of[:1]:
            self._keep(group, other, phrase.span, low, high, every=False, note=note)

    def polar(self, group: str, phrase: Phrase) -> None:
        """`at a distance of 180 m and a bearing of 30 degrees`: a place from home, a sector from a group."""
        length, angle = length_of(self._draft, phrase), phrase.first("ANGLE")
        assert angle is not None
        assert isinstance(angle.value, Quantity)
        if not angle.value.single:
            self._draft.unread(phrase.span, "a direction is one angle, not a range", expressible=True)
            return
        of: list[str | Coordinates] = [] if not phrase.refs else self._references.ref(phrase)
        if not phrase.refs:
            of.append(self._distance_origin(group, phrase.span))
        direction = angle.value.low % 360
        if of[:1] == [HOME] and length.single:
            radians = math.radians(direction)
            east, north = (round(length.low * part(radians), 3) for part in (math.sin, math.cos))
            self._places.stand(group, Coordinates(east, north, from_home=True), phrase.span)
            return
        low, high, note = self._band(length)
        self.towards(group, of, direction, phrase.span, self._aside(length))
        for other in of[:1]:
            self._keep(group, other, phrase.span, low, high, every=False, note=note)

    def midpoint(self, group: str, phrase: Phrase) -> None:
        """`centre 250 m north of home`, said of no ground."""
        self._draft.unread(phrase.span, "the text does not say the centre of what", expressible=True)

    def _aside(self, length: Quantity) -> float:
        """Half of the sector in degrees that a distance leaves: one number is as exact across as along."""
        share = self._defaults.exact_share if length.single else 0.4
        return round(math.degrees(math.atan(share)), 1)

    def towards(
        self, group: str, of: list[str | Coordinates], direction: float, span: Span, half: float | None = None
    ) -> None:
        """Stand in the sector around a direction: a quarter of the circle for the main ones, an eighth
        between these, and less where a distance is given.
        """
        # `northeast` is more precise than `north`, so its sector is half as wide.
        half = half or (45.0 if direction % 90 == 0 else 22.5)
        base: FieldPath = ("actors", group, "placement", "bearing")
        if of and of[0] == group:
            self._draft.unread(span, NO_OWN_DISTANCE)
        elif of:
            self._put_reference(base, of, span)
            self._draft.put((*base, "from_deg"), round((direction - half) % 360, 3), span)
            self._draft.put((*base, "to_deg"), round((direction + half) % 360, 3), span)

    def _put_reference(self, base: FieldPath, of: list[str | Coordinates], span: Span) -> None:
        if of and isinstance(of[0], Coordinates):
            self._draft.put((*base, "point"), self._places.point(of[0]), span)
        elif of and of[0] == base[1]:
            self._draft.unread(span, "a group has no such relation to itself")
        elif of:
            self._draft.put((*base, "of"), of[0], span)

    def part(self, group: str, phrase: Phrase) -> None:
        part = phrase.first("DIR")
        direction = float(part.value) if part is not None and isinstance(part.value, float | int) else None
        self._ground.parts.append((group, direction, phrase.span))

    def inside(self, group: str, phrase: Phrase) -> None:
        if not phrase.refs:
            self._ground.put_inside(group, phrase)
            return
        for other in self._references.ref(phrase):
            if isinstance(other, Coordinates) or other not in self._groups.kinds:
                self._draft.unread(phrase.span, "a group cannot stand inside a point")
            elif other == group:
                self._draft.unread(phrase.span, "a group cannot stand inside itself")
            elif self._groups.asset(other) in PERSONS:
                self._draft.unread(phrase.span, "nobody stands inside of that", expressible=True)
            else:
                self._draft.put(("actors", group, "placement", "inside", "of"), other, phrase.span)

    def landgap(self, group: str, phrase: Phrase) -> None:
        self._draft.unread(phrase.span, "a SimSpec has no distance or direction from a piece of ground")

    def behind(self, group: str, phrase: Phrase) -> None:
        of = self._references.ref(phrase)
        base: FieldPath = ("actors", group, "placement", "hidden_from")
        if not of:
            return
        if len(phrase.refs) > 1:
            self._put_reference(base, self._references.ref(phrase.refs[1]), phrase.span)
        else:
            place = f"near {of[0]}"
            readings = [f"{place}, out of sight of the vehicle's start", f"{place}, on whichever side"]
            if self._draft.ask(phrase.span, "behind it as seen from where?", readings) == 0:
                self._put_reference(base, [HOME], phrase.span)
        self._keep(group, of[0], phrase.span, 0.0, self._defaults.near_m, every=False, note="default")

    def facing(self, group: str, phrase: Phrase) -> None:
        base: FieldPath = ("actors", group, "placement", "facing")
        if phrase.refs:
            self._put_reference(base, self._references.ref(phrase), phrase.span)
        elif direction := phrase.first("DIR"):
            self._draft.put((*base, "heading_deg"), direction.value, phrase.span)
        elif (figure := phrase.first("ANGLE") or phrase.first("COUNT")) and isinstance(
            figure.value, Quantity
        ):
            self._draft.vary(
                (*base, "heading_deg"), figure.value.low % 360, figure.value.high, phrase.span, unit="deg"
            )

    def hidden(self, group: str, phrase: Phrase) -> None:
        self._sight("hidden_from", group, phrase)

    def visible(self, group: str, phrase: Phrase) -> None:
        self._sight("visible_from", group, phrase)

    def _sight(self, name: str, group: str, phrase: Phrase) -> None:
        base: FieldPath = ("actors", group, "placement", name)
        self._put_reference(base, self._references.ref(phrase), phrase.span)
        for height in self._lengths(phrase):
            self._draft.put((*base, "height_m"), height.low, phrase.span)

    def between(self, group: str, phrase: Phrase) -> None:
        ends: list[str | Coordinates] = [end for ref in phrase.refs for end in self._references.ref(ref)]
        if phrase.first("BETWEENTHEM"):
            # `between them` means the group named last before the subject.
            ends = [*[end for end in self._groups.kinds if end != group][-1:]]
        names = [end for end in ends if isinstance(end, str) and end != group]
        if len(names) == 1 and len(ends) == 1 and names[0] in self._groups.counts.plural:
            # `between the houses` means between two members of one group.
            names *= 2
        if len(names) != 2 or len(ends) > 2:
            self._draft.unread(phrase.span, "`between` needs two groups, or a group of several")
            return
        base: FieldPath = ("actors", group, "placement", "between")
        self._draft.put((*base, "first"), names[0], phrase.span)
        self._draft.put((*base, "second"), names[1], phrase.span)

    def apart(self, group: str, phrase: Phrase) -> None:
        length = length_of(self._draft, phrase)
        if phrase.refs:
            # `between the houses is always more than 25 m` names its own subject.
            named = [target for target in self._references.ref(phrase) if isinstance(target, str)]
            if len(named) != 1 or named[0] not in self._groups.counts.plural:
                self._draft.unread(phrase.span, "a least distance between members is of one group of several")
                return
            [group] = named
        elif self._is_single(group, phrase):
            return
        high = length.high
        if not length.single:
            # The greater number of `30 to 50 m apart` may be the greatest distance, which it is not here.
            readings = [
                f"at least {length.low:g} m apart",
                f"a least distance of {length.low:g} to {high:g} m",
            ]
            if self._draft.ask(phrase.span, "how far apart are they?", readings) == 0:
                high = length.low
        self._draft.vary(("actors", group, "placement", "spread_m"), length.low, high, phrase.span, unit="m")
        size_m = ASSETS[self._groups.asset(group)].length_m
        if size_m > MAX_SHARE_OF_SIZE * length.low:
            self._draft.remark(phrase.span, f"measured between their centres; each is {size_m:g} m long")

    def _is_single(self, group: str, phrase: Phrase) -> bool:
        """Whether a distance between members is said of a group of one, and so of somebody else; it is listed then."""
        count = self._draft.entries.get(("actors", group, "count"))
        single = group not in self._groups.counts.plural and count is not None and count.value == 1
        if single:
            self._draft.unread(
                phrase.span, "a group of one has no distance between members", expressible=True
            )
        return single

    def together(self, group: str, phrase: Phrase) -> None:
        """`all within 20 m of each other`: the largest distance between two members."""
        length = length_of(self._draft, phrase)
        if self._is_single(group, phrase):
            return
        self._draft.vary(
            ("actors", group, "placement", "extent_m"), length.high, length.high, phrase.span, unit="m"
        )

    def avoids(self, group: str, phrase: Phrase) -> None:
        self._ground.put_outside(group, phrase)

    def spread(self, group: str, phrase: Phrase) -> None:
        """Spread over the area of interest (the default of a group without a relation) or over a named
        area.
        """
        if phrase.first("GROUND") or phrase.first("NAMED"):
            self._ground.put_inside(group, phrase)
