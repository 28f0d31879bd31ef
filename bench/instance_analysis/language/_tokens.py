"""Splits prose into words with meanings: numbers, clock times, words of the vocabulary, misspelt words."""

from __future__ import annotations

import datetime as dt
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from bench.simspec import Environment

from ._coordinates import NAMED, PLACE, coordinates_of, name_of
from ._spelling import corrected_spelling
from ._vocabulary import Meaning, Vocabulary

MONTHS = (
    "january", "february", "march", "april", "may", "june", "july", "august", "september", "october", "november",
    "december",
)  # fmt: skip
_MONTH = "|".join(f"{month}|{month[:3]}" for month in MONTHS)
_CAPITAL_MONTH = "|".join(f"{month.title()}|{month[:3].title()}|{month[:3].upper()}" for month in MONTHS)
"""Months of a date without a year: `may` and `mar` are other words too."""
USUAL_YEAR = Environment().start_utc.year
"""The year of a date that has none: that of a SimSpec without a start."""
DAYS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
"""Days of a month in words."""
HOURS = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_HOUR = rf"(?:{'|'.join(HOURS)}|1[0-2]|[1-9])"
_DAYPART = r"\s+(?:in\s+the\s+(?:morning|afternoon|evening)|at\s+night)"
SPOKEN_TIME = rf"(?:(?:half|quarter)\s+(?:past|to)\s+{_HOUR}|(?:1[3-9]|2[0-3]|{_HOUR})\s+o['’]clock|(?:12\s+)?(?:noon|midday|midnight)(?=\s+(?:utc|gmt|zulu)\b)|{_HOUR}(?={_DAYPART}))\b(?:{_DAYPART})?(?:,?\s+(?:utc|gmt|zulu)\b)?"
"""A time of day in words."""
_PATTERN = re.compile(
    rf"""(?P<iso>\d{{4}}-\d\d-\d\d)
    |(?P<date>\d{{1,2}}(?:st|nd|rd|th)?\s+(?:of\s+)?(?:{_MONTH})\s+\d{{4}}|the\s+(?:{"|".join(DAYS)})\s+of\s+(?:{_MONTH}),?\s+\d{{4}}|(?:{_MONTH})\s+\d{{1,2}}(?:st|nd|rd|th)?,?\s+\d{{4}}|(?-i:\d{{1,2}}(?:st|nd|rd|th)?\s+(?:of\s+)?(?:{_CAPITAL_MONTH})(?!\s+\d{{4}}))|(?-i:(?:{_CAPITAL_MONTH})\s+\d{{1,2}}(?:st|nd|rd|th)?(?!\d|:)))\b
    |(?P<dtg>\d{{6}}\s?Z\s?(?:{_MONTH})\s?(?:\d{{4}}|\d\d)\b)
    |(?P<span>\d{{1,2}}:\d\d(?=\s*(?:min|mins|minutes)\b))
    |(?P<clock>\d{{1,2}}:\d\d\s*(?:(?:local(?:\s+time)?\s*)?\(?(?:utc|gmt)\s?[+-]\s?\d{{1,2}}(?::00)?\b\)?|z\b|utc\b|gmt\b|\(utc\)|cest\b|cet\b|bst\b|eest\b|eet\b|msk\b|am\b|pm\b|a\.m\.|p\.m\.)?|\d{{1,2}}h\d\d\s*(?:z\b|utc\b|gmt\b)|\d{{4}}\s*(?:z\b|utc\b|gmt\b|cest\b|cet\b|bst\b|eest\b|eet\b|msk\b|hours\b|hrs\b)|\d{{1,2}}\s*(?:am\b|pm\b|a\.m\.|p\.m\.))
    |(?P<told>{SPOKEN_TIME})
    |(?P<short>i\.\s?e\.|e\.\s?g\.|(?:mil|approx|max|min|alt|incl|batt|nr|ca|no|resp|temp)\.(?=\s{{0,2}}(?-i:[a-z0-9.]))|(?:mr|ms|mrs|dr|st)\.(?=\s))
    |(?P<heading>\b(?:exercise|scenario|test\s+case|test|case|problem|step|phase|variant|figure|section|chapter|task|example|run|ticket|question|log|entry|item|card|report)\s+\d+(?:\.\d)?[a-z]?\b(?=\s*[.:(,;)])(?!:\d)|\b(?:run|flight|test)\s+\d+\b(?!\s?(?:m|s|km|min|ft|%|:|\.\d|-))|(?-i:\b[A-Z]{{2,6}}-\d+\b)|(?:(?<=\n)|(?<=[.!?]\s)|^)(?:\d{{1,2}}\.|[a-z]\))(?=\s(?-i:[A-Z])))
    |(?P<place>{PLACE})
    |(?P<named>{NAMED})
    |(?P<ordinal>\d+(?:st|nd|rd|th)\b)
    |(?P<number>\d{{1,3}}(?:,\d{{3}})+(?:\.\d+)?(?![\d,])|\d+,\d{{1,2}}(?=\s?(?:k?m\b|m/s|km/h|kn|s\b|min|%|°|deg|met))|\d*\.\d+|\d+)
    |(?P<unit>km²|m²|/\s*km²|/\s*km2|/\s*sq\.?\s+km|m/s|km/h|ft/s|km2\b|m2\b|[%°&@≥≤]|[<>]=?)
    |(?P<times>(?<=\d)x(?=\d)|×)
    |(?P<word>x500\b|w/in?\b|h\s?\+(?=\s?\d)|[a-z]+(?:['’-][a-z]+)*\d?)
    |(?P<left>\[)|(?P<right>\])|(?P<comma>,)|(?P<dash>(?<!/)[-–—]|\.\.+)|(?P<stop>[.;\n!?])""",
    re.VERBOSE | re.IGNORECASE,
)


