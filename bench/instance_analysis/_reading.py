"""Phrases to fields: who is spoken of, sentence by sentence, and what is said of mission, reports, orders and rules."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bench.simspec import Role, Rules

from ._draft import Draft, Path
from ._ground import Ground
from ._phrases import Part, Phrase, Quantity
from ._sky import Sky
from ._tokens import Span, Word
from ._traits import Traits, length_of
from ._vocabulary import EventWords, FieldWords, Meaning, SetWords, Vocabulary

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
        self.sky = Sky(draft)
        self.ground = Ground(draft, vocabulary.defaults)
        self.traits = Traits(draft, vocabulary.defaults, self.ground, self)
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
            if one.rule in Traits.RULES and not self.here and later and one.rule != "density":
                self.waiting.append(one)
                continue
            if one.rule == "group":
                before = self.joined if joins else []
                self._group(one)
                self.joined = [*before, *self.subject]
                for waiting in self.waiting:
                    self._of_group(waiting)
                self.waiting = []
            elif one.rule in Traits.RULES:
                self._of_group(one)
                self.joined = []
            else:
                handler = self._handler(one.rule)
                handler(one)
                self.joined = []
            joins = False
        for waiting in self.waiting:
            self._of_group(waiting)

    def _handler(self, rule: str) -> Callable[[Phrase], None]:
        """Who reads a phrase that is said of no group: the method of its name here, of the sky, or of the ground."""
        if rule in Sky.RULES:
            found: Callable[[Phrase], None] = getattr(self.sky, rule)
        elif rule == "area":
            found = self.ground.area
        else:
            found = getattr(self, f"_{rule}")
        return found

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
            self.density_of(group, count, per, phrase.span)
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

    def density_of(self, group: str, count: Part, per: Part, span: Span) -> None:
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
            self.traits.moves(group, part, None)

    def ref(self, phrase: Phrase) -> list[str] | None:
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
            getattr(self.traits, phrase.rule)(group, phrase)

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
        groups = self.subject if of_subject else self.ref(phrase) or []
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
        length = length_of(self.draft, phrase)
        self.mission = True
        self.draft.vary(("mission", "altitude_m"), length.low, length.high, phrase.span, unit="m")

    def _speed(self, phrase: Phrase) -> None:
        part = phrase.first("SPEED")
        assert part is not None
        assert isinstance(part.value, Quantity)
        if self.here and self.subject and not self.mission and not phrase.first("FLY"):
            for group in self.subject:
                self.draft.put(("actors", group, "motion", "kind"), "wander", phrase.span)
                self.traits.say_speed(group, part.value, phrase.span)
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
                self.traits.atleast(group, phrase)
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
        self.sky.finish()
        self.ground.finish()
        self._ceiling()

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
