"""Phrases to fields: who is spoken of, what is said of whom, and what cannot be said in a SimSpec."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence
from typing import Any

from bench.simspec import Environment, Origin, Role, Rules

from ._draft import Draft, Path, Varied
from ._light import sun_moment
from ._phrases import Part, Phrase, Quantity
from ._tokens import Clock, Span, Word
from ._vocabulary import EventWords, FieldWords, Meaning, MotionWords, SetWords, Vocabulary, WeatherWords

RELATIONS = frozenset(
    [
        "near",
        "within",
        "atleast",
        "exact",
        "away",
        "mean",
        "bearing",
        "part",
        "road",
        "inside",
        "behind",
        "facing",
        "hidden",
        "visible",
        "between",
        "apart",
        "spread",
    ]
)
OF_A_GROUP = RELATIONS | {"motion", "radius", "concealment", "density"}
PLURALS = frozenset(
    [
        "people",
        "persons",
        "men",
        "women",
        "children",
        "infantrymen",
        "gunmen",
        "insurgents",
        "troops",
        "civs",
        "pax",
        "civvies",
        "schoolchildren",
    ]
)
DENIALS = frozenset(
    ["not", "never", "nor", "neither", "isn't", "aren't", "don't", "doesn't", "won't", "cannot", "can't", "if", "unless"]
)
DEFINITE = ("the", "these", "those", "both", "all", "that", "this", "same", "said")
UNITS = {
    "LENGTH": {"m": 1.0, "ft": 0.3048},
    "SPEED": {"m/s": 1.0, "km/h": 1 / 3.6, "knots": 0.514444},
    "TIME": {"s": 1.0, "min": 60.0},
}
UNIT_NAMES = {"LENGTH": "m", "TIME": "s", "SPEED": "m/s", "ANGLE": "deg"}
WEAK = frozenset(
    [
        "OF",
        "TO",
        "AT",
        "FOR",
        "IN",
        "AND",
        "OR",
        "FROM",
        "HOME",
        "THEM",
        "COMMA",
        "DASH",
        "STOP",
        "ABOUT",
        "OVER",
        "BY",
        "AWAY",
        "PART",
        "FLY",
        "UNTIL",
        "AFTER",
        "BEFORE",
        "SQUARE",
        "DENSITYOF",
        "KEEP",
        "AREAWORD",
        "INTEL",
        "TARGET",
        "LBR",
        "RBR",
        "ALONG",
        "SEEN",
        "MORETHAN",
        "ONAVERAGE",
    ]
)
OWN_SPEED = "the word's own speed"
NO_SUCH_FIELD = "a SimSpec has no relation for this yet"


class Reader:
    """Reads the phrases of a text into a draft, sentence by sentence."""

    def __init__(self, draft: Draft, vocabulary: Vocabulary) -> None:
        self.draft, self.vocabulary = draft, vocabulary
        self.groups: dict[str, str] = {}
        """Ids of the groups, and the vocabulary's name of each."""
        self.plural: set[str] = set()
        self.subject: list[str] = []
        self.joined: list[str] = []
        self.here = False
        self.mission = False
        self.reporting = False
        self.report: str | None = None
        self.pending: list[tuple[str, Quantity, Span]] = []
        self.waiting: list[Phrase] = []
        self.events: dict[str, int] = {}
        self.day: tuple[dt.date, Span] | None = None
        self.clock: tuple[Clock, Span] | None = None
        self.sun: tuple[str, Quantity | None, int, Span] | None = None
        self.parts: list[tuple[str, float, Span]] = []
        self.road: Span | None = None
        self.meant: dict[Span, list[str] | None] = {}

    def read(self, found: Sequence[Phrase | Word]) -> None:
        """Read everything; the draft then has all but what `finish` adds."""
        sentences: list[list[Phrase | Word]] = [[]]
        for one in found:
            if isinstance(one, Word) and any(m.kind == "STOP" for m in one.meanings):
                sentences.append([])
            else:
                sentences[-1].append(one)
        for sentence in sentences:
            self._sentence(sentence)
        self.finish()

    def _sentence(self, sentence: list[Phrase | Word]) -> None:
        self.here, self.joined, self.waiting = False, [], []
        self.reporting = any(isinstance(one, Word) and one.text.lower().startswith("report") for one in sentence)
        joins = False
        for index, one in enumerate(sentence):
            if isinstance(one, Word):
                # After a comma, `and` begins another clause.
                joins = (not one.comma and any(m.kind == "AND" for m in one.meanings)) or (joins and one.filler)
                self._relative(one, sentence[index - 1] if index else None)
                if not self._late_count(one, sentence[index - 1] if index else None):
                    self._word(one)
                continue
            if self._denied(sentence[:index]):
                self.draft.unread(one.span, "what is denied, or only perhaps so, is not read", expressible=True)
                continue
            later = any(isinstance(p, Phrase) and p.rule == "group" for p in sentence[index + 1 :])
            if one.rule in OF_A_GROUP and not self.here and later and one.rule != "density":
                self.waiting.append(one)
                continue
            if one.rule == "group":
                before = self.joined if joins else []
                self._group(one)
                self.joined = [*before, *self.subject]
                for waiting in self.waiting:
                    self._of_group(waiting)
                self.waiting = []
            elif one.rule in OF_A_GROUP:
                self._of_group(one)
                self.joined = []
            else:
                handler: Callable[[Phrase], None] = getattr(self, f"_{one.rule}")
                handler(one)
                self.joined = []
            joins = False
        for waiting in self.waiting:
            self._of_group(waiting)

    def _denied(self, before: Sequence[Phrase | Word]) -> bool:
        """Whether what follows is said not to be so, or only perhaps: taking it at its word would say something else."""
        for one in reversed(before):
            if not isinstance(one, Word):
                return False
            if one.text.lower() in DENIALS or any(meaning.kind == "NONE" for meaning in one.meanings):
                return True
            if not one.filler and one.text not in ("a", "an", "it"):
                return False
        return False

    def _relative(self, word: Word, before: Phrase | Word | None) -> None:
        """`near a truck that is camouflaged` speaks of the truck from then on."""
        if word.text.lower() in ("that", "which", "who") and isinstance(before, Phrase) and before.refs:
            meant = self.meant.get(before.refs[-1].span)
            if meant:
                self.subject, self.here, self.joined = meant, True, []

    def _late_count(self, word: Word, before: Phrase | Word | None) -> bool:
        """A number right after a group that has none says how many: `soldiers: 4`, `medics, two`."""
        count = next((one.value for one in word.meanings if one.kind == "COUNT"), None)
        if not isinstance(count, Quantity) or not isinstance(before, Phrase) or before.rule != "group" or len(self.subject) != 1:
            return False
        path: Path = ("actors", self.subject[0], "count")
        entry = self.draft.entries.get(path)
        if entry is None or entry.span is not None:
            return False
        self.draft.ranges = [one for one in self.draft.ranges if f"actors[{self.subject[0]}].count" not in one.paths]
        self.draft.vary(path, count.low, count.high, before.span.joined(word.span), unit=None, integer=True)
        return True

    def _word(self, word: Word) -> None:
        kinds = {one.kind for one in word.meanings}
        if "HOME" in kinds:
            self.here, self.mission, self.subject = False, True, []
        elif "THEM" in kinds and self.subject:
            self.here = True
        elif "TARGET" in kinds:
            adversaries = self._of_role(Role.ADVERSARY)
            if adversaries:
                self.subject, self.here, self.mission = self._one_of(adversaries, word.span), True, False
        if "FLY" in kinds:
            self.mission = True
        if word.filler or kinds & WEAK or word.text in ("a", "an"):
            return
        self.draft.unread(word.span, "nobody knows this here" if not kinds else "stands by itself", expressible=True)

    # Who is spoken of.

    def _of_role(self, role: Role) -> list[str]:
        return [one for one, name in self.groups.items() if self.vocabulary.role(name) is role]

    def _one_of(self, ids: list[str], span: Span) -> list[str]:
        if len(ids) == 1:
            return ids
        chosen = self.draft.ask(span, f"which one is meant by {self.draft.quote(span)!r}?", [*ids, "all of them"])
        return ids if chosen == len(ids) else [ids[chosen]]

    def _thing(self, phrase: Phrase) -> tuple[str, Span]:
        if part := phrase.first("ASSET"):
            return str(part.value), part.span
        part = phrase.first("AMBIGUOUS")
        assert part is not None
        assert isinstance(part.value, tuple)
        quote = self.draft.quote(part.span)
        known = [name for name in part.value if name in self.groups.values()]
        if len(known) == 1 and self._definite(part.span):
            return known[0], part.span
        readings = [f"{self.vocabulary.assets[one].asset} ({self.vocabulary.assets[one].role})" for one in part.value]
        if self._definite(part.span):
            readings.append("the drone under test")
        chosen = self.draft.ask(part.span, f"what is meant by {quote!r}?", readings)
        return (str(part.value[chosen]) if chosen < len(part.value) else ""), part.span

    def _definite(self, span: Span) -> bool:
        before = self.draft.text[: span.start].rstrip().lower().split()
        return bool(before) and before[-1].strip(",;:(") in DEFINITE

    def _is_plural(self, span: Span) -> bool:
        last = self.draft.quote(span).lower().split()[-1]
        return last in PLURALS or (last.endswith("s") and not last.endswith("ss"))

    def _named(self, phrase: Phrase) -> list[str]:
        """The group or groups that a phrase names: those there are, or a new one."""
        name, span = self._thing(phrase)
        if not name:
            self.mission = True
            return []
        count, none = phrase.first("COUNT"), phrase.first("NONE")
        known = [one for one, other in self.groups.items() if other == name]
        if known and not none and (count is None or self._definite(phrase.span)) and phrase.first("PERAREA") is None:
            return self._one_of(known, span)
        if phrase.rule == "ref" and count and self.draft.quote(count.span).lower() in ("a", "an"):
            several = [one for one in known if one in self.plural]
            if several:  # near a crate, where there are crates: near some member
                return self._one_of(several, span)
        if none or (count and isinstance(count.value, Quantity) and count.value.high == 0):
            return []
        if phrase.rule == "group" and count and (earlier := self._uncounted(known)) and not phrase.first("PERAREA"):
            readings = [f"the same as {earlier!r} before, whose number was not said", "others"]
            if self.draft.ask(phrase.span, "who is this?", readings) == 0:
                self._recount(earlier, phrase, count, span)
                return [earlier]
        return [self._new(phrase, name, span, count)]

    def _uncounted(self, known: Sequence[str]) -> str | None:
        """The one group of these whose number has not been said; None where there is none, or more."""
        counts = [(one, self.draft.entries.get(("actors", one, "count"))) for one in known]
        uncounted = [one for one, count in counts if count is not None and count.span is None]
        return uncounted[0] if len(uncounted) == 1 else None

    def _recount(self, group: str, phrase: Phrase, count: Part, span: Span) -> None:
        self.draft.ranges = [one for one in self.draft.ranges if f"actors[{group}].count" not in one.paths]
        self._count(group, phrase, count, span)

    def _new(self, phrase: Phrase, name: str, span: Span, count: Part | None) -> str:
        words = self.vocabulary.assets[name]
        number = 1 + sum(1 for one in self.groups.values() if one == name)
        group = name if number == 1 else f"{name}-{number}"
        self.groups[group] = name
        put = self.draft.put
        put(("actors", group, "id"), group, span)
        put(("actors", group, "asset"), words.asset, span)
        put(("actors", group, "role"), str(words.role), span)
        if phrase.rule == "group" and (per := phrase.first("PERAREA")):
            if count is None:
                self.draft.fault(phrase.span, "says per area, and not how many", "write a number before it")
                return group
            self._density_of(group, count, per, phrase.span)
            self.plural.add(group)
            return group
        self._count(group, phrase, count, span)
        return group

    def _count(self, group: str, phrase: Phrase, count: Part | None, span: Span) -> None:
        path: Path = ("actors", group, "count")
        if count is None or not isinstance(count.value, Quantity):
            if self._is_plural(span):
                few, most = self._some()
                self.plural.add(group)
                self.draft.vary(path, few, most, None, unit=None, integer=True, note="how many is not said; taken for some")
            else:
                self.draft.put(path, 1, span)
            return
        quantity = count.value
        low, high = quantity.low, quantity.high
        where = count.span.joined(span)
        if bound := phrase.first("ATLEAST"):
            readings = [f"{low:g}", f"{low:g} to {2 * low:g}"]
            high = (
                low if self.draft.ask(bound.span.joined(where), "no upper bound is given; how many?", readings) == 0 else 2 * low
            )
        elif phrase.first("WITHIN") and quantity.single:
            low = 0.0
        if high > 1:
            self.plural.add(group)
        self.draft.vary(path, low, high, where, unit=None, integer=True)

    def _some(self) -> tuple[int, int]:
        meaning = next((m for m in self.vocabulary.meanings.get("some", ()) if m.kind == "VAGUE"), Meaning("VAGUE", (2, 10)))
        assert isinstance(meaning.value, tuple)
        return int(meaning.value[0]), int(meaning.value[1])

    def _density_of(self, group: str, count: Part, per: Part, span: Span) -> None:
        assert isinstance(count.value, Quantity)
        assert isinstance(per.value, float | int)
        self.draft.entries.pop(("actors", group, "count"), None)
        self.draft.ranges = [one for one in self.draft.ranges if f"actors[{group}].count" not in one.paths]
        low, high = count.value.low * per.value, count.value.high * per.value
        self.draft.vary(("actors", group, "density_per_km2"), low, high, span, unit="1/km2")

    def _group(self, phrase: Phrase) -> None:
        self.mission = False
        self.subject = self._named(phrase)
        self.here = bool(self.subject)
        for group in self.subject:
            self._adjectives(group, phrase)

    def _adjectives(self, group: str, phrase: Phrase) -> None:
        for part in phrase.every("CONCEAL"):
            self.draft.put(("actors", group, "concealment"), part.value, part.span)
        for part in phrase.every("MOTION"):
            self._moves(group, part, None)

    def _ref(self, phrase: Phrase) -> list[str] | None:
        """Ids of the groups that a relation is to; None for the vehicle's start."""
        ref = phrase.refs[0] if phrase.rule != "ref" else phrase
        if ref.span not in self.meant:  # one phrase said of several groups is to one and the same
            self.meant[ref.span] = self._meant(ref)
        return self.meant[ref.span]

    def _meant(self, ref: Phrase) -> list[str] | None:
        if ref.first("HOME"):
            return None
        if target := ref.first("TARGET"):
            adversaries = [one for one in self._of_role(Role.ADVERSARY) if one not in self.subject]
            if not adversaries:
                name = self._new_target(target.span)
                return [name]
            return self._one_of(adversaries, target.span)
        if them := ref.first("THEM"):
            others = [one for one in self.groups if one not in self.subject]
            single = self.draft.quote(them.span).lower() == "it"
            fitting = [one for one in others if (one not in self.plural) == single] or others
            if not fitting:
                self.draft.unread(them.span, "there is nothing before it that it could mean", expressible=True)
                return []
            return self._one_of(fitting, them.span)
        found = self._named(ref)
        for group in found:
            self._adjectives(group, ref)
        return found

    def _new_target(self, span: Span) -> str:
        adversaries = [name for name, one in self.vocabulary.assets.items() if one.role is Role.ADVERSARY]
        chosen = self.draft.ask(span, "what is the target?", [self.vocabulary.assets[one].asset for one in adversaries])
        return self._new(Phrase("ref", (), span), adversaries[chosen], span, Part("COUNT", Quantity("COUNT", 1.0, 1.0), span))

    # What is said of a group.

    def _of_group(self, phrase: Phrase) -> None:
        subject = self.subject
        if not subject:
            self.draft.unread(phrase.span, "it is not said of whom", expressible=True)
            return
        if len(self.joined) > 1 and phrase.rule not in ("road", "spread") and self.joined[-1:] == subject[-1:]:
            readings = [", ".join(subject), ", ".join(self.joined)]
            if self.draft.ask(phrase.span, "of whom is this said?", readings) == 1:
                subject = list(self.joined)
        for group in subject:
            getattr(self, f"_{phrase.rule}")(group, phrase)

    def _distance(
        self, group: str, phrase: Phrase, low: float, high: float | None, *, every: bool = False, note: str = ""
    ) -> None:
        of = self._ref(phrase)
        if of is None:
            self.draft.unread(phrase.span, "a SimSpec has no distance to the vehicle's start")
            return
        for other in of:
            self._keep(group, other, phrase.span, low, high, every=every, note=note)

    def _keep(self, group: str, other: str, span: Span, low: float, high: float | None, *, every: bool, note: str) -> None:
        if other == group:
            self.draft.unread(span, "a group has no distance to itself")
            return
        base: Path = ("actors", group, "placement")
        low, high = round(low, 6), None if high is None else round(high, 6)
        defaulted = span if note != "default" else None
        if not every and (*base, "near", "of") not in self.draft.entries:
            where: Path = (*base, "near")
        else:
            number = sum(1 for path in self.draft.entries if path[:4] == (*base, "distances") and path[-1] == "of")
            where = (*base, "distances", number)
            self.draft.put((*where, "whom"), "every" if every else "some", span)
        self.draft.put((*where, "of"), other, span)
        if low > 0.0:
            self.draft.put((*where, "min_m"), low, span, note)
        if high is not None:
            self.draft.put((*where, "max_m"), high, defaulted, "what near means" if defaulted is None else note)

    def _length(self, phrase: Phrase) -> Quantity:
        part = phrase.first("LENGTH")
        assert part is not None
        assert isinstance(part.value, Quantity)
        if part.value.low > part.value.high:
            self.draft.fault(part.span, "the range runs downwards", "write the lower number first")
        return part.value

    def _near(self, group: str, phrase: Phrase) -> None:
        self._distance(group, phrase, 0.0, self.vocabulary.defaults.near_m, note="default")

    def _within(self, group: str, phrase: Phrase) -> None:
        length = self._length(phrase)
        self._distance(group, phrase, 0.0 if length.single else length.low, length.high)

    def _atleast(self, group: str, phrase: Phrase) -> None:
        if not phrase.refs:
            self.draft.unread(phrase.span, "it is not said from what")
            return
        self._distance(group, phrase, self._length(phrase).low, None, every=True)

    def _band(self, length: Quantity) -> tuple[float, float, str]:
        if not length.single:
            return length.low, length.high, ""
        share = self.vocabulary.defaults.exact_share
        return length.low * (1 - share), length.high * (1 + share), f"{length.low:g} m within {share:.0%}"

    def _exact(self, group: str, phrase: Phrase) -> None:
        low, high, note = self._band(self._length(phrase))
        self._distance(group, phrase, low, high, note=note)

    def _away(self, group: str, phrase: Phrase) -> None:
        others = [one for one in self.groups if one != group]
        low, high, note = self._band(self._length(phrase))
        readings = [*others, "the vehicle's start"]
        chosen = self.draft.ask(phrase.span, "away from what?", readings) if others else 0
        if chosen == len(others):
            self.draft.unread(phrase.span, "a SimSpec has no distance to the vehicle's start")
        else:
            self._keep(group, others[chosen], phrase.span, low, high, every=False, note=note)

    def _mean(self, group: str, phrase: Phrase) -> None:
        length, of = self._length(phrase), self._ref(phrase)
        if not of:
            self.draft.unread(phrase.span, "a SimSpec has no distance to the vehicle's start")
            return
        base: Path = ("actors", group, "placement", "mean_distance")
        self.draft.put((*base, "of"), of[0], phrase.span)
        self.draft.vary((*base, "mean_m"), length.low, length.high, phrase.span, unit="m")

    def _bearing(self, group: str, phrase: Phrase) -> None:
        part = phrase.first("DIR")
        assert part is not None
        assert isinstance(part.value, float | int)
        half = 45.0 if part.value % 90 == 0 else 22.5
        of = self._ref(phrase)
        base: Path = ("actors", group, "placement", "bearing")
        self._seen(base, of, phrase.span)
        self.draft.put((*base, "from_deg"), (part.value - half) % 360, phrase.span)
        self.draft.put((*base, "to_deg"), (part.value + half) % 360, phrase.span)
        if phrase.first("LENGTH") and of:
            low, high, note = self._band(self._length(phrase))
            self._keep(group, of[0], phrase.span, low, high, every=False, note=note)
        elif phrase.first("LENGTH"):
            self.draft.unread(phrase.span, "a SimSpec has no distance to the vehicle's start")

    def _seen(self, base: Path, of: list[str] | None, span: Span) -> None:
        if of is None:
            self.draft.put((*base, "point"), {"east_m": 0.0, "north_m": 0.0}, span, "the vehicle's start")
        elif of:
            self.draft.put((*base, "of"), of[0], span)

    def _part(self, group: str, phrase: Phrase) -> None:
        part = phrase.first("DIR")
        assert part is not None
        assert isinstance(part.value, float | int)
        self.parts.append((group, float(part.value), phrase.span))

    def _road(self, group: str, phrase: Phrase) -> None:
        base: Path = ("actors", group, "placement", "along")
        self.draft.put((*base, "road"), "road", phrase.span)
        self.draft.put((*base, "where"), "beside" if phrase.first("BESIDE") else "on", phrase.span)
        self.road = self.road or phrase.span

    def _inside(self, group: str, phrase: Phrase) -> None:
        if phrase.refs:
            self._ref(phrase)
            self.draft.unread(phrase.span, "actors' footprints never overlap: nobody can stand inside another")

    def _behind(self, group: str, phrase: Phrase) -> None:
        of = self._ref(phrase)
        if not of:
            self.draft.unread(phrase.span, NO_SUCH_FIELD)
            return
        base: Path = ("actors", group, "placement", "hidden_from")
        near = f"near {of[0]}"
        if len(phrase.refs) > 1:
            self._seen(base, self._ref(phrase.refs[1]), phrase.span)
        else:
            readings = [f"{near}, out of sight of the vehicle's start", f"{near}, on whichever side"]
            if self.draft.ask(phrase.span, "behind it as seen from where?", readings) == 0:
                self._seen(base, None, phrase.span)
        self._keep(group, of[0], phrase.span, 0.0, self.vocabulary.defaults.near_m, every=False, note="default")

    def _facing(self, group: str, phrase: Phrase) -> None:
        if not phrase.refs:
            self.draft.unread(phrase.span, "actors can face a group or a point, not a direction")
            return
        self._seen(("actors", group, "placement", "facing"), self._ref(phrase), phrase.span)

    def _hidden(self, group: str, phrase: Phrase) -> None:
        self._seen(("actors", group, "placement", "hidden_from"), self._ref(phrase), phrase.span)

    def _visible(self, group: str, phrase: Phrase) -> None:
        self._seen(("actors", group, "placement", "visible_from"), self._ref(phrase), phrase.span)

    def _between(self, group: str, phrase: Phrase) -> None:
        for ref in phrase.refs:
            self._ref(ref)
        self.draft.unread(phrase.span, NO_SUCH_FIELD)

    def _apart(self, group: str, phrase: Phrase) -> None:
        self.draft.vary(
            ("actors", group, "placement", "spread_m"), (q := self._length(phrase)).low, q.high, phrase.span, unit="m"
        )

    def _spread(self, group: str, phrase: Phrase) -> None:
        """Anywhere in the area, which is what a group without a relation has."""

    def _density(self, group: str, phrase: Phrase) -> None:
        count, per = phrase.first("COUNT"), phrase.first("PERAREA")
        assert count is not None
        assert per is not None
        self._density_of(group, count, per, phrase.span)

    def _motion(self, group: str, phrase: Phrase) -> None:
        motion = phrase.first("MOTION")
        assert motion is not None
        speed = phrase.first("SPEED")
        self._moves(group, motion, speed)

    def _radius(self, group: str, phrase: Phrase) -> None:
        base: Path = ("actors", group, "motion")
        kind = self.draft.entries.get((*base, "kind"))
        if kind is None or kind.value != "wander":
            self.draft.unread(phrase.span, "it is not said of what", expressible=True)
            return
        length = self._length(phrase)
        self.draft.vary((*base, "radius_m"), length.low, length.high, phrase.span, unit="m")

    def _say_speed(self, group: str, quantity: Quantity, span: Span) -> None:
        """A speed that is said goes before the one that `driving` has by itself."""
        path: Path = ("actors", group, "motion", "speed_mps")
        before = self.draft.entries.get(path)
        if before is not None and before.note == OWN_SPEED:
            del self.draft.entries[path]
        self.draft.vary(path, quantity.low, quantity.high, span, unit="m/s")

    def _moves(self, group: str, part: Part, speed: Part | None) -> None:
        assert isinstance(part.value, MotionWords)
        base: Path = ("actors", group, "motion")
        self.draft.put((*base, "kind"), part.value.kind, part.span)
        if speed is not None and isinstance(speed.value, Quantity):
            self._say_speed(group, speed.value, speed.span)
        elif part.value.speed_mps is not None and (*base, "speed_mps") not in self.draft.entries:
            self.draft.put((*base, "speed_mps"), part.value.speed_mps, part.span, OWN_SPEED)

    def _concealment(self, group: str, phrase: Phrase) -> None:
        path: Path = ("actors", group, "concealment")
        given = phrase.first("PERCENT") or phrase.first("COUNT")
        if given is not None and isinstance(given.value, Quantity):
            self.draft.vary(path, given.value.low, given.value.high, phrase.span, unit=None)
        elif word := phrase.first("CONCEAL"):
            self.draft.put(path, word.value, phrase.span)

    # What is said of the rest.

    def _field(self, phrase: Phrase) -> None:
        word = phrase.first("FIELD")
        given = next(one for one in phrase.parts if isinstance(one, Part) and isinstance(one.value, Quantity))
        assert word is not None
        assert isinstance(word.value, tuple)
        assert isinstance(given.value, Quantity)
        quantity, fields = given.value, [one for one in word.value if isinstance(one, FieldWords)]
        fitting = [one for one in fields if _fits(one, quantity)]
        if not fitting and quantity.kind == "COUNT":
            field = fields[0]
            if field.kind not in UNITS:
                self.draft.fault(phrase.span, f"{field.path} takes a number with a unit", "write its unit")
                return
            units = UNITS[field.kind]
            chosen = list(units)[self.draft.ask(phrase.span, "in which unit?", list(units))]
            low, high = (round(one * units[chosen], 6) for one in (quantity.low, quantity.high))
            quantity, fitting = Quantity(field.kind, low, high), [field]
        if not fitting:
            wanted = " or ".join(sorted({f"{one.path} is a {one.kind.lower()}" for one in fields}))
            self.draft.fault(phrase.span, f"{wanted}, not a {quantity.kind.lower()}", "give it in a unit that fits")
            return
        field = fitting[0]
        if field.path.startswith("intelligence."):
            self._of_report(field.path.split(".")[1], quantity, phrase.span)
            return
        self.mission = self.mission or field.path.startswith("mission.")
        whole = field.path == "seeds.root"
        unit = UNIT_NAMES.get(field.kind)
        self.draft.vary(tuple(field.path.split(".")), quantity.low, quantity.high, phrase.span, unit=unit, integer=whole)

    def _of_report(self, name: str, quantity: Quantity, span: Span) -> None:
        if self.report is None:
            self.pending.append((name, quantity, span))
            return
        path: Path = ("intelligence", self.report, name)
        unit = {"latency_s": "s", "delivered_s": "s", "uncertainty_m": "m"}.get(name)
        self.draft.vary(path, quantity.low, quantity.high, span, unit=unit, integer=name == "priority")

    def _intelligence(self, phrase: Phrase) -> None:
        of_subject = self.subject and phrase.refs[0].first("THEM")
        groups = self.subject if of_subject else self._ref(phrase) or []
        if not self.here:
            self.subject = groups
        for group in groups:
            if self.vocabulary.role(self.groups[group]) is Role.CLUTTER:
                self.draft.unread(phrase.span, "intelligence here is about adversaries or bystanders")
                continue
            report = f"{group}-sighting"
            self.report = report
            self.draft.put(("intelligence", report, "id"), report, phrase.span)
            self.draft.put(("intelligence", report, "about"), group, phrase.span)
            pending, self.pending = self.pending, []
            for name, quantity, span in pending:
                self._of_report(name, quantity, span)

    def _altitude(self, phrase: Phrase) -> None:
        length = self._length(phrase)
        self.mission = True
        self.draft.vary(("mission", "altitude_m"), length.low, length.high, phrase.span, unit="m")

    def _speed(self, phrase: Phrase) -> None:
        part = phrase.first("SPEED")
        assert part is not None
        assert isinstance(part.value, Quantity)
        if self.here and self.subject and not self.mission and not phrase.first("FLY"):
            for group in self.subject:
                self.draft.put(("actors", group, "motion", "kind"), "wander", phrase.span)
                self._say_speed(group, part.value, phrase.span)
            return
        self.draft.vary(("mission", "speed_mps"), part.value.low, part.value.high, phrase.span, unit="m/s")

    def _limit(self, phrase: Phrase) -> None:
        part = phrase.first("TIME")
        assert part is not None
        assert isinstance(part.value, Quantity)
        readings = ["the time limit of the mission", "the time from intelligence to the report on it"]
        if self.reporting and self.draft.ask(phrase.span, "which time is this?", readings) == 1:
            self.draft.vary(("rules", "report_deadline_s"), part.value.low, part.value.high, phrase.span, unit="s")
            return
        self.draft.vary(("mission", "time_limit_s"), part.value.low, part.value.high, phrase.span, unit="s")

    def _set(self, phrase: Phrase) -> None:
        part = phrase.first("SET")
        assert part is not None
        assert isinstance(part.value, SetWords)
        for path, value in part.value.set.items():
            self.draft.put(tuple(path.split(".")), value, phrase.span)

    def _event(self, phrase: Phrase) -> None:
        part = phrase.first("EVENT")
        assert part is not None
        assert isinstance(part.value, EventWords)
        event = part.value
        times = [one.value for one in phrase.every("TIME") if isinstance(one.value, Quantity)]
        kinds = [one.kind for one in phrase.parts if isinstance(one, Part)]
        at: float | None = times[0].low if times else None
        lasting: float | None = times[1].low if len(times) > 1 else None
        if times and not times[0].single:
            lasting = times[0].high - times[0].low
        elif len(times) == 2 and kinds.index("FOR") < kinds.index("TIME"):
            at, lasting = times[1].low, times[0].low
        elif len(times) == 1 and "FOR" in kinds:
            at, lasting = None, times[0].low
        if at is None:
            at = [0.0, 60.0][self.draft.ask(phrase.span, "when?", ["from the start", "60 s after the start"])]
        number = self.events[event.part] = self.events.get(event.part, -1) + 1
        key: str | int = f"{event.kind.replace('_', '-')}-{number + 1}" if event.part == "orders" else number
        base: Path = (*event.part.split("."), key)
        if event.part == "orders":
            self.draft.put((*base, "id"), key, phrase.span)
        self.draft.put((*base, "at_s"), at, phrase.span)
        self.draft.put((*base, "kind"), event.kind, phrase.span)
        if lasting is None and event.part == "outages":
            spans = [10.0, 30.0, 60.0]
            lasting = spans[self.draft.ask(phrase.span, "for how long?", [f"{one:g} s" for one in spans])]
        if lasting is not None and event.part != "orders":
            self.draft.put((*base, "duration_s"), lasting, phrase.span)

    # Weather and light.

    def _weather(self, phrase: Phrase) -> None:
        states = [one for one in phrase.parts if isinstance(one, Phrase)]
        found: list[tuple[str, float, float]] = []
        for state in states:
            found.append(self._state(state, [level for _, level, _ in found]))
        first = found[0]
        if len(found) == 1:
            self.draft.vary(tuple(first[0].split(".")), first[1], first[2], phrase.span, unit="level")
            return
        if any(low != high for _, low, high in found):
            self.draft.fault(phrase.span, "a choice between ranges", "give a level to each")
            return
        paths = list(dict.fromkeys(path for path, _, _ in found))
        for path in paths:
            level = first[1] if path == first[0] else 0.0
            self.draft.put(tuple(path.split(".")), level, phrase.span, "first of several")
        if len(paths) == 1:
            levels = tuple(level for _, level, _ in found)
            self.draft.ranges.append(Varied(name="weather", paths=tuple(paths), levels=levels, unit="level"))
            return
        choices = {
            f"{path.split('.')[1].removesuffix('_level')}-{level:g}": dict.fromkeys(paths, 0.0) | {path: level}
            for path, level, _ in found
        }
        self.draft.ranges.append(Varied(name="weather", choices=choices, unit="level"))

    def _state(self, state: Phrase, before: list[float]) -> tuple[str, float, float]:
        word = state.first("WEATHER")
        assert word is not None
        assert isinstance(word.value, WeatherWords)
        path = word.value.path
        if state.first("NONE"):
            return path, 0.0, 0.0
        intensities = [float(one.value) for one in state.every("INTENSITY") if isinstance(one.value, float | int)]
        if intensities:
            return path, intensities[0], intensities[-1]
        if (count := state.first("COUNT")) and isinstance(count.value, Quantity):
            return path, count.value.low, count.value.high
        if word.value.level is not None:
            return path, word.value.level, word.value.level
        levels = sorted({2.0, 4.0, 7.0, *before})
        names = {2.0: "light", 4.0: "moderate", 7.0: "heavy"}
        readings = [f"level {one:g}" + (f", {names[one]}" if one in names else "") for one in levels]
        level = levels[self.draft.ask(state.span, f"how much {self.draft.quote(word.span)}?", readings)]
        return path, level, level

    def _clear(self, phrase: Phrase) -> None:
        self.draft.put(("environment", "rain_level"), 0.0, phrase.span)
        self.draft.put(("environment", "fog_level"), 0.0, phrase.span)

    def _wind(self, phrase: Phrase) -> None:
        base: Path = ("environment", "wind")
        if (speed := phrase.first("SPEED")) and isinstance(speed.value, Quantity):
            self.draft.vary((*base, "speed_mps"), speed.value.low, speed.value.high, phrase.span, unit="m/s")
        elif (word := phrase.first("WINDS")) and isinstance(word.value, float | int):
            self.draft.put((*base, "speed_mps"), float(word.value), phrase.span)
        else:
            readings = ["3 m/s, light", "6 m/s, moderate", "12 m/s, strong"]
            chosen = self.draft.ask(phrase.span, "how strong is the wind?", readings)
            self.draft.put((*base, "speed_mps"), [3.0, 6.0, 12.0][chosen], phrase.span)
        if direction := phrase.first("DIR"):
            self.draft.put((*base, "from_deg"), direction.value, phrase.span)

    def _calm(self, phrase: Phrase) -> None:
        self.draft.put(("environment", "wind", "speed_mps"), 0.0, phrase.span)

    def _gusts(self, phrase: Phrase) -> None:
        speed = phrase.first("SPEED")
        assert speed is not None
        assert isinstance(speed.value, Quantity)
        path: Path = ("environment", "wind", "turbulence_mps")
        self.draft.vary(path, speed.value.low, speed.value.high, phrase.span, unit="m/s")

    def _sun(self, phrase: Phrase) -> None:
        word, time = phrase.first("SUN"), phrase.first("TIME")
        assert word is not None
        quantity = time.value if time and isinstance(time.value, Quantity) else None
        self.sun = (str(word.value), quantity, -1 if phrase.first("BEFORE") else 1, phrase.span)

    def _clock(self, phrase: Phrase) -> None:
        part = phrase.first("CLOCK")
        assert part is not None
        assert isinstance(part.value, Clock)
        self.clock = (part.value, phrase.span)

    def _date(self, phrase: Phrase) -> None:
        part = phrase.first("DATE")
        assert part is not None
        assert isinstance(part.value, dt.date)
        self.day = (part.value, phrase.span)

    def _area(self, phrase: Phrase) -> None:
        part = phrase.first("DIM") or phrase.first("AREA") or phrase.first("LENGTH")
        assert part is not None
        assert isinstance(part.value, Quantity)
        quantity = part.value
        if quantity.kind != "DIM" and not quantity.single:
            self.draft.fault(phrase.span, "the area is one, not a range", "give one size")
        east = north = quantity.low
        if quantity.kind == "DIM":
            north = quantity.high
        elif quantity.kind == "AREA":
            east = north = quantity.low**0.5
        self.draft.put(("world", "area", "corners"), _corners(east, north), phrase.span)

    # Rules.

    def _of_bystanders(self, phrase: Phrase) -> bool:
        """Whether a rule is about bystanders; a word for them makes no group here."""
        ref = phrase.refs[-1]
        if part := ref.first("ASSET"):
            name = str(part.value)
            return self.vocabulary.role(name) is Role.BYSTANDER
        if ref.first("THEM"):
            return bool(self.subject) and all(self.vocabulary.role(self.groups[one]) is Role.BYSTANDER for one in self.subject)
        return False

    def _rule(self, phrase: Phrase, fields: dict[str, str]) -> None:
        if phrase.refs and not self._of_bystanders(phrase):
            self.draft.unread(phrase.span, "a SimSpec has this rule for bystanders alone")
            return
        for name, kind in fields.items():
            part = phrase.first(kind)
            assert part is not None
            assert isinstance(part.value, Quantity)
            self.draft.vary(("rules", name), part.value.low, part.value.high, phrase.span, unit=UNIT_NAMES[kind])

    def _nomark(self, phrase: Phrase) -> None:
        self._rule(phrase, {"no_mark_within_m": "LENGTH"})

    def _noreport(self, phrase: Phrase) -> None:
        readings = ["do not mark (rules.no_mark_within_m)", "leave it out: a SimSpec has no such rule for reports"]
        if self.draft.ask(phrase.span, "the bench has this rule for marks, not for reports", readings) == 0:
            self._nomark(phrase)
        else:
            self.draft.unread(phrase.span, "a SimSpec has no such rule for reports")

    def _standoff(self, phrase: Phrase) -> None:
        if self.here and self.subject and not self.mission:
            for group in self.subject:
                self._atleast(group, phrase)
            return
        self._rule(phrase, {"bystander_standoff_m": "LENGTH"})

    def _slow(self, phrase: Phrase) -> None:
        self._rule(phrase, {"bystander_slow_within_m": "LENGTH", "bystander_slow_mps": "SPEED"})

    def _loiter(self, phrase: Phrase) -> None:
        self._rule(phrase, {"max_loiter_over_bystander_s": "TIME"})

    # At the end, when everything is known.

    def finish(self) -> None:
        """What depends on several parts of the text: the moment, halves of the area, the road, the ceiling."""
        for _name, _, span in self.pending:
            self.draft.unread(span, "no intelligence is spoken of", expressible=True)
        self._moment()
        self._area_and_halves()
        self._ceiling()

    def _moment(self) -> None:
        usual = Environment().start_utc
        day, where = self.day or (usual.date(), None)
        spans = [one for one in (where, self.clock and self.clock[1], self.sun and self.sun[3]) if one]
        if not spans:
            return
        span = spans[-1]
        if self.sun and self.clock:
            readings = [self.draft.quote(self.clock[1]), self.draft.quote(self.sun[3])]
            if self.draft.ask(self.clock[1].joined(self.sun[3]), "two times of day are given; which holds?", readings) == 0:
                self.sun = None
        path: Path = ("environment", "start_utc")
        note = "" if where else f"on {day}, the default"
        if self.sun:
            self._by_the_sun(day, note)
        elif self.clock:
            clock = self.clock[0]
            zone = "" if clock.zoned else "no zone is given: UTC, the default"
            note = "; ".join(one for one in (note, zone) if one)
            self.draft.put(path, _stamp(dt.datetime.combine(day, clock.at, dt.UTC)), span, note)
        else:
            self.draft.put(path, _stamp(dt.datetime.combine(day, usual.time(), dt.UTC)), span, "at 11:30 UTC, the default")

    def _by_the_sun(self, day: dt.date, note: str) -> None:
        assert self.sun is not None
        what, quantity, sign, span = self.sun
        origin = Origin()
        moment = sun_moment(what, day, origin.latitude_deg, origin.longitude_deg)  # type: ignore[arg-type]
        if moment is None:
            self.draft.fault(span, f"the sun does not {what} there on {day}", "give the time in UTC")
            return
        shifts = [0.0] if quantity is None else [quantity.low] if quantity.single else [quantity.low, quantity.high]
        stamps = [_stamp(moment + sign * dt.timedelta(seconds=one)) for one in shifts]
        self.draft.put(("environment", "start_utc"), stamps[0], span, note)
        if len(stamps) > 1:
            self.draft.ranges.append(Varied(name="start", paths=("environment.start_utc",), levels=tuple(stamps)))

    def _area_and_halves(self) -> None:
        path: Path = ("world", "area", "corners")
        usual = self.vocabulary.defaults
        if path not in self.draft.entries:
            self.draft.put(path, _corners(usual.area_east_m, usual.area_north_m), None)
        corners = self.draft.entries[path].value
        east, north = corners[2]["east_m"], corners[2]["north_m"]
        for group, direction, span in self.parts:
            across, up = _halves(direction)
            region = [
                {"east_m": e, "north_m": n}
                for e, n in (
                    (-east if across <= 0 else 0.0, -north if up <= 0 else 0.0),
                    (east if across >= 0 else 0.0, -north if up <= 0 else 0.0),
                    (east if across >= 0 else 0.0, north if up >= 0 else 0.0),
                    (-east if across <= 0 else 0.0, north if up >= 0 else 0.0),
                )
            ]
            self.draft.put(("actors", group, "placement", "region", "corners"), region, span)
        if self.road:
            ends = [{"east_m": -east, "north_m": 0.0}, {"east_m": east, "north_m": 0.0}]
            self.draft.put(("world", "roads", "road", "id"), "road", self.road)
            self.draft.put(("world", "roads", "road", "points"), ends, None, "through the middle of the area, west to east")
            self.draft.put(("world", "roads", "road", "width_m"), usual.road_width_m, None)

    def _ceiling(self) -> None:
        height = self.draft.entries.get(("mission", "altitude_m"))
        if height is None or height.span is None or ("rules", "max_altitude_m") in self.draft.entries:
            return
        highs = [one.high for one in self.draft.ranges if "mission.altitude_m" in one.paths]
        top = max([height.value, *(one for one in highs if one is not None)])
        usual = Rules().max_altitude_m
        if top > usual:
            readings = [f"rules.max_altitude_m = {top:g}", f"keep the ceiling of {usual:g} m, and the mission at it"]
            if self.draft.ask(height.span, f"it is above the ceiling of {usual:g} m that rules have by default", readings) == 0:
                self.draft.put(("rules", "max_altitude_m"), top, height.span)
            else:
                self.draft.entries.pop(("mission", "altitude_m"))
                self.draft.ranges = [one for one in self.draft.ranges if "mission.altitude_m" not in one.paths]
                self.draft.put(("mission", "altitude_m"), usual, height.span)


def _fits(field: FieldWords, quantity: Quantity) -> bool:
    if field.kind == "NUMBER":
        return quantity.kind in ("COUNT", "PERCENT")
    return quantity.kind == field.kind


def _halves(direction: float) -> tuple[int, int]:
    """Signs of east and north of the half, or quarter, of the area that lies in a direction."""
    across = 0 if direction in (0, 180) else 1 if direction < 180 else -1
    up = 0 if direction in (90, 270) else 1 if direction < 90 or direction > 270 else -1
    return across, up


def _corners(east_m: float, north_m: float) -> list[dict[str, Any]]:
    east, north = round(east_m / 2, 3), round(north_m / 2, 3)
    return [{"east_m": e, "north_m": n} for e, n in ((-east, -north), (east, -north), (east, north), (-east, north))]


def _stamp(moment: dt.datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