# Chosen, not measured: editors and mail programs break lines between 65 and 80 characters.
FULL_LINE_CHARACTERS = 60
"""Characters from which on a line may have been broken because it was full."""
_ITEM = re.compile(r"\s*(?:[-*•–]\s|\d+[.)]\s)")
_NAME = re.compile(r"[A-Z]{3,}")
_NAMED_ROADS = frozenset(["road", "route", "street", "highway", "msr", "track"])
"""What a name in capital letters may follow."""
_REPORT_NUMBERS = {
    "first": 1, "the first": 1, "a first": 1, "second": 2, "a second": 2, "the second": 2, "another": 2, "a further": 2,
    "the other": 2, "third": 3, "a third": 3, "the third": 3,
}  # fmt: skip
_REPORT_NOUNS = frozenset(
    ["report", "reports", "tip", "tips", "tip-off", "sighting", "message", "cue", "intelligence", "intel"]
)
_AFTER_A_REPORT = frozenset(["one", "priority", "prio", "concerns", "regards", "arrives", "comes", "reaches"])
"""What follows a number that stands for a report of which the text has spoken."""
_WHERE_IT_STARTS = re.compile(
    r",?\s+(?:where (?:the )?(?:drone|uav|uas|aircraft|it|we) (?:starts?|takes? off|launch(?:es)?|begins?)"
    r"|(?:which|that) is (?:also )?(?:the|our|its) (?:take-?off|launch|start\w*)(?: (?:point|site|position|place|pad))?)\b",
    re.IGNORECASE,
)
"""What makes the noun before it the start of the drone."""
_STARTS = (
    re.compile(rf"\b(?P<name>[a-z-]{{2,20}})(?={_WHERE_IT_STARTS.pattern})", re.IGNORECASE),
    re.compile(
        r"\b(?:drone|uav|uas|aircraft|we)\s+(?:(?:shall|will|must)\s+)?(?:takes?\s+off|launch(?:es)?|starts?)\s+(?:from|at)\s+(?:the\s+|an?\s+|our\s+|its\s+)?(?P<name>[a-z-]{2,20})(?=\s*[.,;]|$)",
        re.IGNORECASE,
    ),
)
_NAMES_OF_HOME = frozenset(["GROUND", "AMBIGUOUS"])
"""Kinds of words that may name the start of the drone; words that nobody knows may too."""
PHRASE_GROUPS = ("word", "unit", "times", "short")
"""What phrases of the vocabulary are made of."""
ZONES_OF_UTC = ("utc", "gmt", "zulu")
ZONES_H = {"cest": 2, "cet": 1, "bst": 1, "eest": 3, "eet": 2, "msk": 3}


