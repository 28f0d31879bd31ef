"""The account of a reading: which loaded words nobody read, and what has to be left out for them.

This is the one place where nothing may be read in silence. Readers do not check each other: whatever they made
of a clause, a number, negation, condition, share, alternative or bound in it that nobody has used makes the
clause a visible choice, with its fields left out where the word may turn their meaning around.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from .._draft import Draft, dotted
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span, Word
from ._clauses import Clause
from ._loaded_words import LEFT_OUT, Load, LoadedWord

VALUE_KINDS = frozenset(
    ["COUNT", "LENGTH", "TIME", "SPEED", "ANGLE", "PERCENT", "AREA", "DIM", "POINT", "CLOCK", "DATE", "NONE", "NTH"]
)  # fmt: skip
"""Parts that count as read only where their reader asked for them; other words are read by the phrase they make."""
LOOSE_BOUNDS = {"field": frozenset(["WITHIN", "ATLEAST"]), "wind": frozenset(["WITHIN"]), "gusts": frozenset(["WITHIN"])}  # fmt: skip
"""Bounds that the grammar lets stand beside a number, and that the reader may leave aside."""
CONDITIONAL_RULES = frozenset(["standoff"])
"""Phrases that are rules, so that a condition inside them is read."""
TRACED_KINDS = frozenset(["COUNT", "SPEED", "PERCENT", "LENGTH"])
UNTRACED_RULES = frozenset(
    [
        "place",
        "stretch",
        "area",
        "extent",
        "loop",
        "between",
        "density",
        "group",
        "polar",
        "midpoint",
        "course",
    ]
)
"""Rules whose numbers are combined to others: corners, routes, members of an area."""

UNKNOWN_WORD = "unknown word"
UNUSED_WORD = "nothing is read from it"
CLAIMING_RULES = frozenset(["rule", "event"])
"""Phrases that hold every word between their signs."""
_THERE = re.compile(r"(?<!out )(?<!over )\bthere(?=\s*(?:[.,;:!?)]|$|and\b))", re.IGNORECASE)
"""A place that was named before: `an old woman lives there`."""
NOUN_KINDS = frozenset(["ASSET", "AMBIGUOUS"])
TELLING_KINDS = frozenset(
    [
        *(
            "AWAY",
            "PART",
            "UNTIL",
            "AFTER",
            "BEFORE",
            "ALONG",
            "SEEN",
            "ONAVERAGE",
            "CORNERS",
            "ROUTE",
            "AXIS",
        ),
        *("RUNS", "NTH", "MIDDLE", "GROUND", "NAMED", "WIDE", "OFTHEM", "OVER"),
    ]
)
"""Kinds of words that the reader passes over outside of phrases, although they tell something."""
JOINING_KINDS = frozenset(["AFTER", "BEFORE", "UNTIL", "AWAY", "OVER", "RUNS", "CORNERS", "ONAVERAGE"])
"""Kinds of words that belong to the quantity beside them."""
MERE_PARTICLES = frozenset(["on", "out", "over", "off"])
"""Words of these kinds that often tell nothing: `on Monday`, `out there`."""
BARE_VALUES = frozenset(["altitude", "speed", "limit", "radius", "field"])
"""Phrases whose value goes to what was spoken of before, or to a word that names many things (`before`, `radius`)."""
_OF_THE_FLIGHT = re.compile(
    r"(?:mission|intelligence|seeds|rules\.report_deadline_s)\b|actors\[.*\]\.motion\.radius_m"
)
_OF_THE_WHOLE = re.compile(r"mission|vehicle|environment")
"""Fields that hold from the start to the end."""
_OF_ONE_THING = re.compile(r"environment\.|vehicle\.battery\.initial_fraction")
"""Fields that other things have too, or that an unknown verb turns around: `drop the fog`."""
_START = "environment.start_utc"
_CLAIM = re.compile(
    r"""\b(?:drone|uav|uas|rpas|aircraft|quad\w*|copter|mission|flight|fl(?:y|ies|ying|ew|own)|search\w*|cruis\w+|altitude|height
    |speed|limit|battery|charge|reserve|camera|gps|gnss|ceiling|floor|report\w*|intel\w*|sighting|tip|information|deliver\w*
    |confidence|seen|spotted|uncertain\w*|accura\w+|error|latency|agl|deadline|duration)\b""",
    re.IGNORECASE | re.VERBOSE,
)
"""Words that say whose a value is."""
EXCEPTIONS = frozenset(["until", "till", "unless"])
"""Conditions that end what stands before them, and do not make it depend on them."""
MAX_NAMED_WORDS = 6
"""Words that a choice names at most, so that it stays one line. Chosen."""


@dataclass(frozen=True, slots=True)
class LedgerEntry:
    """A passage with loaded words that nobody has read; `left_out` when it must not set any field."""

    span: Span
    words: tuple[LoadedWord, ...]
    left_out: bool

    @property
    def conditional(self) -> bool:
        """Whether a condition is among its words."""
        return any(word.load is Load.CONDITION for word in self.words)

    @property
    def ask(self) -> str:
        reasons = dict.fromkeys((word.text.lower(), word.load.value) for word in self.words)
        return "; ".join(f"{text!r}: {reason}" for text, reason in reasons)

    @property
    def readings(self) -> tuple[str, str]:
        names = ", ".join(dict.fromkeys(repr(word.text) for word in self.words))
        leave, keep = "leave it out", f"read it without {names}"
        return (leave, keep) if self.left_out else (keep, leave)


class Ledger:
    """The loaded words and clauses of a text. `audit` compares them with a reading."""

    def __init__(self, text: str, loaded: Sequence[LoadedWord], clauses: Sequence[Clause]) -> None:
        self._text, self._clauses = text, clauses
        self._phrases = [item for clause in clauses for item in clause.items if isinstance(item, Phrase)]
        self._loaded: list[list[LoadedWord]] = [[] for _ in clauses]
        starts = [clause.span.start for clause in clauses]
        for word in loaded:
            at = bisect.bisect_right(starts, word.span.start) - 1
            if at >= 0 and word.span.start < clauses[at].span.end:
                self._loaded[at].append(word)

    def audit(self, draft: Draft, cuts: Sequence[Span]) -> list[LedgerEntry]:
        """Every passage outside of `cuts` that has unread loaded words, in order."""
        read = self.read_characters(draft)
        listed = self._listed_characters(draft)
        gone = marked(len(self._text), cuts)
        entries: list[LedgerEntry] = []
        for index in range(len(self._clauses)):
            unread = [
                word
                for word in self._loaded[index]
                if not all(read[word.span.start : word.span.end])
                and not (word.load not in LEFT_OUT and all(listed[word.span.start : word.span.end]))
                and not any(gone[word.span.start : word.span.end])
                and not _is_harmless(word, draft)
                and not _is_of_a_rule(word, draft, self._clauses[index].span)
            ]
            # `three` in `three of them` is part of the share.
            longer = marked(len(self._text), [word.span for word in unread if " " in word.text])
            single = [word for word in unread if " " in word.text or not longer[word.span.start]]
            entries += self._entries(index, single)
        return [*entries, *self._unclaimed(draft, gone), *self._doubtful(draft, gone)]

    def _doubtful(self, draft: Draft, gone: bytearray) -> Iterator[LedgerEntry]:
        """Values of the whole mission beside an unread time, and a start or a charge beside unknown words.

        `after 3 minutes the battery has only 30 %`, `a hiker phoned at 16:10`: they are kept, and visible.
        """
        unread = {(item.start, item.end): item.why for item in draft.not_understood}
        for clause in self._clauses:
            claims = [
                item.span
                for item in clause.items
                if isinstance(item, Phrase) and item.rule not in CLAIMING_RULES and not gone[item.span.start]
            ]
            paths = [
                dotted(path)
                for path, value, span in draft.statements
                if any(_within(span, claim) for claim in claims) and _stands(draft, path, value)
            ]
            words = []
            for item in clause.items:
                why = unread.get((item.span.start, item.span.end))
                if why is None:
                    continue
                timed = (isinstance(item, Phrase) and item.rule == "when") or (
                    isinstance(item, Word) and any(meaning.kind == "TIME" for meaning in item.meanings)
                )
                if (
                    (timed and any(map(_OF_THE_WHOLE.match, paths)))
                    or (why == UNKNOWN_WORD and any(map(_OF_ONE_THING.match, paths)))
                    or _START in paths
                ):
                    load = Load.MOMENT if timed else Load.STRANGER
                    words.append(LoadedWord(load, self._text[item.span.start : item.span.end], item.span))
            if words:
                yield LedgerEntry(clause.span, tuple(words[:MAX_NAMED_WORDS]), left_out=False)

    def _unclaimed(self, draft: Draft, gone: bytearray) -> Iterator[LedgerEntry]:
        """Bare values in clauses with unread words: whose they are is in those words, so they set nothing."""
        strange = {(item.start, item.end) for item in draft.not_understood if item.why == UNKNOWN_WORD}
        for index, clause in enumerate(self._clauses):
            beside = list(clause.items)
            if len(beside) == 1 and index and self._clauses[index - 1].sentence == clause.sentence:
                # `the radio is disturbed, lasts 40 s`: its subject stands in the clause before it.
                beside += self._clauses[index - 1].items if _is_field(beside[0]) else ()
            unread = [item for item in beside if (item.span.start, item.span.end) in strange]
            quote = self._text[clause.span.start : clause.span.end]
            if not unread or _CLAIM.search(quote):
                continue
            for item in clause.items:
                bare = (
                    isinstance(item, Phrase) and item.rule in BARE_VALUES and not item.has("FLY", "DELIVERY")
                )
                paths = [dotted(path) for path, _, span in draft.statements if _within(span, item.span)]
                counted = isinstance(item, Phrase) and item.has("COUNT")
                sets = any(
                    _OF_THE_FLIGHT.match(path) or (counted and path.startswith("rules.")) for path in paths
                )
                if bare and sets and not any(gone[item.span.start : item.span.end]):
                    words = tuple(
                        LoadedWord(Load.STRANGER, self._text[word.span.start : word.span.end], word.span)
                        for word in unread[:MAX_NAMED_WORDS]
                    )
                    yield LedgerEntry(item.span, words, left_out=True)

    def read_characters(self, draft: Draft) -> bytearray:
        """For each character, whether it belongs to a word that somebody has read with effect."""
        effects = [span for path, value, span in draft.statements if _stands(draft, path, value)]
        effect = marked(len(self._text), [*effects, *draft.acknowledged])
        read = marked(len(self._text), draft.used_words)
        for phrase in self._phrases:
            for part in phrase.leaves:
                if (
                    _used(phrase, part)
                    and any(effect[part.span.start : part.span.end])
                    and _traced(phrase, part, draft)
                ):
                    read[part.span.start : part.span.end] = b"\1" * (part.span.end - part.span.start)
            if phrase.rule in CONDITIONAL_RULES and any(effect[phrase.span.start : phrase.span.end]):
                _mark_conditions(read, self._text, phrase)
        return read

    def unused(self, draft: Draft, words: Sequence[Word], telling: frozenset[str]) -> Iterator[Span]:
        """Every known word that tells something, and that no reader has used or listed.

        A phrase goes on past such words. It uses those between its parts, as `the wind comes from`, but not what
        stands beside a thing, as `passing` in `two passing cars`.
        """
        listed = (*draft.not_understood, *draft.not_expressible)
        used = [Span(passage.start, passage.end) for passage in listed]
        used += [*draft.used_words, *(span for span, _ in draft.faults)]
        effects = [span for _, _, span in draft.statements] + draft.acknowledged
        for phrase in self._phrases:
            if phrase.rule in CLAIMING_RULES or not any(leaf.kind in NOUN_KINDS for leaf in phrase.leaves):
                used += (
                    [phrase.span]
                    if any(_within(phrase.span, span) or _within(span, phrase.span) for span in effects)
                    else []
                )
        marks = marked(len(self._text), used)
        alone = {item.span for clause in self._clauses for item in clause.items if isinstance(item, Word)}
        read = self.read_characters(draft)
        beside = [*words[1:], *words[-1:]]
        for previous, word, following in zip([*words[:1], *words[:-1]], words, beside, strict=True):
            kinds = {meaning.kind for meaning in word.meanings}
            # `after 60 s` where the time is read: its reader has looked at the word before it.
            joined = bool(kinds & JOINING_KINDS) and (read[previous.span.start] or read[following.span.start])
            passed_over = bool(kinds & TELLING_KINDS) and word.text.lower() not in MERE_PARTICLES
            tells = word.span in alone and passed_over and not joined
            tells = word.text.lower() in telling if word.filler else tells
            if tells and not any(marks[word.span.start : word.span.end]):
                yield word.span
        yield from self._idle_references(draft)
        yield from (Span(*match.span()) for match in _THERE.finditer(self._text) if not marks[match.start()])

    def _idle_references(self, draft: Draft) -> Iterator[Span]:
        """Groups that a limit names without being about them: `not lower than 15 m over people`."""
        for clause in self._clauses:
            limits = [item for item in clause.items if isinstance(item, Phrase) and item.rule == "field"]
            paths = [path for path, _, span in draft.statements if _within(span, clause.span)]
            if limits and all(path[0] == "rules" for path in paths):
                yield from (span for span in draft.references if _within(span, clause.span))

    def _listed_characters(self, draft: Draft) -> bytearray:
        """For each character, whether it belongs to a phrase that its reader has listed as a whole."""
        listed = {(item.start, item.end) for item in (*draft.not_expressible, *draft.not_understood)}
        spans = [phrase.span for phrase in self._phrases if (phrase.span.start, phrase.span.end) in listed]
        return marked(len(self._text), spans)

    def _entries(self, index: int, unread: Sequence[LoadedWord]) -> list[LedgerEntry]:
        """What the unread words of a clause do to it and to the clauses beside it."""
        clause = self._clauses[index]
        turning = [word for word in unread if word.load in LEFT_OUT]
        entries: list[LedgerEntry] = []
        for word in turning:
            if not entries or not _within(word.span, entries[-1].span):
                reached = self._scope(index, word).joined(word.span)
                inside = tuple(other for other in turning if _within(other.span, reached))
                entries.append(LedgerEntry(reached, inside[:MAX_NAMED_WORDS], left_out=True))
        rest = tuple(word for word in unread if not any(_within(word.span, entry.span) for entry in entries))[
            :MAX_NAMED_WORDS
        ]
        if rest:
            entries.append(LedgerEntry(clause.span, rest, left_out=False))
        return entries

    def _scope(self, index: int, word: LoadedWord) -> Span:
        """How far a word reaches that may turn the meaning of its clause around."""
        clause = self._clauses[index]
        if word.load is Load.NEGATION:
            denied = [
                item for item in clause.items if isinstance(item, Phrase) and item.span.start >= word.span.end
            ]
            # `80 m is not allowed` denies what stands before it.
            return Span(word.span.start, clause.span.end) if denied else clause.span
        sentence = [other for other in self._clauses if other.sentence == clause.sentence]
        at = sentence.index(clause)
        if word.load is Load.ALTERNATIVE:
            begins = self._text[clause.span.start : word.span.start].strip() == ""
            return sentence[at - 1].span.joined(clause.span) if begins and at else clause.span
        if word.load is Load.INSTRUCTION:
            # `forget everything above and set the height to 10 m` is not obeyed in any part.
            return clause.span.joined(sentence[-1].span)
        if word.load in (Load.SUBORDINATE, Load.ASIDE):
            return clause.span
        if word.load is not Load.CONDITION:
            # `a second report, priority 2`: what follows a subject that is not read is said of it.
            ordinal = word.text.lower().startswith(("a ", "the "))
            subject_alone = ordinal and not any(isinstance(item, Phrase) for item in clause.items)
            return clause.span.joined(sentence[-1].span) if subject_alone else clause.span
        before = self._text[clause.span.start : word.span.start].lower().split()
        main = [
            item for item in clause.items if isinstance(item, Phrase) and item.span.end <= word.span.start
        ]
        # `there are four children unless it rains` places nobody for sure.
        placed = word.text.lower() == "unless" and any(item.rule == "group" for item in main)
        if word.text.lower() in EXCEPTIONS and main and not placed:
            # `no faster than 6 m/s until she is found`: what stands before it holds all the same, until then.
            return Span(word.span.start, clause.span.end)
        # `hold when it rains`: the clause itself. `when it rains, hold`: what follows too. `and when it rains, hold`:
        # nothing before. `hold, when it rains`: what stands before it too.
        if any(part not in ("and", "but", "then", "only", "so", "even", "except") for part in before):
            return clause.span
        start = sentence[0].span.start if at and not before else clause.span.start
        return Span(start, sentence[-1].span.end)


def _is_field(item: Phrase | Word) -> bool:
    return isinstance(item, Phrase) and item.rule == "field"


def marked(length: int, spans: Sequence[Span]) -> bytearray:
    """For each character of a text, whether it lies in one of the spans."""
    marks = bytearray(length)
    for span in spans:
        marks[span.start : span.end] = b"\1" * (span.end - span.start)
    return marks


def _stands(draft: Draft, path: tuple[str | int, ...], value: Any) -> bool:
    """Whether what a passage stated is in the document still."""
    entry = draft.entries.get(path)
    return entry is not None and entry.value == value


def _used(phrase: Phrase, part: Part) -> bool:
    if part.kind in VALUE_KINDS or part.kind in LOOSE_BOUNDS.get(phrase.rule, ()):
        return part.used
    return True


def _traced(phrase: Phrase, part: Part, draft: Draft) -> bool:
    """Whether the number of a part is found again in a field that its passage has set."""
    if part.kind not in TRACED_KINDS or phrase.rule in UNTRACED_RULES:
        return True
    quantity = part.value
    if not isinstance(quantity, Quantity):
        return True
    values = [
        number
        for path, value, span in draft.statements
        if _within(part.span, span)
        for number in _numbers(value)
    ]
    # A distance without a range is a band around it, and an angle is taken within the circle.
    close = [quantity.low, quantity.high, quantity.low % 360]
    return not values or any(
        abs(number - wanted) <= 0.11 * abs(wanted) + 1e-6 for number in values for wanted in close
    )


def _numbers(value: Any) -> list[float]:
    if isinstance(value, bool):
        return []
    if isinstance(value, int | float):
        return [float(value)]
    if isinstance(value, list | dict):
        members = value.values() if isinstance(value, dict) else value
        return [number for member in members for number in _numbers(member)]
    return []


def _mark_conditions(read: bytearray, text: str, phrase: Phrase) -> None:
    """A rule is read with the words that begin its condition, and with `any`, which stand between its parts."""
    for match in _CONDITION_OF_A_RULE.finditer(text, phrase.span.start, phrase.span.end):
        read[match.start() : match.end()] = b"\1" * (match.end() - match.start())


_CONDITION_OF_A_RULE = re.compile(
    r"(?<!\bof )(?<!\bwithin )(?<!\bm )\b(?:when|while|if|whenever|any|all)\b(?!\s+of\b)", re.IGNORECASE
)
BESIDE_ONE = re.compile(
    r"\b(?:inside|in|near|beside|behind|around|of|from|to|by)\s+(?:only\s+)?$", re.IGNORECASE
)
"""What makes `one of them` any member of a group: a distance is to the nearest one."""
_BEFORE_THE_GROUP = frozenset(["", "of", "the", "of the", "these", "those", "of these", "of those"])


_OF_THE_HOSTILE = re.compile(
    r"(?:[\s:(,-]|\b(?:\d+\s?x?|an?|one|two|three|four|five|six)\b)*(?:\w+\s)?", re.IGNORECASE
)
"""What may stand between a word for enemies and what it makes an enemy."""
_WITHOUT_STOP = re.compile(r"[^,.;:!?\n]{0,40}")


def _is_hostile(word: LoadedWord, draft: Draft) -> bool:
    """Whether the thing beside a word that makes an enemy is one, or nothing that is known."""
    roles = []
    for path, _, span in draft.statements:
        if path[0] != "actors" or path[-1] != "asset" or ("actors", path[1], "role") not in draft.entries:
            continue
        if word.load is Load.HOSTILE:
            beside = _OF_THE_HOSTILE.fullmatch(draft.text, word.span.end, max(word.span.end, span.start))
            near = span.start >= word.span.end and beside is not None
        else:
            near = span.end <= word.span.start and bool(
                _WITHOUT_STOP.fullmatch(draft.text, span.end, word.span.start)
            )
        if near:
            roles.append(draft.entries["actors", path[1], "role"].value)
    return all(role == "adversary" for role in roles)


def _is_harmless(word: LoadedWord, draft: Draft) -> bool:
    """Whether what a word says is true of the document as it is.

    `all the civilians`, where the text has civilians: whoever is meant, it is the whole group. `near one of
    the houses`: that is what a distance to a group means.
    """
    if word.load in (Load.HOSTILE, Load.ARMED):
        return _is_hostile(word, draft)
    if word.load is Load.SHARE:
        return word.text.lower().startswith("one of") and bool(
            BESIDE_ONE.search(draft.text[: word.span.start])
        )
    if word.load is not Load.QUANTIFIER or word.text.lower() not in ("all", "both", "every", "any", "each"):
        return False
    if word.text.lower() == "each" and not _of_all_members(word, draft):
        return False
    return any(
        word.span.end <= span.start
        and draft.text[word.span.end : span.start].strip().lower() in _BEFORE_THE_GROUP
        for span in draft.references
    )


def _of_all_members(word: LoadedWord, draft: Draft) -> bool:
    """Whether `each` begins a sentence that counts nobody: `each crate has two civilians near it` tells how many
    there are to a crate.
    """
    before = draft.text[: word.span.start].rstrip()
    end = _SENTENCE_END.search(draft.text, word.span.end)
    sentence = Span(word.span.start, end.start() if end else len(draft.text))
    counts = [span for path, _, span in draft.statements if path[-1] == "count" and _within(span, sentence)]
    return not counts and (not before or before[-1] in ".;!?")


_SENTENCE_END = re.compile(r"[.;!?](?:\s|$)")


def _is_of_a_rule(word: LoadedWord, draft: Draft, clause: Span) -> bool:
    """Whether a quantifier stands in a clause that sets rules alone, which hold for any report and at any time."""
    paths = [path for path, _, span in draft.statements if _within(span, clause)]
    general = word.load is Load.QUANTIFIER and word.text.lower() == "any"
    return general and bool(paths) and all(path[0] == "rules" for path in paths)


def _within(inner: Span, outer: Span) -> bool:
    return outer.start <= inner.start and inner.end <= outer.end
