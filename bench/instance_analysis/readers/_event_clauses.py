"""Finds the clauses that tell of an event, whatever the order of their words.

`UAV holds on order at t=60 s, comply within 5 s`: the vocabulary lists the signs of each event. An event claims its
signs, its times and its numbers; all other words of the clause are left to others, or listed. A clause that gives
nothing but times belongs to the event beside it.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span, TimeOfDay, Word
from ..language._vocabulary import EventForm
from ..ledger._loaded_words import loaded_words
from ._clause_runs import Run, SentenceRuns, overlap

NEUTRAL_KINDS = frozenset(
    ["HOME", "THEM", "AT", "FOR", "FROM", "TO", "OF", "IN", "AFTER", "UNTIL", "WITHIN", "AND", "AWAY", "INSIDE", "LAUNCH", "DENSITYOF", "FLY", "ORIGIN", "BY"]
)  # fmt: skip
"""Kinds of words that stand around an event and say nothing by themselves."""
MAX_GAP = 2
"""Words between the signs of an event without a time at most: `the GPS signal is lost`. Chosen."""
MAX_ROLE_CHARACTERS = 120
"""Characters before a time among which the words for its role are looked for. Chosen."""
VALUELESS_KINDS = {"DIR": "DUE"}
"""`to the east` is one word of the vocabulary, and has no value itself."""
NAMING_KINDS = frozenset(["ASSET", "TARGET"])
REPORT_ORDERS = frozenset(["mark", "retask"])
Time = tuple[Quantity, Span]


@dataclass(slots=True)
class _Event:
    """An event in the making: its form, what it has claimed, and its times by what they say."""

    form: EventForm
    run: Run
    claimed: list[Part | Phrase]
    times: dict[str, Time] = field(default_factory=dict)
    complete: bool = False
    """Whether it is an event even without a time."""

    def takes(self, times: dict[str, Time]) -> bool:
        """Whether these times say nothing else than what is known."""
        return all(name not in self.times or self.times[name][0] == time for name, (time, _) in times.items())

    @property
    def phrase(self) -> Phrase:
        """The event with all that it has claimed."""
        neutral = [word.span for word in self.run.words if _is_neutral(word) and not loaded_words(word.text)]
        parts: list[Part | Phrase] = [Part("EVENT", self.form, self.claimed[0].span), *self.claimed]
        for name, (time, span) in self.times.items():
            parts += [Part(name.upper(), None, span), Part("TIME", time, span)]
        begin, end = min(part.span.start for part in parts), max(part.span.end for part in parts)
        return Phrase("event", (*parts, *(Part("SIGN", None, span) for span in neutral)), Span(begin, end))


def events_in(sentence: SentenceRuns, taken: set[int]) -> Iterator[Phrase]:
    """The events in the clauses of a sentence that are not taken by rules."""
    runs = {index: sentence.run(index) for index in range(len(sentence)) if index not in taken}
    heads: dict[int, _Event] = {}
    waiting: list[int] = []
    for index, run in runs.items():
        last = heads[max(heads)] if heads else None
        # `breaks at 65 s and comes back at 105 s` is one event, and no order to come back.
        if last is not None and last.form.part != "orders" and _attach(sentence, index, runs, heads):
            continue
        if (event := _event(sentence, run, runs.get(index - 1))) is not None:
            heads[index] = event
        else:
            waiting.append(index)
    for index in waiting:
        _attach(sentence, index, runs, heads)
    for event in heads.values():
        if event.complete or {"at", "until", "unitless", "later"} & set(event.times):
            yield event.phrase


def _event(sentence: SentenceRuns, run: Run, before: Run | None) -> _Event | None:
    """The event that a clause tells of; None where there is none, or more than one."""
    match = _only_form(sentence, run)
    if match is None:
        return None
    form, signs = match
    of_report = form.kind in REPORT_ORDERS or form.part == "consents"
    is_order = form.part == "orders"
    if (
        is_order
        and not of_report
        and any(m.kind in ("ASSET", "CONVOY") for word in run.words for m in word.meanings)
    ):
        # `the soldiers hold at 60 s` is no order.
        return None
    event = _Event(form, run, [Part("SIGN", None, span) for span in signs])
    for name, time in _times(sentence.text, run, is_order=is_order):
        if name in event.times:
            return None
        event.times[name] = time
    event.complete = not is_order and (form.part == "consents" or _gap(sentence.text, signs) <= MAX_GAP)
    if not _claim_numbers(sentence, event):
        return None
    if of_report:
        # `for the report about the radar, consent is granted`: the clause before names it.
        topic = before.words if before is not None and _TOPIC.match(before.plain) else ()
        named = any(meaning.kind in NAMING_KINDS for word in run.words for meaning in word.meanings)
        _claim_report(sentence.text, event, signs[-1], run.words if named else topic)
    return event


def _only_form(sentence: SentenceRuns, run: Run) -> tuple[EventForm, list[Span]] | None:
    """The form that a clause has, with the places of its signs; None where there is none, or more than one."""
    kinds = {meaning.kind for word in run.words for meaning in word.meanings}
    matches: list[tuple[EventForm, list[Span]]] = []
    of_the_drone = not sentence.names_a_group or _SUBJECT.match(run.plain) is not None
    for compiled in sentence.vocabulary.events:
        form = compiled.form
        assert isinstance(form, EventForm)
        signs = run.signs(compiled, sentence.context)
        if signs is None and (form.kind in REPORT_ORDERS or of_the_drone):
            # Nobody orders it; `four civilians stop at 60 s and go on at 90 s` is no order either.
            alone = run.signs(compiled, None)
            signs = alone if alone and _is_beside_a_time(sentence.text, run, alone[-1]) else None
        if signs is not None and all(kind in kinds for kind, needed in form.numbers.items() if needed):
            matches.append((form, signs))
    # `resumes reporting` is no `resumes`: a sign inside of a longer one is none.
    longest = [
        (form, signs)
        for form, signs in matches
        if not any(_covers(other, signs) for _, other in matches if other is not signs)
    ]
    if not longest or any(not overlap(longest[0][1][-1], signs[-1]) for _, signs in longest):
        return None
    return longest[0]


def _is_beside_a_time(text: str, run: Run, sign: Span) -> bool:
    """Whether a sign stands beside a time, which makes it an order: `at 90 s resume`, `recall at 200 s`."""
    times = [part.span for part in run.quantities if part.kind == "TIME" or _is_unitless(part, text)]
    gaps = [
        text[time.end : sign.start] if time.end <= sign.start else text[sign.end : time.start]
        for time in times
    ]
    return any(_BETWEEN_TIME_AND_ORDER.fullmatch(gap) for gap in gaps)


def _is_unitless(part: Part, text: str) -> bool:
    return part.kind == "COUNT" and text[: part.span.start].rstrip().endswith(("@", " at"))


def _claim_numbers(sentence: SentenceRuns, event: _Event) -> bool:
    """Claim the numbers that the form takes beside times; False where a kind of number stands there twice."""
    for kind in event.form.numbers:
        kinds = {kind, VALUELESS_KINDS.get(kind)}
        words = [word for word in event.run.words if any(m.kind in kinds for m in word.meanings)]
        if event.form.kind == "motor_off":
            words = [word for word in words if _MOTOR.search(sentence.text[: word.span.start])]
        if len(words) > 1:
            return False
        for word in words:
            last = sentence.vocabulary.meanings.get(word.text.lower().split()[-1], ())
            value = next(meaning.value for meaning in (*word.meanings, *last) if meaning.kind == kind)
            event.claimed.append(Part(kind, value, word.span))
    return True


def _claim_report(text: str, event: _Event, sign: Span, words: Sequence[Word]) -> None:
    """Claim the group whose report is meant: the first one after the sign, or else before it."""
    named = [
        (word.span.start < sign.start, word.span.start, meaning, word.span)
        for word in words
        for meaning in word.meanings
        if meaning.kind in NAMING_KINDS
    ]
    if named:
        _, _, meaning, span = min(named, key=lambda item: item[:2])
        event.claimed.append(Phrase("ref", (Part(meaning.kind, meaning.value, span),), span))
    elif it := _IT.match(text, sign.end):
        span = Span(it.start(1), it.end(1))
        event.claimed.append(Phrase("ref", (Part("THEM", None, span),), span))


def _times(text: str, run: Run, *, is_order: bool, clocks: bool = True) -> list[tuple[str, Time]]:
    """What each time of a clause says: when, for how long, until when, or within which time."""
    times: list[tuple[str, Time]] = []
    for part in (*run.quantities, *(_clock_times(run) if clocks else ())):
        time = part.value
        assert isinstance(time, Quantity)
        if is_order and _is_unitless(part, text):
            times.append(("unitless", (time, part.span)))
        if part.kind != "TIME":
            continue
        intro = _INTRODUCTION.match(text, part.span.start, part.span.end)
        before = text[run.span.start : intro.end() if intro else part.span.start]
        name, length = _role_of(before, text[part.span.end : run.span.end])
        span = Span(part.span.start, part.span.end + length)
        if name == "until" and is_order and _BACK.search(before):
            name = "at"
        if name == "lasting" and is_order and _LATER.match(text, part.span.end):
            # `and allows them again 80 seconds later`.
            name = "later"
        if not time.single and name == "at":
            ends = [Quantity("TIME", end, end) for end in (time.low, time.high)]
            times += [("at", (ends[0], span)), ("until", (ends[1], span))]
        else:
            times.append((name, (time, span)))
    return times


def _clock_times(run: Run) -> Iterator[Part]:
    """The times of an event that are written as minutes and seconds: `cut the link at 1:30`."""
    for word in run.words:
        for meaning in word.meanings:
            if isinstance(meaning.value, TimeOfDay) and _MINUTES.fullmatch(word.text):
                time_s = 60.0 * meaning.value.at.hour + meaning.value.at.minute
                yield Part("TIME", Quantity("TIME", time_s, time_s), word.span)


def _role_of(before: str, after: str) -> tuple[str, int]:
    """What a time says by the words around it, and how many characters of those after it are read with it."""
    # What a time says stands close to it: a longer search would be quadratic in the length of a clause.
    before = before[-MAX_ROLE_CHARACTERS:]
    role = next(role for role in _ROLES if role.before.search(before) and role.after.match(after))
    match = role.after.match(after)
    return role.name, match.end() if match else 0


def _attach(sentence: SentenceRuns, index: int, runs: dict[int, Run], heads: dict[int, _Event]) -> bool:
    """Give the times of a clause without a sign to the event beside it: `and comes back at t=105 s`."""
    run = runs[index]
    times = _times(sentence.text, run, is_order=False, clocks=False)
    named = dict(times)
    rest = [word for word in run.words if not any(overlap(word.span, span) for _, (_, span) in times)]
    tells_more = not all(
        word.filler or _BESIDE.fullmatch(word.text) or NEUTRAL_KINDS & {m.kind for m in word.meanings}
        for word in rest
    )
    if not times or len(named) < len(times) or "later" in named or tells_more:
        return False
    before = max((at for at in heads if at < index), default=None)
    after = min((at for at in heads if at > index), default=None)
    for at in (before, after):
        if (
            at is not None
            and set(range(min(at, index), max(at, index))) <= set(runs)
            and (heads[at].takes(named := _lasting(named, heads[at], rest)) or _is_once_more(run, heads[at]))
        ):
            if not heads[at].takes(named):
                # `fails twice, at 70 s for 10 s and at 200 s for 20 s`: the same once more.
                head, begin = heads[at], heads[at].run.span.start
                for twice in _TWICE.finditer(head.run.plain):
                    head.claimed.append(Part("SIGN", None, Span(twice.start() + begin, twice.end() + begin)))
                heads[index] = _Event(heads[at].form, run, [Part("SIGN", None, run.span)], named)
                return True
            heads[at].times |= named
            heads[at].claimed.append(Part("SIGN", None, run.span))
            return True
    return False


def _is_once_more(run: Run, event: _Event) -> bool:
    """Whether a clause gives the times of a second failure or outage."""
    return event.form.part != "orders" and _ONCE_MORE.match(run.plain) is not None


def _lasting(times: dict[str, Time], event: _Event, rest: Sequence[Word]) -> dict[str, Time]:
    """The times of a clause; one alone, after that of the event, says how long it lasts: `at 5 min, half a minute`."""
    alone = "at" in event.times and "lasting" not in event.times and set(times) == {"at"} and not rest
    return {"lasting": times["at"]} if alone else times


def _is_neutral(word: Word) -> bool:
    kinds = {meaning.kind for meaning in word.meanings}
    return bool(kinds) and kinds <= NEUTRAL_KINDS


def _covers(other: Sequence[Span], signs: Sequence[Span]) -> bool:
    """Whether a sign lies inside of a longer sign of another form."""
    return any(
        longer.start <= sign.start and sign.end <= longer.end and longer != sign
        for longer in other
        for sign in signs
    )


def _gap(text: str, signs: Sequence[Span]) -> int:
    """The number of words between the signs."""
    ordered = sorted(signs, key=lambda span: span.start)
    return sum(
        len(text[sign.end : following.start].split()) for sign, following in itertools.pairwise(ordered)
    )


_ONCE_MORE = re.compile(r"(?:once more |again )?(?:at|from)\s", re.IGNORECASE)
_TWICE = re.compile(r"\b(?:twice|two times|both times)\b", re.IGNORECASE)
_MOTOR = re.compile(r"(?:motor|rotor|engine|propeller)\s*(?:no\.?|nr\.?|number)?\s*$", re.IGNORECASE)
_TOPIC = re.compile(r"(?:for|about|on|concerning)\b", re.IGNORECASE)
_IT = re.compile(r"\s+(it|them|him|her)\b", re.IGNORECASE)
_INTRODUCTION = re.compile(r"(?:(?:from|between|at|in|t|h|second|minute|plus)\b[\s=+]*)+", re.IGNORECASE)
"""What a time may begin with before its number."""
_BETWEEN_TIME_AND_ORDER = re.compile(
    r"(?:[\s,@:=+]|\b(?:at|after|t|h|to|the|drone|uav|it|mission|flight|is)\b)*", re.IGNORECASE
)
_SUBJECT = re.compile(
    r"(?:the\s+|its\s+)?(?:autonomy|autopilot|drone|uav|uas|agent|aircraft|quad\w*)\b", re.IGNORECASE
)
_MINUTES = re.compile(r"\d{1,2}:\d\d\s*")
"""Minutes and seconds; a time of day has a zone or a part of the day."""
_LATER = re.compile(r"\s*(?:later|afterwards)\b", re.IGNORECASE)
_BACK = re.compile(r"\b(?:back|again|restored|returns?|available|recovers?|up)\b[^\d]*$", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class _TimeRole:
    """What a time says, by the words before and after it."""

    name: str
    before: re.Pattern[str]
    after: re.Pattern[str]


def _role(name: str, before: str = "", after: str = "") -> _TimeRole:
    return _TimeRole(
        name,
        re.compile(rf"(?:{before})$" if before else "", re.IGNORECASE),
        re.compile(rf"\s*(?:{after})\b" if after else "", re.IGNORECASE),
    )


_T = r"\s+(?:[th]\s*[=+]\s*|second\s+|minute\s+)?"
_ABOUT = r"(?:\s+(?:about|another|only|just|some|the\s+next|up\s+to|at\s+most))?\s+"
_ROLES = (
    _role("lasting", before=r"\b(?:back|again|restored|returns?|available|recovers?)\b[^\d]*", after=r"later|afterwards"),
    _role("later", after=r"later|afterwards"),
    _role("within", before=rf"\bwithin{_ABOUT}"),
    _role("within", after=r"time|to\s+(?:comply|obey|react|do)|for\s+(?:it|this|that)"),
    _role("within", before=r"\b(?:fulfil\w*|obey\w*|done|execut\w+|compl\w+|carried\s+out)\s+(?:with\s+)?in\s+"),
    _role("at", after=r"in(?=\s*(?:[,.;]|$|for\b))"),
    _role("at", after=r"(?:after|from)\s+(?:the\s+)?(?:start|launch|take-?off)|into\s+the\s+\w+"),
    _role("until", before=rf"\b(?:until|till|to|ending\s+at|ends?\s+at|(?<!takes\s)(?<!take\s)(?<!took\s)(?<!hands\s)(?<!hand\s)(?<!it\s)(?<!control\s)(?<!drone\s)over\s+at){_T}"),
    _role("until", before=rf"\b(?:back|again|restored|returns?|available|recovers?|up)\b(?:\s+\w+){{0,2}}\s+(?:at|after){_T}"),
    _role("lasting", before=rf"\b(?:for|lasting|lasts?|of|during|takes|duration(?:\s+is)?:?){_ABOUT}"),
    _role("lasting", before=r"\bis\s+", after=r"away|long"),
    _role("answer", after=r"after\s+(?:the\s+|a\s+|its\s+|each\s+|every\s+)?(?:request|question|asking|(?:you|it|the\s+\w+)\s+asks?)"),
    _role("at"),
)  # fmt: skip
"""What a time says, by the words before and after it; the first that fits. Without any of these it is when it happens."""
_BESIDE = re.compile(
    r"fulfil\w*|must|expected|allows?|with|commencing|starting|beginning|that|compl\w+|obey\w*|follow\w*|carried|executed?|done|reacts?|gets?|seconds?|back|again|later|restored|returns?|available|recovers?|lasts?|lasting|during|duration|exactly|only|ending|away|long|got|stayed|on|onwards|which|this",
    re.IGNORECASE,
)
"""Words of a clause that only gives the times of the event beside it."""