@dataclass(frozen=True, slots=True)
class Span:
    """A range of characters of the prose, end excluded."""

    start: int
    end: int

    def joined(self, other: Span) -> Span:
        return Span(min(self.start, other.start), max(self.end, other.end))


@dataclass(frozen=True, slots=True)
class Word:
    """A word or phrase with its possible meanings; none for an unknown word."""

    text: str
    span: Span
    meanings: tuple[Meaning, ...]
    comma: bool = False
    filler: bool = False
    mended: str = ""

    def span_text(self, text: str) -> str:
        """The word as written in the text."""
        return text[self.span.start : self.span.end]


@dataclass(frozen=True, slots=True)
class TimeOfDay:
    """A time of day. `zoned` when the prose gives a time zone, `ahead_h` hours ahead of UTC."""

    at: dt.time
    zoned: bool
    ahead_h: int = 0


def words_of(text: str, vocabulary: Vocabulary) -> list[Word]:
    """All words of a text in order, with the longest phrases of the vocabulary.

    Takes time linear in the text's length.
    """
    speaker_starts = _speakers(text)
    raw = [
        candidate
        for candidate in _PATTERN.finditer(text)
        if candidate.start() not in speaker_starts and not _is_meaningless(candidate, text)
    ]
    words: list[Word] = []
    comma, corrections = False, dict[str, str]()
    index = 0
    while index < len(raw):
        match = raw[index]
        span = Span(match.start(), match.end())
        if match.lastgroup == "comma" and not _in_brackets(raw, index):
            comma, index = True, index + 1
            continue
        if match.lastgroup == "dtg":
            words += _date_time_group(match)
            comma, index = False, index + 1
            continue
        if match.lastgroup in PHRASE_GROUPS:
            word, used = _phrase(raw, index, vocabulary, corrections)
        else:
            word, used = Word(match.group(), span, _meanings_of(match)), 1
        words.append(replace(word, comma=comma))
        comma, index = False, index + used
    words = _counted_reports(_without_owners(words))
    words = _names_of_home(_named_roads(words, vocabulary), text, vocabulary)
    return list(_articles(list(_ranges(_repeated(words, text)))))


def headings_of(text: str) -> list[Span]:
    """Numbered headings, and ids of test cases: their numbers count nothing."""
    return [Span(*match.span()) for match in _PATTERN.finditer(text) if match.lastgroup == "heading"]


def _speakers(text: str) -> frozenset[int]:
    """Positions of speaker names (a name that begins at least two lines) and of quotation marks at line
    starts.
    """
    lines = [
        (match.start(1), match.group(1).lower())
        for match in re.finditer(r"(?m)^[ \t]*([A-Za-z]{1,12}):", text)
    ]
    names = [name for _, name in lines]
    quoted = {match.start(1) for match in re.finditer(r"(?m)^[ \t]*(>)", text)}
    return frozenset({at for at, name in lines if names.count(name) > 1} | quoted)


def _is_meaningless(match: re.Match[str], text: str) -> bool:
    """Whether a match is a numbered heading or a line break inside a sentence."""
    return match.lastgroup == "heading" or (match.group() == "\n" and _wrapped(text, match.start()))


def _wrapped(text: str, at: int) -> bool:
    """Whether a line was broken only because it was full, so that the sentence continues."""
    line = text[text.rfind("\n", 0, at) + 1 : at]
    following = text[at + 1 :].split("\n", 1)[0]
    return len(line) >= FULL_LINE_CHARACTERS and bool(following.strip()) and _ITEM.match(following) is None


def _in_brackets(raw: list[re.Match[str]], index: int) -> bool:
    return index >= 2 and any(raw[back].lastgroup == "left" for back in range(max(0, index - 3), index))


def _meanings_of(match: re.Match[str]) -> tuple[Meaning, ...]:
    text = match.group()
    match match.lastgroup:
        case "number":
            # `1,200` is a thousand and more, `3,5 m` a decimal comma.
            decimal = re.fullmatch(r"\d+,\d{1,2}", text) is not None
            return (Meaning("NUM", float(text.replace(",", "." if decimal else ""))),)
        case "span":
            # `8:30 min` is eight and a half minutes.
            minutes, seconds = text.split(":")
            return (Meaning("NUM", int(minutes) + int(seconds) / 60),)
        case "clock" | "told":
            clock = _clock(text) if match.lastgroup == "clock" else _spoken_time(text)
            return (Meaning("CLOCK", clock),) if clock else ()
        case "iso" | "date":
            day = _date(text)
            return (Meaning("DATE", day),) if day else ()
        case "place":
            return (Meaning("POINT", coordinates_of(text)),)
        case "named":
            return (Meaning("NAMED", name_of(text)),)
        case "left" | "right" | "comma" | "dash" | "stop":
            return (
                Meaning(
                    {"left": "LBR", "right": "RBR", "comma": "COMMA", "dash": "DASH", "stop": "STOP"}[
                        match.lastgroup
                    ]
                ),
            )
    return ()


