"""Reads what is said of one group: where it stands, how it moves, what it is."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.simspec import ASSETS, Role

from .._draft import Draft, FieldPath
from ..language._coordinates import Coordinates
from ..language._grammar import Part
from ..language._quantities import Quantity
from ..language._tokens import Span
from ..language._vocabulary import MotionWords, Vocabulary
from ._ground import GroundReader
from ._groups import IMMOVABLE, PERSONS, ROOFED
from ._not_read import NotReadError
from ._places import PlaceReader
from ._roads import RoadReader
from ._scene import RelationTarget, Scene
from ._settings import put_fields

MAX_SHARE_OF_SIZE = 0.25
"""Above this share of a distance the size of a thing decides whether its centre or its edge is meant. Chosen."""
OWN_SPEED = "the word's own speed"


class PredicateReader:
    """Reads predicates; each form by the method that `does` names. `group` is whom the predicate is said of."""

    def __init__(
        self,
        draft: Draft,
        vocabulary: Vocabulary,
        scene: Scene,
        places: PlaceReader,
        ground: GroundReader,
        roads: RoadReader,
    ) -> None:
        self._draft, self._vocabulary, self._scene = draft, vocabulary, scene
        self._places, self._ground, self._roads = places, ground, roads

    def read(self, group: str, part: Part) -> None:
        names = {"ground": "ground_of"}
        getattr(self, f"_{names.get(part.form.reader, part.form.reader)}")(group, part)

    def _sets(self, group: str, part: Part) -> None:
        put_fields(self._draft, ("actors", group), part)

    # Distances.

    def _others(self, group: str, part: Part, name: str = "reference") -> list[RelationTarget]:
        """Whom a relation is to: never the group itself."""
        others = self._scene.references(part.first(name), self._scene.family(group))
        if group in others:
            raise NotReadError("a group has no such relation to itself")
        if not others:
            raise NotReadError("it is a relation to nobody")
        return others

    def _keep(
        self, group: str, part: Part, low: float, high: float | None, *, every: bool = False, note: str = ""
    ) -> None:
        for other in self._others(group, part):
            self._put_distance(group, other, part.span, low, high, every=every, note=note)

    def _put_distance(
        self,
        group: str,
        other: RelationTarget,
        span: Span,
        low: float,
        high: float | None,
        *,
        every: bool,
        note: str,
    ) -> None:
        base: FieldPath = ("actors", group, "placement")
        # A placement has one `near`, to a group or home. Everything else goes into its list of distances.
        if isinstance(other, Coordinates) or every or (*base, "near", "of") in self._draft.entries:
            where: FieldPath = (*base, "distances", self._rows((*base, "distances")))
        else:
            where = (*base, "near")
        if isinstance(other, Coordinates):
            self._draft.put((*where, "point"), self._places.point(other), span)
        else:
            self._draft.put((*where, "of"), other, span)
            if "distances" in where:
                self._draft.put((*where, "whom"), "every" if every else "some", span)
        if low > 0.0:
            self._draft.put((*where, "min_m"), round(low, 6), span, note)
        if high is not None:
            self._draft.reading = span
            told = None if note == "the default for `near`" else span
            self._draft.put((*where, "max_m"), round(high, 6), told, note)

    def _rows(self, base: FieldPath) -> int:
        return len({path[len(base)] for path in self._draft.entries if path[: len(base)] == base})

    def _band(self, length: Quantity) -> tuple[float, float, str]:
        if not length.single:
            return length.low, length.high, ""
        share = self._vocabulary.defaults.exact_share
        return length.low * (1 - share), length.high * (1 + share), f"{length.low:g} m within {share:.0%}"

    def _near(self, group: str, part: Part) -> None:
        self._keep(group, part, 0.0, self._vocabulary.defaults.near_m, note="the default for `near`")

    def _within(self, group: str, part: Part) -> None:
        length = part.first("length")
        self._keep(group, part, 0.0 if length.single else length.low, length.high)

    def _at_least(self, group: str, part: Part) -> None:
        # A minimum holds for every member of the other group, a maximum for the nearest one.
        self._keep(group, part, part.first("length").low, None, every=True)

    def _exact(self, group: str, part: Part) -> None:
        low, high, note = self._band(part.first("length"))
        self._keep(group, part, low, high, note=note)

    def _between_bounds(self, group: str, part: Part) -> None:
        self._keep(group, part, part.first("low").low, part.first("high").high)

    def _mean(self, group: str, part: Part) -> None:
        length, others = part.first("length"), self._others(group, part)
        if not isinstance(others[0], str):
            raise NotReadError("a mean distance is to a group or to home")
        base: FieldPath = ("actors", group, "placement", "mean_distance")
        self._draft.put((*base, "of"), others[0], part.span)
        self._draft.vary((*base, "mean_m"), length.low, length.high, part.span, unit="m")

    # Directions.

    def _bearing(self, group: str, part: Part) -> None:
        length = part.first("length")
        self._sector(group, part, part.first("direction"), length)

    def _polar(self, group: str, part: Part) -> None:
        angle, length = part.first("angle"), part.first("length")
        reference = part.first("reference")
        if isinstance(reference, Coordinates) and length.single:
            radians = math.radians(angle.low)
            east, north = (round(length.low * turn(radians), 3) for turn in (math.sin, math.cos))
            self._stand(group, reference.moved(east, north), part.span)
            return
        self._sector(group, part, angle.low % 360, length)

    def _sector(self, group: str, part: Part, direction: float, length: Quantity | None) -> None:
        """Stand in the sector around a direction: a quarter of the circle for the main ones, an eighth between these, and
        less where a distance is given.
        """
        others = self._others(group, part)
        half = 45.0 if direction % 90 == 0 else 22.5
        if length is not None:
            share = self._vocabulary.defaults.exact_share if length.single else 0.4
            half = round(math.degrees(math.atan(share)), 1)
        base: FieldPath = ("actors", group, "placement", "bearing")
        self._put_place(base, others[0], part.span)
        self._draft.put((*base, "from_deg"), round((direction - half) % 360, 3), part.span)
        self._draft.put((*base, "to_deg"), round((direction + half) % 360, 3), part.span)
        if length is not None:
            low, high, note = self._band(length)
            self._put_distance(group, others[0], part.span, low, high, every=False, note=note)

    def _put_place(self, base: FieldPath, place: RelationTarget, span: Span) -> None:
        if isinstance(place, Coordinates):
            self._draft.put((*base, "point"), self._places.point(place), span)
        else:
            self._draft.put((*base, "of"), place, span)

    # Sight.

    def _behind(self, group: str, part: Part) -> None:
        base: FieldPath = ("actors", group, "placement", "hidden_from")
        others = self._others(group, part)
        if part.first("viewpoint") is not None:
            self._put_place(base, self._others(group, part, "viewpoint")[0], part.span)
        else:
            readings = [f"near {others[0]}, out of sight of home", f"near {others[0]}, on whichever side"]
            if self._draft.ask(part.span, "behind it as seen from where?", readings) == 0:
                self._draft.put((*base, "of"), "home", part.span)
        self._near(group, part)

    def _sight(self, group: str, part: Part) -> None:
        base: FieldPath = ("actors", group, "placement", part.form.kind)
        self._put_place(base, self._others(group, part)[0], part.span)
        if (height := part.first("length")) is not None:
            self._draft.put((*base, "height_m"), height.low, part.span)

    def _between(self, group: str, part: Part) -> None:
        ends = [
            end for name in ("first", "second") if part.first(name) for end in self._others(group, part, name)
        ]
        names = [end for end in ends if isinstance(end, str)]
        if len(names) == 1 and part.first("second") is None and self._scene.groups[names[0]].plural:
            # `between the houses` means between two members of one group.
            names *= 2
        if len(names) != 2:
            raise NotReadError("`between` needs two groups, or a group of several")
        base: FieldPath = ("actors", group, "placement", "between")
        self._draft.put((*base, "first"), names[0], part.span)
        self._draft.put((*base, "second"), names[1], part.span)

    # Places.

    def _at(self, group: str, part: Part) -> None:
        self._stand(group, part.first("place"), part.span)

    def _stand(self, group: str, place: Coordinates, span: Span) -> None:
        base: FieldPath = ("actors", group, "placement")
        point, note = self._places.point(place), "from the origin of the map" if place.degrees else ""
        if self._scene.count(group) != 1:
            # A SimSpec has coordinates only for a group of one.
            if any(path[:4] == (*base, "distances") and "point" in path for path in self._draft.entries):
                raise NotReadError("a group stands at one place: say how many stand at each")
            self._draft.remark(span, "several members cannot stand at one point: they stand near it")
            near = self._vocabulary.defaults.near_m
            self._put_distance(group, place, span, 0.0, near, every=False, note="the default for `near`")
            return
        for name, value in point.items():
            self._draft.put((*base, "at", name), value, span, note)

    def _part(self, group: str, part: Part) -> None:
        self._ground.part_of_area(group, part.first("direction"), part.span)

    def _ground_of(self, group: str, part: Part) -> None:
        self._ground.relate(group, part, part.form.kind)

    def _inside(self, group: str, part: Part) -> None:
        other = self._others(group, part)[0]
        if not isinstance(other, str) or other not in self._scene.groups:
            raise NotReadError("a group cannot stand inside a point")
        if self._scene.asset(other) in PERSONS or (
            self._scene.asset(other) not in ROOFED and self._scene.asset(group) not in PERSONS
        ):
            raise NotReadError("nobody stands inside of that")
        self._draft.put(("actors", group, "placement", "inside", "of"), other, part.span)

    def _apart(self, group: str, part: Part) -> None:
        self._several(group)
        length = part.first("length")
        self._draft.vary(
            ("actors", group, "placement", "spread_m"), length.low, length.low, part.span, unit="m"
        )
        size_m = ASSETS[self._scene.asset(group)].length_m
        if size_m > MAX_SHARE_OF_SIZE * length.low:
            self._draft.remark(part.span, f"measured between their centres; each is {size_m:g} m long")

    def _together(self, group: str, part: Part) -> None:
        self._several(group)
        high = part.first("length").high
        self._draft.vary(("actors", group, "placement", "extent_m"), high, high, part.span, unit="m")

    def _several(self, group: str) -> None:
        if self._scene.count(group) == 1:
            raise NotReadError("a group of one has no distance between members")

    def _road(self, group: str, part: Part) -> None:
        if part.form.kind == "along":
            self._roads.along(group, part)
        else:
            self._roads.place(group, part, part.form.kind)

    def _parallel(self, group: str, part: Part) -> None:
        self._roads.parallel(group, part)

    # Motion.

    def _moves(self, group: str, part: Part) -> MotionWords | None:
        """Set the motion and speed that a part states, for what can move."""
        motion, speed = part.first("motion"), part.first("speed")
        if motion is not None and motion.kind != "still" and self._scene.asset(group) in IMMOVABLE:
            raise NotReadError(f"a {self._scene.asset(group)} does not move")
        if motion is not None:
            self._draft.put(("actors", group, "motion", "kind"), motion.kind, part.span)
        if speed is not None:
            self._put_speed(group, speed, part.span)
        elif motion is not None and motion.speed_mps is not None:
            self._draft.reading = part.span
            self._draft.put(("actors", group, "motion", "speed_mps"), motion.speed_mps, None, OWN_SPEED)
        return motion if isinstance(motion, MotionWords) else None

    def _put_speed(self, group: str, speed: Quantity, span: Span) -> None:
        path: FieldPath = ("actors", group, "motion", "speed_mps")
        self._draft.vary(path, speed.low, speed.high, span, unit="m/s")

    def _motion(self, group: str, part: Part) -> None:
        motion, length = self._moves(group, part), part.first("length")
        if motion is not None and motion.way:
            self._draft.remark(
                part.span, "a patrol without points: walks about, within 25 m of where it starts"
            )
        if length is not None:
            self._draft.vary(
                ("actors", group, "motion", "radius_m"), length.high, length.high, part.span, unit="m"
            )

    def _speed(self, group: str, part: Part) -> None:
        if ("actors", group, "motion", "kind") not in self._draft.entries:
            self._draft.put(("actors", group, "motion", "kind"), "wander", part.span)
        self._put_speed(group, part.first("speed"), part.span)

    def _patrol(self, group: str, part: Part) -> None:
        self._moves(group, part)
        self._roads.route(group, [self._places.point(place) for place in part.first("way")], part.span)

    def _travel(self, group: str, part: Part) -> None:
        self._moves(group, part)
        self._roads.travel(group, part.first("direction"), part.span)

    def _moment(self, group: str, part: Part) -> None:
        """Set a time of a group's motion; what sets off or halts does move."""
        base: FieldPath = ("actors", group, "motion")
        if (*base, "kind") not in self._draft.entries:
            self._draft.put((*base, "kind"), "wander", None, "the text says when it moves")
        self._draft.put((*base, part.form.kind), part.first("moment"), part.span)

    # What it is.

    def _role(self, group: str, part: Part) -> None:
        self._scene.set_role(group, Role(part.first("role")), part.span)

    def _role_as(self, group: str, part: Part) -> None:
        word = part.words[-1]
        if word == "clutter":
            role = Role.CLUTTER
        else:
            role = Role.BYSTANDER if word.startswith("bystander") else Role.ADVERSARY
        if self._scene.role(group) is not role:
            self._scene.set_role(group, role, part.span)
        self._draft.acknowledge(part.span)

    def _density(self, group: str, part: Part) -> None:
        number = part.first("number")
        self._scene.put_density(group, Quantity("COUNT", number, number), part.first("per_area"), part.span)

    def _present(self, group: str, part: Part) -> None:
        self._draft.acknowledge(part.span)


def names_itself(part: Part, groups: Sequence[str], scene: Scene) -> bool:
    """Whether a predicate is a relation to one of the groups before it, so that it is said of the last one alone."""
    phrases = [part.first(name) for name in ("reference", "first", "second")]
    return any(
        phrase is not None
        and not isinstance(phrase, Coordinates)
        and (bool(phrase.pronoun) or any(scene.groups[group].entry in phrase.entries for group in groups))
        for phrase in phrases
    )