def _date_time_group(match: re.Match[str]) -> list[Word]:
    """The time and the day of `140530ZJUN25`: the 14th of June 2025, 05:30 UTC."""
    text, begin = match.group(), match.start()
    year = re.findall(r"\d+$", text)[0]
    month = "".join(letter for letter in text[6:] if letter.isalpha())[1:]
    clock, day = (
        _clock(f"{text[2:6]}Z"),
        _date(f"{text[:2]} {month} {year if len(year) == 4 else '20' + year}"),
    )
    if clock is None or day is None:
        return [Word(text, Span(begin, match.end()), ())]
    return [
        Word(text[:7], Span(begin, begin + 7), (Meaning("CLOCK", clock),)),
        Word(text[7:].strip(), Span(begin + 7, match.end()), (Meaning("DATE", day),)),
    ]


def _clock(text: str) -> TimeOfDay | None:
    lower = text.lower().replace(".", "")
    digits = re.findall(r"\d+", lower)
    # Military notation: `1430Z`.
    if len(digits) == 1 and len(digits[0]) == 4:
        digits = [digits[0][:2], digits[0][2:]]
    hour, minute = int(digits[0]), int(digits[1]) if len(digits) > 1 else 0
    if "pm" in lower and hour < 12:
        hour += 12
    if "am" in lower and hour == 12:
        hour = 0
    try:
        ahead = next((hours for zone, hours in ZONES_H.items() if lower.endswith(zone)), 0)
        if offset := re.search(r"(?:utc|gmt)\s?([+-])\s?(\d+)", lower):
            ahead = int(f"{offset[1]}{offset[2]}")
        return TimeOfDay(
            dt.time(hour, minute), ahead != 0 or any(zone in lower for zone in ("z", "utc", "gmt")), ahead
        )
    except ValueError:
        return None


def _spoken_time(text: str) -> TimeOfDay:
    """Read `half past five in the morning, UTC`. Without a part of the day the time is before noon."""
    lower = text.lower()
    if special := re.search(r"\b(?:noon|midday|midnight)", lower):
        return TimeOfDay(dt.time(0 if special.group() == "midnight" else 12), zoned=True)
    if late_hour := re.match(r"1[3-9]|2[0-3]", lower):
        return TimeOfDay(dt.time(int(late_hour.group())), any(zone in lower for zone in ZONES_OF_UTC))
    hour = next(
        number for number, name in enumerate(HOURS, start=1) if re.search(rf"\b({name}|{number})\b", lower)
    )
    minute = 30 if "half" in lower else 15 if "quarter" in lower else 0
    early = "morning" in lower or (hour == 12 and "night" in lower)
    late = any(part in lower for part in ("afternoon", "evening", "night"))
    hour = hour % 12 + (12 if (late and hour < 12) or (hour == 12 and not early) else 0)
    before = re.search(r"\bto\b", lower) is not None
    at = (hour * 60 + (-minute if before else minute)) % (24 * 60)
    return TimeOfDay(dt.time(at // 60, at % 60), any(zone in lower for zone in ZONES_OF_UTC))


def _date(text: str) -> dt.date | None:
    try:
        if text[4:5] == "-":
            return dt.date.fromisoformat(text)
        parts = re.findall(
            r"[a-z]+|\d+", re.sub(r"(\d)(st|nd|rd|th)", r"\1", text.lower()).replace(" of ", " ")
        )
        month = next(part for part in parts if part.isalpha() and part not in ("the", *DAYS))
        named = [1 + DAYS.index(part) for part in parts if part in DAYS]
        numbers = (*named, *(int(part) for part in parts if part.isdigit()), USUAL_YEAR)
        day, year = numbers[:2]
        # Months may be abbreviated to three letters.
        return dt.date(year, 1 + next(i for i, name in enumerate(MONTHS) if name.startswith(month)), day)
    except ValueError:
        return None


def _phrase(
    raw: list[re.Match[str]], index: int, vocabulary: Vocabulary, corrections: dict[str, str]
) -> tuple[Word, int]:
    run = list(
        itertools.takewhile(
            lambda match: match.lastgroup in PHRASE_GROUPS, raw[index : index + vocabulary.longest]
        )
    )
    texts = [corrected_spelling(match.group().rstrip("."), vocabulary, corrections) for match in run]
    # The longest phrase first, so that a `military truck` is not read as a truck.
    for length in range(len(run), 0, -1):
        phrase = " ".join(texts[:length])
        span = Span(run[0].start(), run[length - 1].end())
        given = " ".join(match.group().rstrip(".").lower().replace("’", "'") for match in run[:length])
        correction = "" if given == phrase else phrase
        if length > 1 and texts[0] in ("enemy", "hostile") and _longer_noun(texts, length, vocabulary):
            # `enemy radar vehicle` is an enemy `radar vehicle`, and no `enemy radar` with a vehicle.
            return Word(texts[0], Span(run[0].start(), run[0].end()), (), filler=True), 1
        if phrase in vocabulary.meanings:
            return Word(phrase, span, vocabulary.meanings[phrase], mended=correction), length
        if phrase in vocabulary.fillers:
            return Word(phrase, span, (), filler=True, mended=correction), length
    return Word(run[0].group(), Span(run[0].start(), run[0].end()), ()), 1


def _longer_noun(texts: list[str], length: int, vocabulary: Vocabulary) -> bool:
    """Whether a thing that begins at the second word goes on past the phrase that begins at the first."""
    ends = (" ".join(texts[1:end]) for end in range(length + 1, len(texts) + 1))
    return any(meaning.kind == "ASSET" for phrase in ends for meaning in vocabulary.meanings.get(phrase, ()))


def _named_roads(words: list[Word], vocabulary: Vocabulary) -> list[Word]:
    """`road SILVER`, `Route TAMPA`: the name says nothing more where the text has one name of a road."""
    road = vocabulary.meanings.get("road", ())
    names = {
        at
        for at in range(1, len(words))
        if _NAME.fullmatch(words[at].text)
        and not words[at].meanings
        and not words[at].comma
        and words[at - 1].text.lower() in _NAMED_ROADS
    }
    if len({words[at].text for at in names}) != 1:
        return words
    named = [replace(word, filler=True) if at in names else word for at, word in enumerate(words)]
    for at in names:
        named[at - 1] = replace(words[at - 1], meanings=road, filler=False)
    return named


def _without_owners(words: list[Word]) -> list[Word]:
    """`six of our rescuers` are six rescuers, and no share of others."""
    return [
        replace(word, meanings=(), filler=True)
        if 0 < at < len(words) - 1
        and (word.text.lower(), words[at + 1].text.lower()) == ("of", "our")
        and _number(words[at - 1]) is not None
        else word
        for at, word in enumerate(words)
    ]


def _counted_reports(words: list[Word]) -> list[Word]:
    """`a second report`, `the other one`: which of several reports is spoken of. What reports are called stays."""
    counted: list[Word] = []
    at, known = 0, False
    while at < len(words):
        number = _REPORT_NUMBERS.get(words[at].text.lower())
        after = at + 1
        if (
            number
            and after < len(words)
            and words[after].text.lower().endswith("er")
            and not words[after].meanings
        ):
            # `a second, vaguer one`.
            after += 1
        following = words[after].text.lower().split()[:1] if number and after < len(words) else []
        known = known or not _REPORT_NOUNS.isdisjoint(words[at].text.lower().split())
        if (
            number
            and (_REPORT_NOUNS.issuperset(following) or (known and _AFTER_A_REPORT.issuperset(following)))
            and following
        ):
            end = after + (following == ["one"])
            span = words[at].span.joined(words[end - 1].span)
            if counted and counted[-1].text.lower() == "the":
                span = counted.pop().span.joined(span)
            counted.append(
                replace(words[at], span=span, meanings=(Meaning("REPORTNO", number),), filler=False)
            )
            at = end
            continue
        counted.append(words[at])
        at += 1
    return counted


def _names_of_home(words: list[Word], text: str, vocabulary: Vocabulary) -> list[Word]:
    """What the text says that the drone starts from, as home: `the car park where the drone starts`."""
    names = {match["name"].lower() for pattern in _STARTS for match in pattern.finditer(text)}
    of_home = tuple(meaning for meaning in vocabulary.meanings.get("home", ()) if meaning.kind == "HOME")
    named: list[Word] = []
    for word in words:
        last = word.text.lower().rsplit(maxsplit=1)[-1:]
        kinds = {meaning.kind for meaning in word.meanings}
        fits = names.issuperset(last) and bool(last) and not word.filler and kinds <= _NAMES_OF_HOME
        if fits and (relative := _WHERE_IT_STARTS.match(text, word.span.end)):
            named.append(replace(word, meanings=of_home, span=Span(word.span.start, relative.end())))
        elif fits:
            named.append(replace(word, meanings=of_home))
        elif not named or word.span.start >= named[-1].span.end:
            named.append(word)
    return named


def _number(word: Word) -> float | None:
    return next((float(str(meaning.value)) for meaning in word.meanings if meaning.kind == "NUM"), None)


def _repeated(words: list[Word], text: str) -> list[Word]:
    """One word for a number that is written twice: `four (4) to six (6)`."""
    single: list[Word] = []
    for word in words:
        before = single[-1] if single else None
        if before is not None and (number := _number(word)) is not None and number == _number(before):
            closing = re.match(r"\s*\)", text[word.span.end :])
            if closing and re.fullmatch(r"\s*\(\s*", text[before.span.end : word.span.start]):
                single[-1] = replace(before, span=Span(before.span.start, word.span.end + closing.end()))
                continue
        single.append(word)
    return single


def _ranges(words: list[Word]) -> Iterator[Word]:
    """`7 till 9 persons` and `35 until 45 m` as ranges. Times keep `until`: they begin and end something."""
    for index, word in enumerate(words):
        inside = 0 < index < len(words) - 2 and word.text.lower() in ("till", "until")
        if inside and _number(words[index - 1]) is not None and _number(words[index + 1]) is not None:
            measure = {meaning.kind: meaning.value for meaning in words[index + 2].meanings}
            unit = measure.get("UNIT")
            of_time = isinstance(unit, tuple) and unit[0] == "TIME"
            earlier = words[index - 2].meanings if index > 1 else ()
            begins = any(meaning.kind in ("FROM", "BETWEEN") for meaning in earlier)
            if not measure.keys().isdisjoint(("UNIT", "ASSET", "AMBIGUOUS")) and not of_time and not begins:
                yield replace(word, meanings=(Meaning("TO"),), filler=False)
                continue
        yield word


MAX_WORDS_TO_NOUN = 8
"""Words after an article among which its noun is looked for."""
_COUNTED = {"ASSET", "AMBIGUOUS", "UNIT", "CONCEAL", "MOTION", "TARGET", "SOUGHT"}


def _noun_after(words: list[Word], article: int) -> Word | None:
    """The first word after an article that means something; unknown adjectives may stand before it."""
    for word in words[article + 1 : article + 1 + MAX_WORDS_TO_NOUN]:
        if word.meanings or not (word.filler or word.text.isalpha()):
            return word
        if "of" in word.text.split():
            # `an unknown number of displaced persons` is not one person.
            return None
    return None


def _articles(words: list[Word]) -> Iterator[Word]:
    """Turn `a` before a countable noun into the number 1; drop other articles."""
    for index, word in enumerate(words):
        is_about = word.text.lower() == "some" or (
            word.text.lower() == "around"
            and index > 0
            and (word.comma or words[index - 1].text.lower() in ("and", "with", "of"))
        )
        if (
            is_about
            and index + 1 < len(words)
            and any(meaning.kind == "NUM" for meaning in words[index + 1].meanings)
        ):
            # `some 100 metres`, `two trucks and around twenty villagers`.
            yield replace(word, meanings=(), filler=True)
            continue
        if word.text in ("a", "an"):
            following = _noun_after(words, index)
            if following is not None and any(meaning.kind in _COUNTED for meaning in following.meanings):
                yield replace(word, meanings=(Meaning("NUM", 1.0),), filler=False)
                continue
        yield word
